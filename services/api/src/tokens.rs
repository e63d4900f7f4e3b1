//! API tokens: `rtw_ID_SECRET`. The database stores the SHA-256 of the whole; the token itself is shown once and stored
//! nowhere.

use crate::jobs::database::Database;
use serde::Serialize;
use sha2::{Digest as _, Sha256};
use sqlx::Row as _;
use std::fmt::Write as _;
use std::path::Path;
use std::str::FromStr;

/// Permissions.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Scope {
    /// See the jobs of the tenant and the library.
    Read,
    /// Submit, cancel, delete.
    Write,
    /// See and do everything of every tenant.
    Admin,
}

impl Scope {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Read, Self::Write, Self::Admin];

    /// Name on the command line and in the database.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Read => "read",
            Self::Write => "write",
            Self::Admin => "admin",
        }
    }
}

impl FromStr for Scope {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        Self::ALL
            .into_iter()
            .find(|scope| scope.as_str() == text)
            .ok_or_else(|| format!("'{text}' is not a scope; expected read, write or admin"))
    }
}

/// A token as stored in the database.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Token {
    /// Public part.
    pub id: String,
    /// Display name of the owner.
    pub name: String,
    /// Tenant of its jobs.
    pub tenant: String,
    /// Its permissions.
    pub scopes: Vec<Scope>,
    /// ms since 1970.
    pub created_ms: i64,
    /// Expiry; `None`: it does not expire.
    pub expires_ms: Option<i64>,
    /// Time of revocation.
    pub revoked_ms: Option<i64>,
}

/// A token to create.
#[derive(Debug, Clone)]
pub struct NewToken {
    /// Display name of the owner.
    pub name: String,
    /// Tenant of its jobs.
    pub tenant: String,
    /// Its permissions.
    pub scopes: Vec<Scope>,
    /// Lifetime, ms; `None`: it does not expire.
    pub valid_ms: Option<i64>,
}

/// Opens the database of a server for token management, whether or not the server is running.
///
/// # Errors
/// One sentence.
pub async fn open(data: &Path, database_url: Option<&str>) -> Result<Tokens, String> {
    let database = match database_url {
        Some(url) => Database::open_postgres(url, 1).await?,
        None => {
            std::fs::create_dir_all(data)
                .map_err(|error| format!("{}: cannot be used as data folder: {error}", data.display()))?;
            Database::open_file(&data.join("rotortwin.sqlite")).await?
        }
    };
    Ok(Tokens(database))
}

/// The tokens of a server.
pub struct Tokens(Database);

impl Tokens {
    /// Creates a token; returns the text to hand out, which is not shown again.
    ///
    /// # Errors
    /// The database.
    pub async fn create(&self, new: &NewToken) -> Result<String, String> {
        let id = format!("{:016x}", rand::random::<u64>());
        let text = format!(
            "rtw_{id}_{:032x}{:032x}",
            rand::random::<u128>(),
            rand::random::<u128>()
        );
        let scopes: Vec<&str> = new.scopes.iter().map(|scope| scope.as_str()).collect();
        sqlx::query(self.0.sql(
            "INSERT INTO token (id, name, tenant, hash, scopes, created_ms, expires_ms) \
             VALUES ($1, $2, $3, $4, $5, @NOW, CASE WHEN $6 > 0 THEN @NOW + $7 ELSE NULL END)",
        ))
        .bind(&id)
        .bind(&new.name)
        .bind(&new.tenant)
        .bind(hash(&text))
        .bind(scopes.join(" "))
        .bind(new.valid_ms.unwrap_or(0))
        .bind(new.valid_ms.unwrap_or(0))
        .execute(&self.0.pool)
        .await
        .map_err(|error| format!("the token cannot be written: {error}"))?;
        Ok(text)
    }

    /// All tokens, the oldest first.
    ///
    /// # Errors
    /// The database.
    pub async fn list(&self) -> Result<Vec<Token>, String> {
        let told = |error: sqlx::Error| format!("the tokens cannot be read: {error}");
        let rows = sqlx::query("SELECT * FROM token ORDER BY created_ms, id")
            .fetch_all(&self.0.pool)
            .await
            .map_err(told)?;
        rows.iter().map(token_of).collect::<Result<_, _>>().map_err(told)
    }

    /// Revokes a token; `false` if the id is unknown.
    ///
    /// # Errors
    /// The database.
    pub async fn revoke(&self, id: &str) -> Result<bool, String> {
        sqlx::query(
            self.0
                .sql("UPDATE token SET revoked_ms = @NOW WHERE id = $1 AND revoked_ms IS NULL"),
        )
        .bind(id)
        .execute(&self.0.pool)
        .await
        .map(|done| done.rows_affected() > 0)
        .map_err(|error| format!("the token cannot be written: {error}"))
    }
}

impl Database {
    /// The token with this text, if currently valid.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn token(&self, text: &str) -> Result<Option<Token>, sqlx::Error> {
        let row = sqlx::query(self.sql(
            "SELECT * FROM token WHERE hash = $1 AND revoked_ms IS NULL AND (expires_ms IS NULL OR expires_ms > @NOW)",
        ))
        .bind(hash(text))
        .fetch_optional(&self.pool)
        .await?;
        row.as_ref().map(token_of).transpose()
    }

    /// Whether a token was ever created: from then on all clients need one, even when all have expired.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn has_tokens(&self) -> Result<bool, sqlx::Error> {
        let row = sqlx::query("SELECT id FROM token LIMIT 1")
            .fetch_optional(&self.pool)
            .await?;
        Ok(row.is_some())
    }
}

pub(crate) fn token_of(row: &sqlx::any::AnyRow) -> Result<Token, sqlx::Error> {
    let scopes: String = row.try_get("scopes")?;
    Ok(Token {
        id: row.try_get("id")?,
        name: row.try_get("name")?,
        tenant: row.try_get("tenant")?,
        scopes: scopes.split(' ').filter_map(|word| word.parse().ok()).collect(),
        created_ms: row.try_get("created_ms")?,
        expires_ms: row.try_get("expires_ms")?,
        revoked_ms: row.try_get("revoked_ms")?,
    })
}

/// The secret has 256 random bits: neither salt nor a slow hash is needed.
pub(crate) fn hash(text: &str) -> String {
    Sha256::digest(text.as_bytes())
        .iter()
        .fold(String::with_capacity(64), |mut hex, byte| {
            // Writing to a text cannot fail.
            let _written = write!(hex, "{byte:02x}");
            hex
        })
}

/// Whether a moment, ms since 1970, has passed.
pub fn has_passed(at_ms: i64) -> bool {
    at_ms <= crate::clock::now_ms()
}
