//! With the feature `realsense`: keeps symbols of statically linked C libraries inside the program. librealsense brings an LZ4 of its own,
//! and would be bound to the one of the bag reader, with which it crashes.

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    let is_elf = std::env::var("CARGO_CFG_TARGET_OS").is_ok_and(|system| system == "linux");
    if is_elf && std::env::var_os("CARGO_FEATURE_REALSENSE").is_some() {
        println!("cargo::rustc-link-arg=-Wl,--exclude-libs,ALL");
    }
}
