//! The page: `web/dist`, compressed and embedded when the server was built.
//!
//! | Address | Content | Browser caching |
//! |---|---|---|
//! | `/`, and every other address outside the API | `index.html`, whose script interprets the rest of the address | revalidated by ETag |
//! | `/assets/NAME` | that file: its name contains a hash of its content | permanent |
//! | any other file of the bundle | that file | revalidated by ETag |
//!
//! It reveals no user data and needs no token: a page that cannot be loaded could not ask for one.

use crate::embedded::Embedded;
use crate::problem::Problem;
use axum::body::Bytes;
use axum::http::{HeaderMap, Method, Uri};
use axum::response::Response;
use include_dir::{Dir, include_dir};
use std::collections::HashMap;
use std::sync::LazyLock;

/// The bundle, which is committed, so that building the server only needs Rust; `build.rs` has compressed each file.
static BUNDLE: Dir<'_> = include_dir!("$OUT_DIR/web");

/// Its files by their addresses.
static BY_PATH: LazyLock<HashMap<String, Embedded>> = LazyLock::new(|| {
    let embedded = every_file(&BUNDLE).map(|file| {
        let path = format!("/{}", file.path().display());
        let file = Embedded::compressed(Bytes::from_static(file.contents()), content_type(&path));
        (path, file)
    });
    embedded.collect()
});

fn every_file<'a>(folder: &'a Dir<'a>) -> Box<dyn Iterator<Item = &'a include_dir::File<'a>> + 'a> {
    Box::new(folder.files().chain(folder.dirs().flat_map(every_file)))
}

/// The document of the page.
const INDEX: &str = "/index.html";
/// Files with a content hash in their names.
const ASSETS: &str = "/assets/";
/// Addresses that browsers request by themselves, which are not pages.
const NO_PAGES: &[&str] = &["/favicon.ico", "/robots.txt"];

fn content_type(path: &str) -> &'static str {
    match path.rsplit('.').next().unwrap_or_default() {
        "html" => "text/html; charset=utf-8",
        "js" | "mjs" => "text/javascript; charset=utf-8",
        "css" => "text/css; charset=utf-8",
        "json" | "map" => "application/json",
        "svg" => "image/svg+xml",
        "png" => "image/png",
        "ico" => "image/x-icon",
        "woff2" => "font/woff2",
        "wasm" => "application/wasm",
        "glb" => "model/gltf-binary",
        "txt" => "text/plain; charset=utf-8",
        _ => "application/octet-stream",
    }
}

/// Whether an address belongs to the page, which needs no token.
pub(crate) fn is_page(path: &str) -> bool {
    !(path == "/metrics" || path == "/api" || path.starts_with("/api/"))
}

/// Serves the page where the API serves nothing.
pub(crate) async fn page(method: Method, uri: Uri, headers: HeaderMap) -> Result<Response, Problem> {
    let path = uri.path();
    let reads = matches!(method, Method::GET | Method::HEAD);
    if !reads || !is_page(path) {
        return Err(nothing_at(path));
    }
    let file = match BY_PATH.get(path) {
        Some(file) => file,
        None if path.starts_with(ASSETS) || NO_PAGES.contains(&path) => return Err(nothing_at(path)),
        None => BY_PATH
            .get(INDEX)
            .ok_or_else(|| Problem::internal(&"the server was built without the web page"))?,
    };
    let kept = if path.starts_with(ASSETS) {
        "public, max-age=31536000, immutable"
    } else {
        "no-cache"
    };
    file.answer(&headers, kept).map_err(|error| Problem::internal(&error))
}

fn nothing_at(path: &str) -> Problem {
    Problem::not_found(format!(
        "nothing is served at {path}; /api/v1/openapi.json lists all routes"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use axum::http::{HeaderValue, header};
    use axum::response::IntoResponse as _;

    async fn ask(method: Method, path: &str, headers: &[(header::HeaderName, &str)]) -> Response {
        let mut map = HeaderMap::new();
        for (name, value) in headers {
            map.insert(name, HeaderValue::from_str(value).expect("a value"));
        }
        let uri = path.parse().expect("an address");
        page(method, uri, map).await.into_response()
    }

    #[tokio::test]
    async fn val_every_address_of_the_page_is_its_document() {
        for path in ["/", "/twin", "/runs/0190/live", "/models/f550.v2", "/index.html"] {
            let answer = ask(Method::GET, path, &[]).await;
            assert_eq!(answer.status(), 200, "{path}");
            assert_eq!(answer.headers()[header::CONTENT_TYPE], "text/html; charset=utf-8");
            assert_eq!(answer.headers()[header::CACHE_CONTROL], "no-cache");
            let tag = answer.headers()[header::ETAG].to_str().expect("text").to_owned();
            for known in [tag.clone(), format!("W/{tag}"), format!("\"x\", {tag}")] {
                let again = ask(Method::GET, path, &[(header::IF_NONE_MATCH, &known)]).await;
                assert_eq!(again.status(), 304, "{known}");
            }
            let other = ask(Method::GET, path, &[(header::IF_NONE_MATCH, "\"x\"")]).await;
            assert_eq!(other.status(), 200);
        }
    }

    #[tokio::test]
    async fn val_what_is_not_there_is_a_problem_and_no_page() {
        for path in [
            "/api",
            "/api/v1/nothing",
            "/metrics",
            "/assets/none.js",
            "/favicon.ico",
            "/robots.txt",
        ] {
            if BY_PATH.contains_key(path) {
                continue;
            }
            let answer = ask(Method::GET, path, &[]).await;
            assert_eq!(answer.status(), 404, "{path}");
            assert_eq!(answer.headers()[header::CONTENT_TYPE], "application/problem+json");
        }
        assert_eq!(ask(Method::POST, "/", &[]).await.status(), 404);
    }

    #[tokio::test]
    async fn val_assets_are_kept_for_good() {
        for (path, file) in BY_PATH.iter().filter(|(path, _)| path.starts_with(ASSETS)) {
            let answer = ask(Method::GET, path, &[]).await;
            assert_eq!(answer.status(), 200, "{path}");
            let kept = answer.headers()[header::CACHE_CONTROL].to_str().expect("text");
            assert!(kept.contains("immutable"), "{path}");
            assert!(!file.content().expect("it is whole").is_empty(), "{path}");
            assert_ne!(content_type(path), "application/octet-stream", "{path}");
        }
    }

    #[test]
    fn val_content_types() {
        for (path, expected) in [
            ("/assets/a-1.js", "text/javascript; charset=utf-8"),
            ("/a.css", "text/css; charset=utf-8"),
            ("/i.svg", "image/svg+xml"),
            ("/none", "application/octet-stream"),
        ] {
            assert_eq!(content_type(path), expected, "{path}");
        }
    }
}
