//! Files that are embedded compressed: sent as they are to clients that accept gzip, and inflated for others.

use axum::body::Bytes;
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse as _, Response};
use flate2::read::GzDecoder;
use std::io::Read as _;
use std::sync::OnceLock;

/// A file of this program.
pub(crate) struct Embedded {
    gzip: Option<Bytes>,
    /// Inflated when it is first needed, then kept: all files together have a few megabytes, whoever asks and however often.
    plain: OnceLock<Bytes>,
    kind: String,
    tag: String,
}

impl Embedded {
    /// A file of which the program has the gzip stream.
    pub(crate) fn compressed(gzip: Bytes, kind: &str) -> Self {
        Self {
            kind: kind.to_owned(),
            tag: tag(&gzip),
            plain: OnceLock::new(),
            gzip: Some(gzip),
        }
    }

    /// A file that is not compressed.
    pub(crate) fn plain(bytes: Bytes, kind: &str) -> Self {
        Self {
            kind: kind.to_owned(),
            tag: tag(&bytes),
            plain: OnceLock::from(bytes),
            gzip: None,
        }
    }

    /// Its content.
    ///
    /// # Errors
    /// The program is damaged.
    pub(crate) fn content(&self) -> std::io::Result<Bytes> {
        if let Some(plain) = self.plain.get() {
            return Ok(plain.clone());
        }
        let mut plain = Vec::new();
        if let Some(gzip) = &self.gzip {
            GzDecoder::new(&gzip[..]).read_to_end(&mut plain)?;
        }
        Ok(self.plain.get_or_init(|| plain.into()).clone())
    }

    /// Answers a request for it: 304 where the client has it.
    ///
    /// # Errors
    /// The program is damaged.
    pub(crate) fn answer(&self, asked: &HeaderMap, kept: &'static str) -> std::io::Result<Response> {
        let gzip = self.gzip.as_ref().filter(|_| accepts_gzip(asked));
        // A strong tag stands for the same bytes, so that of the compressed ones is weak.
        let tag = if gzip.is_some() {
            format!("W/{}", self.tag)
        } else {
            self.tag.clone()
        };
        let mut headers = HeaderMap::new();
        headers.insert(header::CACHE_CONTROL, HeaderValue::from_static(kept));
        headers.insert(header::VARY, HeaderValue::from_static("accept-encoding"));
        headers.insert(header::ETAG, text(&tag)?);
        let known = asked
            .get(header::IF_NONE_MATCH)
            .and_then(|value| value.to_str().ok())
            .is_some_and(|tags| has_tag(tags, &self.tag));
        if known {
            return Ok((StatusCode::NOT_MODIFIED, headers).into_response());
        }
        headers.insert(header::CONTENT_TYPE, text(&self.kind)?);
        let Some(gzip) = gzip else {
            return Ok((headers, self.content()?).into_response());
        };
        headers.insert(header::CONTENT_ENCODING, HeaderValue::from_static("gzip"));
        Ok((headers, gzip.clone()).into_response())
    }
}

fn tag(bytes: &[u8]) -> String {
    format!("\"{:032x}\"", xxhash_rust::xxh3::xxh3_128(bytes))
}

fn text(value: &str) -> std::io::Result<HeaderValue> {
    HeaderValue::from_str(value).map_err(std::io::Error::other)
}

fn has_tag(tags: &str, own: &str) -> bool {
    tags.split(',')
        .map(str::trim)
        .any(|tag| tag == "*" || tag.trim_start_matches("W/") == own)
}

/// By `Accept-Encoding` (RFC 9110, section 12.5.3): gzip is named, or `*` is and gzip is not, with a weight that is not zero. A client
/// that sends no such header gets the plain file.
fn accepts_gzip(asked: &HeaderMap) -> bool {
    let lines = asked.get_all(header::ACCEPT_ENCODING).iter();
    let mut of_any = false;
    for coding in lines
        .filter_map(|line| line.to_str().ok())
        .flat_map(|line| line.split(','))
    {
        let mut parts = coding.split(';').map(str::trim);
        let name = parts.next().unwrap_or_default().to_ascii_lowercase();
        let is_wanted = !parts.any(|part| {
            let weight = part.strip_prefix("q=").or_else(|| part.strip_prefix("Q="));
            weight.is_some_and(|weight| weight.trim().parse::<f32>().is_ok_and(|weight| weight <= 0.0))
        });
        match name.as_str() {
            "gzip" | "x-gzip" => return is_wanted,
            "*" => of_any = is_wanted,
            _ => {}
        }
    }
    of_any
}

#[cfg(test)]
mod tests {
    use super::*;
    use flate2::Compression;
    use flate2::read::GzEncoder;

    const TEXT: &[u8] = b"the same words, the same words, the same words";

    fn file() -> Embedded {
        let mut gzip = Vec::new();
        GzEncoder::new(TEXT, Compression::best())
            .read_to_end(&mut gzip)
            .expect("memory can be read");
        Embedded::compressed(gzip.into(), "text/plain")
    }

    fn headers(accepted: Option<&str>) -> HeaderMap {
        let line = accepted.map(|accepted| (header::ACCEPT_ENCODING, HeaderValue::from_str(accepted).expect("text")));
        line.into_iter().collect()
    }

    #[tokio::test]
    async fn val_who_accepts_gzip_gets_the_stream_and_others_the_file() {
        let file = file();
        for (accepted, is_gzip) in [
            (None, false),
            (Some("identity"), false),
            (Some("zstd, br"), false),
            (Some("gzip;q=0, *"), false),
            (Some("gzip; q=0.0"), false),
            (Some("*;q=0"), false),
            (Some("br;q=1, *"), true),
            (Some("gzip, deflate, br, zstd"), true),
            (Some("br, GZIP;q=0.5"), true),
        ] {
            let answer = file.answer(&headers(accepted), "no-cache").expect("it is whole");
            assert_eq!(
                answer.headers().contains_key(header::CONTENT_ENCODING),
                is_gzip,
                "{accepted:?}"
            );
            assert_eq!(answer.headers()[header::VARY], "accept-encoding");
            let tag = answer.headers()[header::ETAG].to_str().expect("text").to_owned();
            assert_eq!(tag.starts_with("W/"), is_gzip, "{tag}");
            let body = axum::body::to_bytes(answer.into_body(), usize::MAX)
                .await
                .expect("all of it");
            let plain = if is_gzip {
                let mut plain = Vec::new();
                GzDecoder::new(&body[..]).read_to_end(&mut plain).expect("gzip");
                plain
            } else {
                body.to_vec()
            };
            assert_eq!(plain, TEXT, "{accepted:?}");
        }
    }

    #[test]
    fn val_a_damaged_stream_is_an_error() {
        let whole = file().gzip.expect("it is compressed");
        let damaged = Embedded::compressed(whole.slice(..whole.len() - 1), "text/plain");
        assert!(damaged.content().is_err());
        assert!(damaged.answer(&headers(None), "no-cache").is_err());
    }
}
