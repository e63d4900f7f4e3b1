//! Documents that clients store in the library, per tenant: in the database, overlaid on the server's folder.
//!
//! ```text
//!  PUT /api/v1/vehicles/mine ─▶ database ─┐
//!  the server's folder (--library) ───────┴─▶ libraries/TENANT/HASH/ ─▶ Library of this caller
//! ```
//! A tenant's document hides the server's of the same name. The folder is rebuilt when either side has changed.

use super::{DocumentKind, Library, copy_all};
use crate::App;
use crate::access::Caller;
use crate::artifacts::files_below;
use crate::jobs::database::Database;
use crate::jobs::queue::new_id;
use crate::problem::Problem;
use sqlx::Row as _;
use std::io;
use std::path::Path;
use std::time::{Duration, SystemTime};

/// Maximum number of documents per tenant.
const MOST_DOCUMENTS: i64 = 500;
/// Maximum size of a document, bytes.
pub(crate) const LARGEST_DOCUMENT: usize = 256 << 10;
/// Written last: a folder without it is incomplete.
const COMPLETE: &str = ".complete";
/// An outdated folder may be in use for this long.
const KEPT: Duration = Duration::from_secs(600);

/// A document of a client.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct OwnDocument {
    pub(crate) folder: String,
    pub(crate) name: String,
    /// Hash of the text.
    pub(crate) hash: String,
    pub(crate) changed_ms: i64,
}

/// Precondition for writing a document.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Precondition {
    None,
    /// `If-None-Match: *`.
    Absent,
    /// `If-Match`.
    Hash(String),
}

/// Result of a write.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Written {
    Created,
    Replaced,
    /// The precondition does not hold.
    Refused,
    /// There are too many.
    Full,
}

pub(crate) fn hash_of(text: &str) -> String {
    format!("{:032x}", xxhash_rust::xxh3::xxh3_128(text.as_bytes()))
}

impl Database {
    /// A tenant's documents, in order.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn documents(&self, tenant: &str) -> Result<Vec<OwnDocument>, sqlx::Error> {
        let rows =
            sqlx::query("SELECT folder, name, hash, changed_ms FROM document WHERE tenant = $1 ORDER BY folder, name")
                .bind(tenant)
                .fetch_all(&self.pool)
                .await?;
        rows.iter()
            .map(|row| {
                Ok(OwnDocument {
                    folder: row.try_get("folder")?,
                    name: row.try_get("name")?,
                    hash: row.try_get("hash")?,
                    changed_ms: row.try_get("changed_ms")?,
                })
            })
            .collect()
    }

    async fn document_text(&self, tenant: &str, document: &OwnDocument) -> Result<Option<String>, sqlx::Error> {
        let row =
            sqlx::query("SELECT text FROM document WHERE tenant = $1 AND folder = $2 AND name = $3 AND hash = $4")
                .bind(tenant)
                .bind(&document.folder)
                .bind(&document.name)
                .bind(&document.hash)
                .fetch_optional(&self.pool)
                .await?;
        row.map(|row| row.try_get("text")).transpose()
    }

    /// Writes a document if its precondition holds.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn put_document(
        &self,
        tenant: &str,
        kind: DocumentKind,
        name: &str,
        text: &str,
        precondition: &Precondition,
    ) -> Result<Written, sqlx::Error> {
        if let Precondition::Hash(expected) = precondition {
            let replaced = self.replace_document(tenant, kind, name, text, Some(expected)).await?;
            return Ok(if replaced { Written::Replaced } else { Written::Refused });
        }
        let created = sqlx::query(self.sql(
            "INSERT INTO document (tenant, folder, name, text, hash, changed_ms) \
             SELECT $1, $2, $3, $4, $5, @NOW WHERE (SELECT COUNT(*) FROM document WHERE tenant = $6) < $7 \
             ON CONFLICT (tenant, folder, name) DO NOTHING",
        ))
        .bind(tenant)
        .bind(kind.folder())
        .bind(name)
        .bind(text)
        .bind(hash_of(text))
        .bind(tenant)
        .bind(MOST_DOCUMENTS)
        .execute(&self.pool)
        .await?
        .rows_affected();
        if created == 1 {
            return Ok(Written::Created);
        }
        if *precondition == Precondition::Absent {
            let there = self.has_document(tenant, kind, name).await?;
            return Ok(if there { Written::Refused } else { Written::Full });
        }
        let replaced = self.replace_document(tenant, kind, name, text, None).await?;
        Ok(if replaced { Written::Replaced } else { Written::Full })
    }

    /// Replaces an existing document, with this hash if given.
    async fn replace_document(
        &self,
        tenant: &str,
        kind: DocumentKind,
        name: &str,
        text: &str,
        hash: Option<&str>,
    ) -> Result<bool, sqlx::Error> {
        sqlx::query(self.sql(
            "UPDATE document SET text = $1, hash = $2, changed_ms = @NOW \
             WHERE tenant = $3 AND folder = $4 AND name = $5 AND hash = COALESCE($6, hash)",
        ))
        .bind(text)
        .bind(hash_of(text))
        .bind(tenant)
        .bind(kind.folder())
        .bind(name)
        .bind(hash)
        .execute(&self.pool)
        .await
        .map(|done| done.rows_affected() == 1)
    }

    /// Whether a tenant has stored a document with this name.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn has_document(&self, tenant: &str, kind: DocumentKind, name: &str) -> Result<bool, sqlx::Error> {
        let absent = self.holds(tenant, kind, name, &Precondition::Absent).await?;
        Ok(!absent)
    }

    /// Whether a precondition holds for a document of a tenant.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn holds(
        &self,
        tenant: &str,
        kind: DocumentKind,
        name: &str,
        precondition: &Precondition,
    ) -> Result<bool, sqlx::Error> {
        let hash: Option<String> =
            sqlx::query_scalar("SELECT hash FROM document WHERE tenant = $1 AND folder = $2 AND name = $3")
                .bind(tenant)
                .bind(kind.folder())
                .bind(name)
                .fetch_optional(&self.pool)
                .await?;
        Ok(match precondition {
            Precondition::None => true,
            Precondition::Absent => hash.is_none(),
            Precondition::Hash(expected) => hash.as_ref() == Some(expected),
        })
    }

    /// Deletes a document, with this hash if given; `false` if it does not exist.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn delete_document(
        &self,
        tenant: &str,
        kind: DocumentKind,
        name: &str,
        hash: Option<&str>,
    ) -> Result<bool, sqlx::Error> {
        sqlx::query(
            "DELETE FROM document WHERE tenant = $1 AND folder = $2 AND name = $3 AND hash = COALESCE($4, hash)",
        )
        .bind(tenant)
        .bind(kind.folder())
        .bind(name)
        .bind(hash)
        .execute(&self.pool)
        .await
        .map(|done| done.rows_affected() > 0)
    }
}

impl App {
    /// The library as seen by a caller: the server's, with the caller's own documents.
    ///
    /// # Errors
    /// 500, 503, 507.
    pub(crate) async fn library(&self, caller: &Caller) -> Result<Library, Problem> {
        let own = self.database.documents(&caller.tenant).await?;
        if own.is_empty() {
            return Ok(self.shelf.clone());
        }
        let digest = digest(&self.shelf, &own).map_err(|error| Problem::internal(&error))?;
        let account = format!("{:016x}", xxhash_rust::xxh3::xxh3_64(caller.tenant.as_bytes()));
        let folder = self.config.work.data.join("libraries").join(account);
        let root = folder.join(&digest);
        if !root.join(COMPLETE).is_file() {
            let mut texts = Vec::with_capacity(own.len());
            for document in own {
                // A document changed meanwhile is read on the next access.
                if let Some(text) = self.database.document_text(&caller.tenant, &document).await? {
                    texts.push((document, text));
                }
            }
            let (shelf, root) = (self.shelf.clone(), root.clone());
            tokio::task::spawn_blocking(move || lay_over(&shelf, &texts, &root))
                .await
                .map_err(|error| Problem::internal(&error))?
                .map_err(|error| {
                    Problem::unwritten(
                        &error,
                        "your documents cannot be written: the disk of the data folder is full",
                    )
                })?;
            clear_away(&folder, &digest);
        }
        Library::open(&root).map_err(|error| Problem::internal(&error))
    }
}

/// Changes when a file of the server's folder or a document does.
fn digest(shelf: &Library, own: &[OwnDocument]) -> io::Result<String> {
    let mut hash = xxhash_rust::xxh3::Xxh3::new();
    for file in files_below(shelf.root())? {
        let changed = std::fs::metadata(shelf.root().join(&file.path))?.modified()?;
        let changed = changed
            .duration_since(SystemTime::UNIX_EPOCH)
            .unwrap_or_default()
            .as_nanos();
        hash.update(format!("{}\0{}\0{changed}\0", file.path, file.size).as_bytes());
    }
    for document in own {
        hash.update(format!("{}\0{}\0{}\0", document.folder, document.name, document.hash).as_bytes());
    }
    Ok(format!("{:032x}", hash.digest128()))
}

fn lay_over(shelf: &Library, own: &[(OwnDocument, String)], root: &Path) -> io::Result<()> {
    // To a temporary path first: another request may do the same.
    let beside = root.with_extension(new_id());
    copy_all(shelf.root(), &beside)?;
    for (document, text) in own {
        let path = beside.join(DocumentKind::path(&document.folder, &document.name));
        std::fs::create_dir_all(path.parent().unwrap_or(&beside))?;
        std::fs::write(path, text)?;
    }
    std::fs::write(beside.join(COMPLETE), "")?;
    match std::fs::rename(&beside, root) {
        // Another request was faster, with the same content.
        Err(_) if root.join(COMPLETE).is_file() => std::fs::remove_dir_all(&beside),
        other => other,
    }
}

/// Removes outdated folders that can no longer be in use.
fn clear_away(folder: &Path, current: &str) {
    let Ok(entries) = std::fs::read_dir(folder) else { return };
    for entry in entries.filter_map(Result::ok) {
        let age = entry
            .metadata()
            .and_then(|data| data.modified())
            .ok()
            .and_then(|at| at.elapsed().ok());
        if entry.file_name() != current
            && age.is_some_and(|age| age > KEPT)
            && let Err(error) = std::fs::remove_dir_all(entry.path())
        {
            tracing::debug!(path = %entry.path().display(), %error, "an old copy of a library cannot be removed");
        }
    }
}
