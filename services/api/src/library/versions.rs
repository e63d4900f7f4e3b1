//! Versioned models in the database: numbered immutable versions, and branches that point to them.
//!
//! ```text
//! model f550     v0 ── v1 ── v2        versions, numbered over all branches
//!                 └── v3   ▲ main
//!                     ▲ windy
//! ```
//! The content of versions, their parents and differences are defined by [`rotortwin_twin::model`]; this module stores them, per tenant.
//! The head of `main` is also stored as a document ([`super::own`]), so that it can be used wherever a model is named.
//!
//! Every change first writes the row of the model: a concurrent change waits, and then finds the branch moved.

use crate::jobs::database::Database;
use crate::jobs::timed::Transaction;
use crate::library::DocumentKind;
use crate::library::own::hash_of;
use crate::readers::Readers;
use rotortwin_twin::model::ModelVersion;
use rotortwin_twin::model::store::{History, MAIN};
use sqlx::Row as _;
use std::collections::BTreeMap;
use std::path::Path;

/// Maximum number of versions of one model.
const MOST_VERSIONS: i64 = 500;
/// Maximum number of versioned models per tenant.
const MOST_MODELS: i64 = 500;

/// A model with all its versions and branches.
#[derive(Debug, Clone)]
pub(crate) struct StoredModel {
    /// Versions and branches.
    pub(crate) history: History,
    /// Creation time of each version, ms since 1970.
    pub(crate) made_ms: BTreeMap<u32, i64>,
}

/// Result of a change.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Changed {
    /// The number of the branch's new version.
    To(u32),
    /// The branch is gone, or has moved.
    Moved,
    /// There are too many versions or models.
    Full,
}

/// Rows written by this program that cannot be read.
fn unreadable(error: impl std::fmt::Display) -> sqlx::Error {
    sqlx::Error::Decode(format!("a stored version of a model cannot be read: {error}").into())
}

impl Database {
    /// A model of a tenant; `None`: there is no versioned model with this name.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn model(
        &self,
        readers: &Readers,
        tenant: &str,
        name: &str,
    ) -> Result<Option<StoredModel>, sqlx::Error> {
        // Branches first: a version created in between is then extra rather than missing.
        let branches = sqlx::query("SELECT branch, number FROM model_branch WHERE tenant = $1 AND model = $2")
            .bind(tenant)
            .bind(name)
            .fetch_all(&self.pool)
            .await?;
        if branches.is_empty() {
            return Ok(None);
        }
        let rows = sqlx::query(
            "SELECT number, text, made_ms FROM model_version WHERE tenant = $1 AND model = $2 ORDER BY number",
        )
        .bind(tenant)
        .bind(name)
        .fetch_all(&self.pool)
        .await?;
        let read = || {
            let mut history = History {
                versions: BTreeMap::new(),
                branches: BTreeMap::new(),
            };
            for row in branches {
                history.branches.insert(row.try_get("branch")?, number_of(&row)?);
            }
            let mut made_ms = BTreeMap::new();
            for row in rows {
                let number = number_of(&row)?;
                let text: String = row.try_get("text")?;
                let version = ModelVersion::parse(name, &text, Path::new("")).map_err(unreadable)?;
                history.versions.insert(number, version);
                made_ms.insert(number, row.try_get("made_ms")?);
            }
            Ok::<_, sqlx::Error>(StoredModel { history, made_ms })
        };
        readers.read(read).await.map(Some)
    }

    /// Whether a versioned model with this name exists.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn has_model(&self, tenant: &str, name: &str) -> Result<bool, sqlx::Error> {
        let row = sqlx::query("SELECT name FROM model WHERE tenant = $1 AND name = $2")
            .bind(tenant)
            .bind(name)
            .fetch_optional(&self.pool)
            .await?;
        Ok(row.is_some())
    }

    /// Creates a model with these versions, the last one the head of `main`. [`Changed::Moved`]: it has been created meanwhile.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn begin_model(
        &self,
        tenant: &str,
        name: &str,
        versions: &[&ModelVersion],
    ) -> Result<Changed, sqlx::Error> {
        let mut transaction = self.pool.begin().await?;
        let begun = sqlx::query(
            "INSERT INTO model (tenant, name, versions) \
             SELECT $1, $2, $3 WHERE (SELECT COUNT(*) FROM model WHERE tenant = $4) < $5 ON CONFLICT (tenant, name) DO NOTHING",
        )
        .bind(tenant)
        .bind(name)
        .bind(versions.len() as i64)
        .bind(tenant)
        .bind(MOST_MODELS)
        .execute(&mut *transaction)
        .await?
        .rows_affected();
        if begun == 0 {
            drop(transaction);
            let there = self.has_model(tenant, name).await?;
            return Ok(if there { Changed::Moved } else { Changed::Full });
        }
        let mut head = 0;
        for (number, version) in versions.iter().enumerate() {
            head = u32::try_from(number).map_err(unreadable)?;
            self.write_version(&mut transaction, tenant, name, head, version)
                .await?;
        }
        sqlx::query("INSERT INTO model_branch (tenant, model, branch, number) VALUES ($1, $2, $3, $4)")
            .bind(tenant)
            .bind(name)
            .bind(MAIN)
            .bind(i64::from(head))
            .execute(&mut *transaction)
            .await?;
        if let Some(version) = versions.last() {
            self.show_head(&mut transaction, tenant, name, version).await?;
        }
        transaction.commit().await?;
        Ok(Changed::To(head))
    }

    /// Adds a version after the expected head of a branch.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn append_version(
        &self,
        tenant: &str,
        name: &str,
        branch: &str,
        stands_at: u32,
        version: &ModelVersion,
    ) -> Result<Changed, sqlx::Error> {
        let mut transaction = self.pool.begin().await?;
        let counted =
            sqlx::query("UPDATE model SET versions = versions + 1 WHERE tenant = $1 AND name = $2 RETURNING versions")
                .bind(tenant)
                .bind(name)
                .fetch_optional(&mut *transaction)
                .await?;
        let Some(counted) = counted else {
            return Ok(Changed::Moved);
        };
        let count: i64 = counted.try_get("versions")?;
        if count > MOST_VERSIONS {
            return Ok(Changed::Full);
        }
        let number = u32::try_from(count - 1).map_err(unreadable)?;
        if !move_branch(&mut transaction, tenant, name, branch, stands_at, number).await? {
            return Ok(Changed::Moved);
        }
        self.write_version(&mut transaction, tenant, name, number, version)
            .await?;
        if branch == MAIN {
            self.show_head(&mut transaction, tenant, name, version).await?;
        }
        transaction.commit().await?;
        Ok(Changed::To(number))
    }

    /// Moves a branch from one existing version to another.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn move_model_branch(
        &self,
        tenant: &str,
        name: &str,
        branch: &str,
        from: u32,
        to: (u32, &ModelVersion),
    ) -> Result<Changed, sqlx::Error> {
        let mut transaction = self.pool.begin().await?;
        hold(&mut transaction, tenant, name).await?;
        if !move_branch(&mut transaction, tenant, name, branch, from, to.0).await? {
            return Ok(Changed::Moved);
        }
        if branch == MAIN {
            self.show_head(&mut transaction, tenant, name, to.1).await?;
        }
        transaction.commit().await?;
        Ok(Changed::To(to.0))
    }

    /// Creates a branch at an existing version. [`Changed::Moved`]: the name exists.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn make_model_branch(
        &self,
        tenant: &str,
        name: &str,
        branch: &str,
        at: u32,
    ) -> Result<Changed, sqlx::Error> {
        let mut transaction = self.pool.begin().await?;
        hold(&mut transaction, tenant, name).await?;
        let made = sqlx::query(
            "INSERT INTO model_branch (tenant, model, branch, number) \
             SELECT $1, $2, $3, $4 WHERE (SELECT COUNT(*) FROM model_branch WHERE tenant = $5 AND model = $6) < $7 \
             ON CONFLICT (tenant, model, branch) DO NOTHING",
        )
        .bind(tenant)
        .bind(name)
        .bind(branch)
        .bind(i64::from(at))
        .bind(tenant)
        .bind(name)
        .bind(MOST_VERSIONS)
        .execute(&mut *transaction)
        .await?
        .rows_affected();
        if made == 0 {
            let there = sqlx::query("SELECT number FROM model_branch WHERE tenant = $1 AND model = $2 AND branch = $3")
                .bind(tenant)
                .bind(name)
                .bind(branch)
                .fetch_optional(&mut *transaction)
                .await?;
            return Ok(if there.is_some() { Changed::Moved } else { Changed::Full });
        }
        transaction.commit().await?;
        Ok(Changed::To(at))
    }

    /// Deletes all versions and branches of a model; `false`: there is no versioned model with this name.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn forget_model(&self, tenant: &str, name: &str) -> Result<bool, sqlx::Error> {
        let mut transaction = self.pool.begin().await?;
        let mut rows = 0;
        for statement in [
            "DELETE FROM model WHERE tenant = $1 AND name = $2",
            "DELETE FROM model_branch WHERE tenant = $1 AND model = $2",
            "DELETE FROM model_version WHERE tenant = $1 AND model = $2",
        ] {
            rows += sqlx::query(statement)
                .bind(tenant)
                .bind(name)
                .execute(&mut *transaction)
                .await?
                .rows_affected();
        }
        transaction.commit().await?;
        Ok(rows > 0)
    }

    async fn write_version(
        &self,
        transaction: &mut Transaction,
        tenant: &str,
        name: &str,
        number: u32,
        version: &ModelVersion,
    ) -> Result<(), sqlx::Error> {
        sqlx::query(
            self.sql("INSERT INTO model_version (tenant, model, number, text, made_ms) VALUES ($1, $2, $3, $4, @NOW)"),
        )
        .bind(tenant)
        .bind(name)
        .bind(i64::from(number))
        .bind(version.to_toml())
        .execute(&mut **transaction)
        .await
        .map(|_| ())
    }

    /// Stores the head of `main` as a document.
    async fn show_head(
        &self,
        transaction: &mut Transaction,
        tenant: &str,
        name: &str,
        version: &ModelVersion,
    ) -> Result<(), sqlx::Error> {
        let text = version.to_toml();
        sqlx::query(self.sql(
            "INSERT INTO document (tenant, folder, name, text, hash, changed_ms) VALUES ($1, $2, $3, $4, $5, @NOW) \
             ON CONFLICT (tenant, folder, name) DO UPDATE SET text = excluded.text, hash = excluded.hash, changed_ms = excluded.changed_ms",
        ))
        .bind(tenant)
        .bind(DocumentKind::Model.folder())
        .bind(name)
        .bind(&text)
        .bind(hash_of(&text))
        .execute(&mut **transaction)
        .await
        .map(|_| ())
    }
}

/// Rewrites the row of a model unchanged: locks the model until the transaction ends.
async fn hold(transaction: &mut Transaction, tenant: &str, name: &str) -> Result<(), sqlx::Error> {
    sqlx::query("UPDATE model SET versions = versions WHERE tenant = $1 AND name = $2")
        .bind(tenant)
        .bind(name)
        .execute(&mut **transaction)
        .await
        .map(|_| ())
}

/// `false`: it has moved.
async fn move_branch(
    transaction: &mut Transaction,
    tenant: &str,
    name: &str,
    branch: &str,
    from: u32,
    to: u32,
) -> Result<bool, sqlx::Error> {
    sqlx::query("UPDATE model_branch SET number = $1 WHERE tenant = $2 AND model = $3 AND branch = $4 AND number = $5")
        .bind(i64::from(to))
        .bind(tenant)
        .bind(name)
        .bind(branch)
        .bind(i64::from(from))
        .execute(&mut **transaction)
        .await
        .map(|done| done.rows_affected() == 1)
}

fn number_of(row: &sqlx::any::AnyRow) -> Result<u32, sqlx::Error> {
    u32::try_from(row.try_get::<i64, _>("number")?).map_err(unreadable)
}
