//! Location of the development data, if present.

#[expect(unreachable_pub, reason = "public in the crate that the file is of")]
#[path = "../../../../tests/src/skip.rs"]
mod skip;

use std::path::{Path, PathBuf};

/// The folder of `ROTORTWIN_SHARED`, otherwise `../shared` next to the repository; `None` is noted for `./test` to
/// count.
pub(crate) fn shared(inside: &str) -> Option<PathBuf> {
    let beside = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared");
    let folder = std::env::var_os("ROTORTWIN_SHARED")
        .map_or_else(beside, PathBuf::from)
        .join(inside);
    if folder.is_dir() {
        return Some(folder);
    }
    skip::skip(&format!(
        "flight logs: {inside} is not beside the repository (ROTORTWIN_SHARED)"
    ));
    None
}
