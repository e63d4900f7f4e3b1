//! Rebuild when a file is added to `config/`: `include_dir!` by itself only sees changes of known files.

fn main() {
    println!("cargo::rerun-if-changed=../../config");
}
