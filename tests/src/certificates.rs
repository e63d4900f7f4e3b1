//! Certificates for a test, created as users do: with `deploy/certificates.sh`.

use crate::scratch::{Scratch, repository};
use std::path::PathBuf;
use std::process::Command;

/// Creates certificates in a folder `name` of the test, each `NAME[,HOST,…]`; `None` if there is no openssl.
pub fn certificates(scratch: &Scratch, name: &str, entries: &[&str]) -> Option<PathBuf> {
    if Command::new("openssl").arg("version").output().is_err() {
        crate::skip("openssl is missing: no certificates for the tests of zenoh over TLS");
        return None;
    }
    let folder = scratch.path(name);
    let made = Command::new(repository().join("deploy/certificates.sh"))
        .arg(&folder)
        .args(entries)
        .output()
        .expect("the script can be run");
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    Some(folder)
}
