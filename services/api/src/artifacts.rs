//! Files of jobs: a local folder, or a bucket shared by several hosts.
//!
//! | Where | A worker writes | A reader reads |
//! |---|---|---|
//! | local folder (default: the data folder) | in place | in place |
//! | `s3://BUCKET[/PREFIX]` | locally, then uploads | a cached copy, fetched on first access ([`Copies`]) |
//!
//! Keys look like paths: `jobs/ID/ATTEMPT/out/report.html`. A job's files never change once it has ended, so a cached copy is never stale.

use crate::bucket::{Bucket, File};
use crate::copies::Copies;
use crate::data_folder::OWN_FOLDER;
use std::io;
use std::os::unix::fs::DirBuilderExt as _;
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

/// Minimum free space for a job, bytes.
const LEAST_ROOM: u64 = 1 << 20;

/// Files of jobs.
#[derive(Debug, Clone)]
pub(crate) struct Artifacts {
    /// Folder of the files, or of cached copies.
    root: PathBuf,
    bucket: Option<(Bucket, Arc<Copies>)>,
}

impl Artifacts {
    /// `root`: the folder, or the cache. `address`: none, or `s3://BUCKET[/PREFIX]` with the credentials in the environment
    /// (`AWS_ACCESS_KEY_ID`, `AWS_SECRET_ACCESS_KEY`, `AWS_REGION`, `AWS_ENDPOINT`, `AWS_ALLOW_HTTP`).
    ///
    /// # Errors
    /// One sentence.
    pub(crate) fn open(root: &Path, address: Option<&str>) -> Result<Self, String> {
        let bucket = match address {
            None => None,
            Some(address) => Some(Bucket::open(address).map_err(|error| format!("--artifacts {error}"))?),
        };
        let told = |error: io::Error| format!("{}: cannot be used for files: {error}", root.display());
        // Logs and results are private. The permissions of a folder that others share are not ours to change.
        std::fs::DirBuilder::new()
            .recursive(true)
            .mode(OWN_FOLDER)
            .create(root)
            .map_err(told)?;
        let bucket = match bucket {
            None => None,
            Some(bucket) => Some((bucket, Arc::new(Copies::below(root).map_err(told)?))),
        };
        Ok(Self {
            root: root.to_owned(),
            bucket,
        })
    }

    /// Local path where a worker writes files for this key.
    pub(crate) fn place(&self, key: &str) -> PathBuf {
        self.root.join(key)
    }

    /// Whether there is enough space for a worker. True if unknown (an in-memory file system without a limit reports no blocks).
    pub(crate) fn has_room(&self) -> bool {
        let has_room = || {
            rustix::fs::statvfs(&self.root).map_or(true, |space| {
                space.f_blocks == 0 || space.f_bavail.saturating_mul(space.f_frsize) >= LEAST_ROOM
            })
        };
        if let Some((_, copies)) = &self.bucket
            && !has_room()
        {
            copies.make_room(Instant::now());
        }
        has_room()
    }

    /// Makes everything below a key durable and visible to all hosts; returns the number of bytes.
    ///
    /// # Errors
    /// A file cannot be read or written.
    pub(crate) async fn publish(&self, key: &str) -> io::Result<u64> {
        let files = files_below(&self.place(key))?;
        for file in &files {
            self.publish_file(key, &file.path).await?;
        }
        Ok(files.iter().map(|file| file.size).sum())
    }

    /// The same of one file below it.
    ///
    /// # Errors
    /// It cannot be read or written.
    pub(crate) async fn publish_file(&self, key: &str, relative: &str) -> io::Result<()> {
        let path = self.place(key).join(relative);
        match &self.bucket {
            // An accepted result survives a power cut.
            None => tokio::fs::File::open(&path).await?.sync_all().await,
            Some((bucket, copies)) => {
                bucket.upload(&format!("{key}/{relative}"), &path).await?;
                copies.note(&path, Instant::now());
                Ok(())
            }
        }
    }

    /// Removes the files of an ended attempt from this host, if a bucket has those that are kept.
    pub(crate) fn leave(&self, key: &str) {
        if let Some((_, copies)) = &self.bucket {
            let place = self.place(key);
            copies.forget(&place);
            if let Err(error) = std::fs::remove_dir_all(&place) {
                tracing::debug!(key, %error, "its files are gone already");
            }
        }
    }

    /// A local path of a file; `None`: there is none, or the path leads elsewhere.
    ///
    /// # Errors
    /// It exists but cannot be read.
    pub(crate) async fn file(&self, key: &str, relative: &str) -> io::Result<Option<PathBuf>> {
        let plain = |path: &str| {
            !path.is_empty()
                && Path::new(path)
                    .components()
                    .all(|part| matches!(part, Component::Normal(_)))
        };
        if !plain(relative) || !plain(key) {
            return Ok(None);
        }
        let root = self.place(key);
        let path = root.join(relative);
        if let Some((bucket, copies)) = &self.bucket {
            if path.is_file() {
                copies.used(&path, Instant::now());
            } else if bucket.download(&format!("{key}/{relative}"), &path).await? {
                copies.note(&path, Instant::now());
            } else {
                return Ok(None);
            }
        }
        // A link must not lead out of the folder.
        let (Ok(root), Ok(real)) = (root.canonicalize(), path.canonicalize()) else {
            return Ok(None);
        };
        Ok(Some(real).filter(|real| real.starts_with(&root) && real.is_file()))
    }

    /// All files below a key, in order.
    ///
    /// # Errors
    /// The store does not answer.
    pub(crate) async fn list(&self, key: &str) -> io::Result<Vec<File>> {
        match &self.bucket {
            None => files_below(&self.place(key)),
            Some((bucket, _)) => bucket.list(key).await,
        }
    }

    /// Deletes everything below a key.
    ///
    /// # Errors
    /// The store does not answer.
    pub(crate) async fn delete(&self, key: &str) -> io::Result<()> {
        if let Some((bucket, copies)) = &self.bucket {
            for file in bucket.list(key).await? {
                bucket.delete(&format!("{key}/{}", file.path)).await?;
            }
            copies.forget(&self.place(key));
        }
        match tokio::fs::remove_dir_all(self.place(key)).await {
            Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error),
            _ => Ok(()),
        }
    }

    /// Whether the store can be reached.
    ///
    /// # Errors
    /// It cannot.
    pub(crate) async fn ping(&self) -> io::Result<()> {
        match &self.bucket {
            None => std::fs::metadata(&self.root).map(|_| ()),
            Some((bucket, _)) => bucket.has("ping").await.map(drop),
        }
    }
}

/// Plain files below a folder, in order; empty if it does not exist.
pub(crate) fn files_below(root: &Path) -> io::Result<Vec<File>> {
    let mut files = Vec::new();
    let mut open = vec![root.to_owned()];
    while let Some(folder) = open.pop() {
        let entries = match std::fs::read_dir(&folder) {
            Ok(entries) => entries,
            Err(error) if error.kind() == io::ErrorKind::NotFound => continue,
            Err(error) => return Err(error),
        };
        for entry in entries {
            let entry = entry?;
            let (path, kind) = (entry.path(), entry.file_type()?);
            if kind.is_dir() {
                open.push(path);
            } else if kind.is_file()
                && let Some(relative) = path.strip_prefix(root).ok().and_then(Path::to_str)
            {
                files.push(File {
                    path: relative.to_owned(),
                    size: entry.metadata()?.len(),
                });
            }
        }
    }
    files.sort_by(|a, b| a.path.cmp(&b.path));
    Ok(files)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn val_files_stay_in_their_folder() {
        let folder = tempfile::tempdir().expect("a folder");
        let artifacts = Artifacts::open(folder.path(), None).expect("it opens");
        let place = artifacts.place("jobs/a/1/out");
        std::fs::create_dir_all(place.join("sub")).expect("made");
        std::fs::write(place.join("sub/b.txt"), "four").expect("written");
        std::fs::write(folder.path().join("secret"), "x").expect("written");
        std::os::unix::fs::symlink(folder.path().join("secret"), place.join("link")).expect("linked");
        assert_eq!(artifacts.publish("jobs/a/1/out").await.expect("published"), 4);
        let listed = artifacts.list("jobs/a/1/out").await.expect("listed");
        assert_eq!(
            listed,
            [File {
                path: "sub/b.txt".to_owned(),
                size: 4
            }]
        );
        let file = |relative: &'static str| {
            let artifacts = artifacts.clone();
            async move { artifacts.file("jobs/a/1/out", relative).await.expect("readable") }
        };
        assert!(file("sub/b.txt").await.is_some());
        for bad in [
            "",
            "sub",
            "nowhere",
            "../../../../secret",
            "/etc/passwd",
            "link",
            "sub/../../x",
        ] {
            assert_eq!(file(bad).await, None, "{bad}");
        }
        artifacts.delete("jobs/a").await.expect("deleted");
        assert!(!place.exists());
    }
}
