//! Uploads in progress: kept once a job references them, and removed in all other cases, whatever fails.
//!
//! ```text
//!  begin ──▶ uploads/ID is written ──▶ decide: the job is submitted ──▶ kept      (accepted: the job owns it)
//!    │                │                              │────────────────▶ discarded (rejected, or a duplicate)
//!    │                └─ dropped: removed            └─ unknown: left as it is
//!    └─ DATA/incoming/ID exists until the outcome is decided
//! ```
//! The marker is in the data folder, which one process uses exclusively: markers found at startup were left by a killed process, even
//! if several servers write to one folder of files or one bucket. The database then tells whether a job references the file.

use crate::artifacts::Artifacts;
use crate::data_folder::OWN_FILE;
use crate::jobs::database::Database;
use crate::jobs::queue::new_id;
use std::io;
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::{Path, PathBuf};

/// Folder of the markers in the data folder.
const MARKS: &str = "incoming";
/// Prefix of files in the data folder that are evaluated during the upload, and never referenced by a job.
pub(crate) const JUDGED: &str = "upload-";

/// A file that is being uploaded.
#[derive(Debug)]
pub(crate) struct Incoming {
    artifacts: Artifacts,
    key: String,
    mark: PathBuf,
    /// Dropping it leaves files and marker as they are.
    is_decided: bool,
}

impl Incoming {
    /// Creates a marker for a new key.
    ///
    /// # Errors
    /// The marker cannot be written.
    pub(crate) fn begin(artifacts: &Artifacts, data: &Path) -> io::Result<Self> {
        let (marks, id) = (data.join(MARKS), new_id());
        std::fs::create_dir_all(&marks)?;
        let mark = marks.join(&id);
        std::fs::File::options()
            .create_new(true)
            .write(true)
            .mode(OWN_FILE)
            .open(&mark)?;
        Ok(Self {
            artifacts: artifacts.clone(),
            key: format!("uploads/{id}"),
            mark,
            is_decided: false,
        })
    }

    /// Key of its folder in the file store.
    pub(crate) fn key(&self) -> &str {
        &self.key
    }

    /// Local path of its folder.
    pub(crate) fn folder(&self) -> PathBuf {
        self.artifacts.place(&self.key)
    }

    /// It is complete, and a job that references it is about to be submitted. From now on only the database can tell whether the job
    /// exists: the connection of the client or to the database may be lost after the commit.
    pub(crate) fn decide(&mut self) {
        self.is_decided = true;
    }

    /// A job references it.
    pub(crate) fn keep(mut self) {
        self.is_decided = true;
        self.unmark();
    }

    /// No job references it, and none will.
    pub(crate) async fn discard(mut self) {
        self.is_decided = true;
        match self.artifacts.delete(&self.key).await {
            Ok(()) => self.unmark(),
            Err(error) => tracing::warn!(key = self.key, %error, "an unused upload cannot be deleted"),
        }
    }

    fn unmark(&self) {
        if let Err(error) = std::fs::remove_file(&self.mark) {
            tracing::warn!(key = self.key, %error, "the mark of an upload cannot be removed");
        }
    }
}

impl Drop for Incoming {
    /// The client disconnected during the upload: the request is aborted.
    fn drop(&mut self) {
        if self.is_decided {
            return;
        }
        // Not yet published, so it only exists here.
        match std::fs::remove_dir_all(self.folder()) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => {
                tracing::warn!(key = self.key, %error, "a part of an upload cannot be deleted");
            }
            _ => self.unmark(),
        }
    }
}

/// Removes remains of a process killed during uploads to this data folder.
///
/// # Errors
/// The folder cannot be read, or the database does not respond. A file that cannot be removed is reported and left for the next time.
pub(crate) async fn tidy(artifacts: &Artifacts, database: &Database, data: &Path) -> Result<(), String> {
    let told = |error: &dyn std::fmt::Display| format!("{}: recent uploads cannot be listed: {error}", data.display());
    for path in entries(&data.join(MARKS)).map_err(|error| told(&error))? {
        let Some(id) = path.file_name().and_then(|name| name.to_str()) else {
            continue;
        };
        let incoming = Incoming {
            artifacts: artifacts.clone(),
            key: format!("uploads/{id}"),
            mark: path.clone(),
            is_decided: true,
        };
        if database
            .names_upload(incoming.key())
            .await
            .map_err(|error| told(&error))?
        {
            incoming.keep();
        } else {
            tracing::info!(
                key = incoming.key,
                "an upload left incomplete by an earlier process is removed"
            );
            incoming.discard().await;
        }
    }
    for path in entries(data).map_err(|error| told(&error))? {
        let is_judged = path
            .file_name()
            .and_then(|name| name.to_str())
            .is_some_and(|name| name.starts_with(JUDGED));
        if is_judged && let Err(error) = std::fs::remove_file(&path) {
            tracing::warn!(path = %path.display(), %error, "a file left incomplete by an earlier process cannot be removed");
        }
    }
    Ok(())
}

fn entries(folder: &Path) -> io::Result<Vec<PathBuf>> {
    match std::fs::read_dir(folder) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(Vec::new()),
        entries => entries?.map(|entry| entry.map(|entry| entry.path())).collect(),
    }
}
