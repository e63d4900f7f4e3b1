//! Browser sessions: page loads, event streams and WebSockets cannot send `Authorization`, but they send a cookie.
//!
//! ```text
//! POST /api/v1/session {"token": "rtw_…"} ─▶ Set-Cookie: rotortwin_session=SECRET; HttpOnly; SameSite=Strict; Path=/; Secure (under TLS)
//! ```
//! The cookie contains its own secret, not the token; the database stores its SHA-256 and the token it belongs to. A session has its token's
//! current permissions: whatever ends the token ends its sessions. Pages of other sites cannot make a browser send it (`SameSite`), no script
//! can read it (`HttpOnly`), and writes and WebSockets from foreign origins are rejected in any case ([`crate::browsers`]).

use crate::jobs::database::Database;
use crate::tokens::{Token, hash, token_of};
use axum::http::{HeaderMap, header};

/// Name of the cookie.
pub(crate) const COOKIE: &str = "rotortwin_session";
/// Lifetime of a session, ms: a week.
const VALID_MS: i64 = 7 * 24 * 3600 * 1000;

impl Database {
    /// Starts a session for a token; returns its secret.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn begin_session(&self, token: &Token) -> Result<String, sqlx::Error> {
        let secret = format!("{:032x}{:032x}", rand::random::<u128>(), rand::random::<u128>());
        sqlx::query(self.sql("DELETE FROM session WHERE expires_ms <= @NOW"))
            .execute(&self.pool)
            .await?;
        sqlx::query(self.sql("INSERT INTO session (hash, token_id, expires_ms) VALUES ($1, $2, @NOW + $3)"))
            .bind(hash(&secret))
            .bind(&token.id)
            .bind(VALID_MS)
            .execute(&self.pool)
            .await?;
        Ok(secret)
    }

    /// The token of a session, if both are currently valid.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn token_of_session(&self, secret: &str) -> Result<Option<Token>, sqlx::Error> {
        let row = sqlx::query(self.sql(
            "SELECT t.* FROM session s JOIN token t ON t.id = s.token_id WHERE s.hash = $1 AND s.expires_ms > @NOW \
             AND t.revoked_ms IS NULL AND (t.expires_ms IS NULL OR t.expires_ms > @NOW)",
        ))
        .bind(hash(secret))
        .fetch_optional(&self.pool)
        .await?;
        row.as_ref().map(token_of).transpose()
    }

    /// Ends a session.
    ///
    /// # Errors
    /// The database.
    pub(crate) async fn end_session(&self, secret: &str) -> Result<(), sqlx::Error> {
        sqlx::query("DELETE FROM session WHERE hash = $1")
            .bind(hash(secret))
            .execute(&self.pool)
            .await
            .map(|_| ())
    }
}

/// The session secret of a request.
pub(crate) fn secret(headers: &HeaderMap) -> Option<&str> {
    headers
        .get_all(header::COOKIE)
        .iter()
        .filter_map(|value| value.to_str().ok())
        .flat_map(|text| text.split(';'))
        .filter_map(|pair| pair.trim().split_once('='))
        .find(|(name, value)| *name == COOKIE && !value.is_empty())
        .map(|(_, value)| value)
}

/// Cookie header that sets a secret, or deletes it (`None`).
pub(crate) fn cookie(secret: Option<&str>, tls: bool) -> String {
    let secure = if tls { "; Secure" } else { "" };
    match secret {
        Some(secret) => format!(
            "{COOKIE}={secret}; Path=/; HttpOnly; SameSite=Strict; Max-Age={}{secure}",
            VALID_MS / 1000
        ),
        None => format!("{COOKIE}=; Path=/; HttpOnly; SameSite=Strict; Max-Age=0{secure}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use axum::http::HeaderValue;

    #[test]
    fn val_the_secret_is_found_among_other_cookies() {
        let mut headers = HeaderMap::new();
        assert_eq!(secret(&headers), None);
        headers.append(header::COOKIE, HeaderValue::from_static("a=b; rotortwin_session=; x"));
        assert_eq!(secret(&headers), None);
        headers.append(header::COOKIE, HeaderValue::from_static("c=d; rotortwin_session=feed"));
        assert_eq!(secret(&headers), Some("feed"));
    }

    #[test]
    fn val_no_script_and_no_other_site_gets_the_cookie() {
        for (tls, secure) in [(true, true), (false, false)] {
            let text = cookie(Some("feed"), tls);
            assert!(text.contains("HttpOnly") && text.contains("SameSite=Strict"), "{text}");
            assert_eq!(text.contains("Secure"), secure, "{text}");
        }
        assert!(cookie(None, true).contains("Max-Age=0"));
    }
}
