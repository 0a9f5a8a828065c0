//! The daemon: see `pelicald --help`.
fn main() {}
