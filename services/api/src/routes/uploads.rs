//! A file in the body of a request: within its limit, to disk, and rejected in such a way that the client gets the
//! reason.

use crate::problem::Problem;
use axum::body::{Body, HttpBody as _};
use futures_util::StreamExt as _;
use std::time::Duration;
use tokio::io::AsyncWriteExt as _;

/// After a rejection the rest of a body is received for this long: a browser that cannot send it reads no answer.
const DRAIN: Duration = Duration::from_secs(120);

/// What is taken, and the sentences of the refusals.
pub(super) struct Upload<'a> {
    /// Bytes.
    pub(super) most: u64,
    /// It has more.
    pub(super) too_large: &'a str,
    /// How it begins to be said that it did not come whole.
    pub(super) broken: &'a str,
    /// The disk is full.
    pub(super) full: &'a str,
}

impl Upload<'_> {
    /// Writes a body to a file, passes each piece to `seen`, and returns its length in bytes.
    ///
    /// # Errors
    /// 413, immediately if the length was announced; 400: it broke off; 507; 500.
    pub(super) async fn write(
        &self,
        body: Body,
        file: std::io::Result<tokio::fs::File>,
        mut seen: impl FnMut(&[u8]),
    ) -> Result<u64, Problem> {
        let too_large = || Problem::too_large(self.too_large);
        if body.size_hint().lower() > self.most {
            return Err(too_large());
        }
        let mut stream = body.into_data_stream();
        let mut size = 0_u64;
        let written: Result<(), Problem> = async {
            let io = |error: std::io::Error| Problem::unwritten(&error, self.full);
            let mut file = file.map_err(io)?;
            while let Some(bytes) = stream.next().await {
                let bytes = bytes.map_err(|error| Problem::bad_request(format!("{}: {error}", self.broken)))?;
                size += bytes.len() as u64;
                if size > self.most {
                    return Err(too_large());
                }
                seen(&bytes);
                file.write_all(&bytes).await.map_err(io)?;
            }
            file.flush().await.map_err(io)
        }
        .await;
        let Err(problem) = written else { return Ok(size) };
        let rest = async {
            while let Some(Ok(bytes)) = stream.next().await {
                size += bytes.len() as u64;
                if size > self.most {
                    break;
                }
            }
        };
        if tokio::time::timeout(DRAIN, rest).await.is_err() {
            tracing::debug!("a rejected client keeps sending for too long");
        }
        Err(problem)
    }
}
