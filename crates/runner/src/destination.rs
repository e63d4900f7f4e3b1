//! Output locations: checked before the work, so that no result is lost, with an explicit error for a full disk.

use rotortwin_store::run_folder::RunFolder;
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};

/// Less free space than this counts as full.
const FULL_BELOW_BYTES: u64 = 64 * 1024;

/// An output folder, created before the work: like that of a run, it must not exist or be empty. If dropped without [`keep`](Self::keep),
/// it is removed again, so that bad input leaves nothing behind.
pub struct ResultFolder(Option<RunFolder>);

impl ResultFolder {
    /// Creates it, and makes sure that it is writable.
    pub fn create(path: &Path) -> Result<Self, String> {
        let folder = RunFolder::create(path).map_err(|error| error.to_string())?;
        let probe = folder.spool_path();
        if let Err(error) = std::fs::File::create_new(&probe).and_then(|_| std::fs::remove_file(&probe)) {
            let sentence = format!("{}: cannot write to the folder: {error}", path.display());
            folder.discard().map_err(|error| error.to_string())?;
            return Err(sentence);
        }
        Ok(Self(Some(folder)))
    }

    /// As [`create`](Self::create), if a folder was requested.
    pub fn of_option(path: Option<&PathBuf>) -> Result<Option<Self>, String> {
        path.map(|path| Self::create(path)).transpose()
    }

    /// As [`of_option`](Self::of_option); also `None` for a folder that contains only `inside`, or the path to it: the results go next to
    /// it.
    pub fn beside(path: Option<&Path>, inside: &Path) -> Result<Option<Self>, String> {
        match path {
            Some(path) if holds_only(path, inside) => Ok(None),
            path => path.map(Self::create).transpose(),
        }
    }

    /// The work is done: keeps the folder.
    pub fn keep(mut self) -> RunFolder {
        self.0.take().expect("only this takes it")
    }
}

impl Drop for ResultFolder {
    fn drop(&mut self) {
        if let Some(folder) = self.0.take()
            && let Err(error) = folder.discard()
        {
            tracing::warn!(%error, "an empty folder stays");
        }
    }
}

/// Whether the folder `path` has one entry, and `inside` is it or lies below it.
fn holds_only(path: &Path, inside: &Path) -> bool {
    let Ok(entries) = std::fs::read_dir(path) else {
        return false;
    };
    let names: Vec<_> = entries.flatten().map(|entry| entry.file_name()).collect();
    let first = inside.strip_prefix(path).ok().and_then(|rest| rest.iter().next());
    matches!(names.as_slice(), [name] if Some(name.as_os_str()) == first)
}

/// Checks that a file can be written, without leaving any change.
pub fn writable_file(path: &Path) -> Result<(), String> {
    let existed = path.exists();
    std::fs::File::options()
        .append(true)
        .create(true)
        .open(path)
        .and_then(|_| if existed { Ok(()) } else { std::fs::remove_file(path) })
        .map_err(|error| format!("{}: cannot be written: {error}", path.display()))
}

/// As [`writable_file`], of a file that must not exist.
pub fn new_file(path: &Path) -> Result<(), String> {
    if path.exists() {
        return Err(format!("{}: already exists; choose another name", path.display()));
    }
    writable_file(path)
}

/// Writes a text that was also printed.
pub fn write_text(path: &Path, text: &str) -> Result<(), String> {
    std::fs::write(path, text).map_err(|error| format!("{}: cannot be written: {error}", path.display()))
}

/// Whether an error, which came as a sentence, is that of a full disk or an exceeded quota. Linux words both as below.
pub fn is_of_a_full_disk(sentence: &str) -> bool {
    let codes = [rustix::io::Errno::NOSPC, rustix::io::Errno::DQUOT];
    codes
        .iter()
        .any(|code| sentence.contains(&format!("(os error {})", code.raw_os_error())))
        || sentence.contains("the disk is full")
}

/// Bytes in a unit that shows more than 0.
fn size(bytes: u64) -> String {
    match bytes >> 20 {
        0 => format!("{} KiB", bytes >> 10),
        whole => format!("{whole} MiB"),
    }
}

/// An error of a full disk, with the disk: that of the first path in the sentence whose folder exists, otherwise of the folder one is in.
pub fn with_full_disk(sentence: String) -> String {
    if !is_of_a_full_disk(&sentence) || sentence.contains("the disk is full") {
        return sentence;
    }
    let ends = |c: char| c.is_whitespace() || "`',;".contains(c);
    let words = sentence.split(ends).map(|word| Path::new(word.trim_end_matches(':')));
    let is_there = |path: &&Path| path.exists() || path.parent().is_some_and(Path::is_dir);
    let place = words.into_iter().find(is_there).unwrap_or(Path::new("."));
    match full_disk(place, &sentence) {
        Some(disk) => format!("{sentence}; {disk}"),
        None => sentence,
    }
}

/// An error message about a full disk at `place`, if it is full, or if `sentence`, the error, says so: what was written may have been removed since.
pub(crate) fn full_disk(place: &Path, sentence: &str) -> Option<String> {
    let place = place.ancestors().find(|place| place.exists())?.canonicalize().ok()?;
    let space = rustix::fs::statvfs(&place).ok()?;
    let free = space.f_bavail * space.f_frsize;
    let device = std::fs::metadata(&place).ok()?.dev();
    let on_it = |path: &&Path| std::fs::metadata(path).is_ok_and(|data| data.dev() == device);
    let mount = place.ancestors().take_while(on_it).last()?;
    (free < FULL_BELOW_BYTES || is_of_a_full_disk(sentence)).then(|| {
        format!(
            "the disk is full: {} has {} left of {}",
            mount.display(),
            size(free),
            size(space.f_blocks * space.f_frsize)
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_a_folder_is_kept_only_for_results() {
        let place = tempfile::tempdir().unwrap();
        let path = place.path().join("out");
        drop(ResultFolder::create(&path).unwrap());
        assert!(!path.exists(), "bad input leaves nothing");
        let folder = ResultFolder::create(&path).unwrap().keep();
        std::fs::write(folder.path().join("result"), "1").unwrap();
        let refusal = ResultFolder::create(&path).err().unwrap_or_default();
        assert!(refusal.contains("not empty"), "{refusal}");
        assert!(path.join("result").exists());
    }

    #[test]
    fn val_results_go_beside_the_models_and_nothing_else() {
        let place = tempfile::tempdir().unwrap();
        let (out, models) = (place.path().join("out"), place.path().join("out/models"));
        std::fs::create_dir_all(&models).unwrap();
        assert!(ResultFolder::beside(Some(&out), &models).unwrap().is_none());
        std::fs::write(out.join("improvement.txt"), "1").unwrap();
        assert!(ResultFolder::beside(Some(&out), &models).is_err());
    }

    #[test]
    fn val_a_file_that_can_be_written_is_left_as_it_was() {
        let place = tempfile::tempdir().unwrap();
        let path = place.path().join("file");
        writable_file(&path).unwrap();
        assert!(!path.exists());
        std::fs::write(&path, "before").unwrap();
        writable_file(&path).unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "before");
        let refusal = new_file(&path).unwrap_err();
        assert!(refusal.contains("already exists"), "{refusal}");
        let refusal = writable_file(&place.path().join("no/such/folder")).unwrap_err();
        assert!(refusal.contains("no/such/folder: cannot be written"), "{refusal}");
    }

    #[test]
    fn val_a_full_disk_is_named_where_a_sentence_has_its_path() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("series.parquet");
        let mount = |sentence: &str| {
            let (_, disk) = sentence.split_once("; the disk is full: ")?;
            disk.split(' ').next().map(str::to_owned)
        };
        for sentence in [
            format!(
                "{}: cannot be written: No space left on device (os error 28)",
                path.display()
            ),
            format!(
                "the log cannot be stored at {}: No space left on device (os error 28)",
                path.display()
            ),
            "page.html: cannot be written: No space left on device (os error 28)".to_owned(),
        ] {
            let said = with_full_disk(sentence.clone());
            assert!(said.starts_with(&sentence), "{said}");
            assert!(mount(&said).is_some_and(|mount| mount.starts_with('/')), "{said}");
            assert_eq!(with_full_disk(said.clone()), said, "told once");
        }
        let other = "a.csv: permission denied (os error 13)".to_owned();
        assert_eq!(with_full_disk(other.clone()), other);
    }

    #[test]
    fn val_a_disk_with_room_is_not_full() {
        let place = std::env::temp_dir().join("not/there/yet");
        assert_eq!(full_disk(&place, "permission denied (os error 13)"), None);
        // What was written was removed before anybody looked: the error decides.
        let said = full_disk(&place, "a.csv: No space left on device (os error 28)").unwrap();
        assert!(said.starts_with("the disk is full: /"), "{said}");
        assert_eq!(
            (size(300 << 10), size(3 << 30)),
            ("300 KiB".to_owned(), "3072 MiB".to_owned())
        );
    }
}
