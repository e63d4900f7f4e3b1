//! Rebuild when a file is added to the bundle of the page: `include_dir!` by itself only sees changes of known files.

fn main() {
    println!("cargo::rerun-if-changed=../../web/dist");
}
