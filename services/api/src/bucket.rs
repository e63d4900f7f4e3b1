//! An S3-compatible object store, shared by several hosts.
//!
//! The credentials are in the environment: `AWS_ACCESS_KEY_ID`, `AWS_SECRET_ACCESS_KEY`, `AWS_REGION`, `AWS_ENDPOINT`, `AWS_ALLOW_HTTP`.
//! A request without a response is retried for as long as the library does (three minutes); then the error names the store.

use futures_util::StreamExt as _;
use object_store::aws::AmazonS3Builder;
use object_store::path::Path as Key;
use object_store::{ObjectStore, ObjectStoreExt as _, PutMode, PutOptions, PutPayload};
use std::io;
use std::path::Path;
use std::sync::Arc;
use tokio::io::AsyncWriteExt as _;

/// Larger files are uploaded in parts of this size.
const PART: usize = 8 << 20;

/// Objects fetched concurrently.
const AT_ONCE: usize = 16;

/// A bucket, below a prefix.
#[derive(Debug, Clone)]
pub struct Bucket {
    store: Arc<dyn ObjectStore>,
    prefix: String,
}

/// A file below a folder or a key.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct File {
    /// Path below it.
    pub(crate) path: String,
    /// Bytes.
    pub(crate) size: u64,
}

impl Bucket {
    /// `address`: `s3://BUCKET[/PREFIX]`.
    ///
    /// # Errors
    /// The message begins with the address.
    pub fn open(address: &str) -> Result<Self, String> {
        let rest = address
            .strip_prefix("s3://")
            .filter(|rest| !rest.is_empty() && !rest.starts_with('/'))
            .ok_or_else(|| format!("{address}: expected s3://BUCKET or s3://BUCKET/PREFIX"))?;
        let (name, prefix) = rest.split_once('/').unwrap_or((rest, ""));
        let store = AmazonS3Builder::from_env()
            .with_bucket_name(name)
            .build()
            .map_err(|error| format!("{address}: {error}"))?;
        Ok(Self {
            store: Arc::new(store),
            prefix: prefix.trim_matches('/').to_owned(),
        })
    }

    fn key(&self, key: &str) -> Key {
        Key::from(format!("{}/{key}", self.prefix))
    }

    /// Uploads a file to a key, in parts if it is large.
    pub(crate) async fn upload(&self, key: &str, path: &Path) -> io::Result<()> {
        let size = tokio::fs::metadata(path).await?.len();
        let key = self.key(key);
        if size <= PART as u64 {
            let bytes = tokio::fs::read(path).await?;
            self.store
                .put(&key, PutPayload::from(bytes))
                .await
                .map_err(io::Error::other)?;
            return Ok(());
        }
        let mut file = tokio::fs::File::open(path).await?;
        let mut writer = object_store::buffered::BufWriter::with_capacity(Arc::clone(&self.store), key, PART);
        tokio::io::copy(&mut file, &mut writer).await?;
        writer.shutdown().await
    }

    /// Downloads an object to a file; `false` if it does not exist.
    pub(crate) async fn download(&self, key: &str, path: &Path) -> io::Result<bool> {
        let answer = match self.store.get(&self.key(key)).await {
            Ok(answer) => answer,
            Err(object_store::Error::NotFound { .. }) => return Ok(false),
            Err(error) => return Err(io::Error::other(error)),
        };
        let folder = path.parent().unwrap_or(path);
        tokio::fs::create_dir_all(folder).await?;
        // To a temporary file first: no partial file is ever visible.
        let beside = folder.join(format!(".{}", crate::jobs::queue::new_id()));
        let mut file = tokio::fs::File::create(&beside).await?;
        let mut stream = answer.into_stream();
        while let Some(bytes) = stream.next().await {
            file.write_all(&bytes.map_err(io::Error::other)?).await?;
        }
        file.flush().await?;
        tokio::fs::rename(&beside, path).await?;
        Ok(true)
    }

    /// Names of all objects, in order.
    ///
    /// # Errors
    /// The store does not answer.
    pub async fn names(&self) -> io::Result<Vec<String>> {
        let files = self.list("").await?;
        Ok(files.into_iter().map(|file| file.path).collect())
    }

    /// All objects below a key, in order.
    pub(crate) async fn list(&self, key: &str) -> io::Result<Vec<File>> {
        let prefix = self.key(key);
        let mut stream = self.store.list(Some(&prefix));
        let mut files = Vec::new();
        while let Some(entry) = stream.next().await {
            let entry = entry.map_err(io::Error::other)?;
            let path = entry.location.as_ref();
            let relative = path
                .strip_prefix(prefix.as_ref())
                .unwrap_or(path)
                .trim_start_matches('/');
            files.push(File {
                path: relative.to_owned(),
                size: entry.size,
            });
        }
        files.sort_by(|a, b| a.path.cmp(&b.path));
        Ok(files)
    }

    /// Whether an object with this key exists.
    ///
    /// # Errors
    /// The store does not answer.
    pub async fn has(&self, key: &str) -> io::Result<bool> {
        match self.store.head(&self.key(key)).await {
            Ok(_) => Ok(true),
            Err(object_store::Error::NotFound { .. }) => Ok(false),
            Err(error) => Err(io::Error::other(error)),
        }
    }

    pub(crate) async fn delete(&self, key: &str) -> io::Result<()> {
        self.store.delete(&self.key(key)).await.map_err(io::Error::other)
    }

    /// The content of an object; `None` if it does not exist.
    ///
    /// # Errors
    /// The store does not answer.
    pub async fn read(&self, key: &str) -> io::Result<Option<Vec<u8>>> {
        let answer = match self.store.get(&self.key(key)).await {
            Ok(answer) => answer,
            Err(object_store::Error::NotFound { .. }) => return Ok(None),
            Err(error) => return Err(io::Error::other(error)),
        };
        let bytes = answer.bytes().await.map_err(io::Error::other)?;
        Ok(Some(bytes.into()))
    }

    /// Creates an object unless it exists; otherwise leaves it unchanged, and returns its content.
    ///
    /// # Errors
    /// The store does not respond, or does not support conditional writes.
    pub async fn create(&self, key: &str, content: Vec<u8>) -> io::Result<Option<Vec<u8>>> {
        let once = PutOptions::from(PutMode::Create);
        match self
            .store
            .put_opts(&self.key(key), PutPayload::from(content), once)
            .await
        {
            Ok(_) => Ok(None),
            Err(object_store::Error::AlreadyExists { .. } | object_store::Error::Precondition { .. }) => {
                let there = self.read(key).await?;
                there
                    .map(Some)
                    .ok_or_else(|| io::Error::other(format!("{key} was there, and is gone")))
            }
            Err(error) => Err(io::Error::other(error)),
        }
    }

    /// Passes the content of objects to `take`, fetched concurrently, in any order.
    ///
    /// # Errors
    /// The store does not respond, an object is gone, or `take` fails.
    pub async fn read_all<T, E: From<io::Error>>(
        &self,
        keys: impl IntoIterator<Item = (String, T)>,
        mut take: impl FnMut(T, Vec<u8>) -> Result<(), E>,
    ) -> Result<(), E> {
        let fetched = keys.into_iter().map(|(key, mark)| async move {
            let bytes = self.read(&key).await?;
            let bytes = bytes.ok_or_else(|| io::Error::other(format!("{key} was there, and is gone")))?;
            Ok::<_, io::Error>((mark, bytes))
        });
        let mut fetched = futures_util::stream::iter(fetched).buffer_unordered(AT_ONCE);
        while let Some(one) = fetched.next().await {
            let (mark, bytes) = one?;
            take(mark, bytes)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_addresses() {
        for bad in ["s3://", "s3:///x", "http://x", "bucket"] {
            assert!(Bucket::open(bad).is_err(), "{bad}");
        }
    }
}
