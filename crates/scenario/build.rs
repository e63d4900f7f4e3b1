//! A file that joins `config/` is part of the program, too: `include_dir!` by itself sees changes of known files only.

fn main() {
    println!("cargo::rerun-if-changed=../../config");
}
