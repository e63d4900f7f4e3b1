//! Copies of the library that nobody needs any more: those that no job names, and those of a process that was killed.
//!
//! Only below the data folder, which one process uses: in a folder or bucket of files that is shared, jobs of another database may name
//! them.

use super::{COPIES, TEMPORARY};
use crate::jobs::database::Database;
use futures_util::TryStreamExt as _;
use sqlx::Row as _;
use std::collections::BTreeSet;
use std::io;
use std::path::Path;

/// Digits of a copy's hash.
const DIGITS: usize = 32;

impl Database {
    async fn has_jobs(&self) -> Result<bool, sqlx::Error> {
        let found = sqlx::query("SELECT 1 FROM job LIMIT 1");
        Ok(found.fetch_optional(&self.pool).await?.is_some())
    }

    /// The names of the copies that jobs read, by their specifications of any version.
    async fn library_copies(&self) -> Result<BTreeSet<String>, sqlx::Error> {
        let mut rows = sqlx::query("SELECT spec FROM job WHERE spec LIKE '%library/%'").fetch(&self.pool);
        let mut named = BTreeSet::new();
        while let Some(row) = rows.try_next().await? {
            let spec: String = row.try_get("spec")?;
            named.extend(copies_in(&spec).map(str::to_owned));
        }
        Ok(named)
    }
}

/// The hashes in keys such as `library/0123…`.
fn copies_in(spec: &str) -> impl Iterator<Item = &str> {
    let ends = spec.split(COPIES).skip(1).filter_map(|rest| rest.strip_prefix('/'));
    ends.filter_map(|rest| rest.get(..DIGITS)).filter(|hash| is_hash(hash))
}

fn is_hash(name: &str) -> bool {
    name.len() == DIGITS && name.bytes().all(|digit| digit.is_ascii_hexdigit())
}

/// Removes them; before the first request, so that no submission is about to name one. Copies stay in a database without jobs: it may be
/// the wrong one.
///
/// * `has_copies`: the copies that jobs name lie in this data folder
///
/// # Errors
/// The folder cannot be read, or the database does not respond. A copy that cannot be removed is reported and left for the next time.
pub(crate) async fn tidy(database: &Database, data: &Path, has_copies: bool) -> Result<(), String> {
    let told = |error: &dyn std::fmt::Display| {
        format!(
            "{}: unused copies of the library cannot be listed: {error}",
            data.display()
        )
    };
    let mut unused: Vec<_> = names(data).map_err(|error| told(&error))?;
    unused.retain(|name| name.starts_with(TEMPORARY));
    // Nothing else: an operator may have put the server's own library here.
    let mut copies = names(&data.join(COPIES)).map_err(|error| told(&error))?;
    copies.retain(|name| is_hash(name));
    let has_jobs = async || database.has_jobs().await.map_err(|error| told(&error));
    if has_copies && !copies.is_empty() && has_jobs().await? {
        let named = database.library_copies().await.map_err(|error| told(&error))?;
        let left = copies.into_iter().filter(|name| !named.contains(name));
        unused.extend(left.map(|name| format!("{COPIES}/{name}")));
    }
    for name in unused {
        match std::fs::remove_dir_all(data.join(&name)) {
            Ok(()) => tracing::info!(name, "a copy of the library that no job needs is removed"),
            Err(error) => tracing::warn!(name, %error, "an unused copy of the library cannot be removed"),
        }
    }
    Ok(())
}

/// Names of the folders in a folder; none if it does not exist.
fn names(folder: &Path) -> io::Result<Vec<String>> {
    let entries = match std::fs::read_dir(folder) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
        entries => entries?,
    };
    let mut names = Vec::new();
    for entry in entries {
        let entry = entry?;
        if entry.file_type()?.is_dir() {
            names.extend(entry.file_name().into_string());
        }
    }
    Ok(names)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_a_copy_is_known_by_its_hash_alone() {
        let (one, two) = ("0123456789abcdef".repeat(2), "f".repeat(DIGITS));
        let spec = format!(
            r#"{{"inputs": [{{"path": "library", "folder": "library/{one}"}}, {{"path": "library/campaigns/a.toml", "text": "ü"}},
            {{"folder": "library/{two}"}}, {{"folder": "library/{}"}}], "end": "library/ü"}}"#,
            &one[1..]
        );
        let found: Vec<&str> = copies_in(&spec).collect();
        assert_eq!(found, [one.as_str(), two.as_str()]);
        assert_eq!(copies_in("library").count(), 0);
    }
}
