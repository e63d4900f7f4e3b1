//! The embedded files of `config/`, extracted to a folder that every file reader can use.

use include_dir::{Dir, include_dir};
use std::io;
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use xxhash_rust::xxh3::Xxh3;

static CONFIG: Dir<'_> = include_dir!("$CARGO_MANIFEST_DIR/../../config");

/// Whether `config/` has this file.
pub(crate) fn has(file: &str) -> bool {
    CONFIG.get_file(file).is_some()
}

/// A folder with the files of `config/` as this program was built: in the user's cache, or a temporary folder if that is not writable.
/// Modified files are restored.
///
/// # Errors
/// Neither can be written.
pub fn folder() -> io::Result<PathBuf> {
    static FOLDER: OnceLock<PathBuf> = OnceLock::new();
    if let Some(folder) = FOLDER.get() {
        return Ok(folder.clone());
    }
    let name = format!("config-{:016x}", digest());
    let cache = variable_path("XDG_CACHE_HOME").or_else(|| Some(variable_path("HOME")?.join(".cache")));
    let folder = cache
        .map(|cache| cache.join("rotortwin").join(&name))
        .filter(|folder| lay_out(folder).is_ok());
    let folder = match folder {
        Some(folder) => folder,
        None => {
            let user = rustix::process::getuid().as_raw();
            let folder = std::env::temp_dir().join(format!("rotortwin-{user}-{name}"));
            lay_out(&folder)?;
            // In a world-writable place, another user may have created it.
            if std::fs::metadata(&folder)?.uid() != user {
                let reason = format!("{} belongs to another user", folder.display());
                return Err(io::Error::new(io::ErrorKind::PermissionDenied, reason));
            }
            folder
        }
    };
    Ok(FOLDER.get_or_init(|| folder).clone())
}

/// Hash of all paths and contents, so that two versions of the program do not share a folder.
fn digest() -> u64 {
    let mut hash = Xxh3::new();
    for file in every_file(&CONFIG) {
        hash.update(file.path().as_os_str().as_encoded_bytes());
        hash.update(file.contents());
    }
    hash.digest()
}

fn every_file<'a>(folder: &'a Dir<'a>) -> Box<dyn Iterator<Item = &'a include_dir::File<'a>> + 'a> {
    Box::new(folder.files().chain(folder.dirs().flat_map(every_file)))
}

/// Writes missing or modified files; safe with several programs at once.
fn lay_out(folder: &Path) -> io::Result<()> {
    for file in every_file(&CONFIG) {
        let path = folder.join(file.path());
        if std::fs::read(&path).is_ok_and(|found| found == file.contents()) {
            continue;
        }
        let parent = path.parent().unwrap_or(folder);
        std::fs::create_dir_all(parent)?;
        let mut written = tempfile::NamedTempFile::new_in(parent)?;
        io::Write::write_all(&mut written, file.contents())?;
        written.persist(&path)?;
    }
    Ok(())
}

/// An absolute path from a variable; others are ignored, as the XDG specification requires.
pub(crate) fn variable_path(variable: &str) -> Option<PathBuf> {
    std::env::var_os(variable)
        .map(PathBuf::from)
        .filter(|path| path.is_absolute())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_what_was_changed_is_put_right() {
        let scratch = tempfile::tempdir().unwrap();
        let folder = scratch.path().join("laid-out");
        lay_out(&folder).unwrap();
        let hover = folder.join("scenarios/hover.toml");
        let before = std::fs::read(&hover).unwrap();
        std::fs::write(&hover, "spoilt").unwrap();
        lay_out(&folder).unwrap();
        assert_eq!(std::fs::read(&hover).unwrap(), before);
        let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/scenarios/hover.toml");
        assert_eq!(before, std::fs::read(shipped).unwrap());
    }

    #[test]
    fn val_a_folder_that_cannot_be_written_is_an_error() {
        let scratch = tempfile::tempdir().unwrap();
        let file = scratch.path().join("a-file");
        std::fs::write(&file, "").unwrap();
        assert!(lay_out(&file.join("below")).is_err());
    }
}
