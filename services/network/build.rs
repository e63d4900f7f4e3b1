//! In the small build, functions with the same machine code are linked once.

use std::path::{Path, PathBuf};

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    let out = std::env::var_os("OUT_DIR").map(PathBuf::from).unwrap_or_default();
    // target/PROFILE/build/PACKAGE/out
    let is_small = out
        .ancestors()
        .nth(3)
        .and_then(Path::file_name)
        .is_some_and(|profile| profile == "small");
    // Only there is the linker that comes with Rust (LLD) the default; others do not know the option.
    let is_lld = std::env::var("TARGET").is_ok_and(|target| target == "x86_64-unknown-linux-gnu");
    if is_small && is_lld {
        println!("cargo::rustc-link-arg-bins=-Wl,--icf=all");
    }
}
