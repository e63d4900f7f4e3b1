//! Compresses the bundle of the page into `OUT_DIR/web`, where `web.rs` embeds it: 1 MB becomes 0.3 MB.

use flate2::{Compression, GzBuilder};
use std::fs;
use std::io::{Result, Write as _};
use std::path::{Path, PathBuf};

const BUNDLE: &str = "../../web/dist";

fn main() -> Result<()> {
    println!("cargo::rerun-if-changed={BUNDLE}");
    let out = std::env::var_os("OUT_DIR").ok_or(std::io::ErrorKind::NotFound)?;
    let out = PathBuf::from(out).join("web");
    // Files of an earlier bundle have other names.
    if out.exists() {
        fs::remove_dir_all(&out)?;
    }
    compress(Path::new(BUNDLE), &out)
}

fn compress(from: &Path, to: &Path) -> Result<()> {
    fs::create_dir_all(to)?;
    for entry in fs::read_dir(from)? {
        let entry = entry?;
        let target = to.join(entry.file_name());
        if entry.file_type()?.is_dir() {
            compress(&entry.path(), &target)?;
        } else {
            // Without name and time: the same bytes for the same bundle.
            let mut gzip = GzBuilder::new().write(fs::File::create(target)?, Compression::best());
            gzip.write_all(&fs::read(entry.path())?)?;
            gzip.finish()?;
        }
    }
    Ok(())
}
