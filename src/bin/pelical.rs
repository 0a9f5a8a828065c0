//! The client: see `pelical --help`.
fn main() {}
