//! The content hash of documents and logs.

/// XXH3-128 as 32 hexadecimal digits: the content hash of every document and log of this project.
pub fn content_hash(bytes: &[u8]) -> String {
    format!("{:032x}", xxhash_rust::xxh3::xxh3_128(bytes))
}
