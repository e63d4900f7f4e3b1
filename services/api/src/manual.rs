//! The page that describes the API and tries it: Swagger UI, at `/api/v1/docs/`.

use crate::App;
use crate::embedded::Embedded;
use crate::problem::Problem;
use axum::Router;
use axum::body::Bytes;
use axum::extract::Path;
use axum::http::HeaderMap;
use axum::response::{Redirect, Response};
use axum::routing::get;
use std::borrow::Cow;
use std::collections::HashMap;
use std::sync::{Arc, LazyLock};
use utoipa_swagger_ui::Config;

const ADDRESS: &str = "/api/v1/docs";
const INDEX: &str = "index.html";

/// What its document loads. The same scripts for other kinds of loading, which the library has too, are left out.
const NAMES: [&str; 10] = [
    INDEX,
    "index.css",
    "swagger-ui.css",
    "swagger-ui-bundle.js",
    "swagger-ui-standalone-preset.js",
    "swagger-initializer.js",
    "oauth2-redirect.html",
    "oauth2-redirect.js",
    "favicon-16x16.png",
    "favicon-32x32.png",
];

/// Its files by their names.
static FILES: LazyLock<HashMap<&str, Embedded>> = LazyLock::new(|| {
    let config = Arc::new(Config::new(["/api/v1/openapi.json"]));
    let files = NAMES.iter().filter_map(|name| {
        let file = utoipa_swagger_ui::serve(name, Arc::clone(&config)).ok().flatten()?;
        let bytes = match file.bytes {
            Cow::Borrowed(bytes) => Bytes::from_static(bytes),
            Cow::Owned(bytes) => bytes.into(),
        };
        let embedded = if file.gzpipped {
            Embedded::compressed(bytes, &file.content_type)
        } else {
            Embedded::plain(bytes, &file.content_type)
        };
        Some((*name, embedded))
    });
    files.collect()
});

pub(crate) fn routes() -> Router<Arc<App>> {
    Router::new()
        .route(ADDRESS, get(|| async { Redirect::to("/api/v1/docs/") }))
        .route(
            "/api/v1/docs/",
            get(|headers: HeaderMap| async move { file(INDEX, &headers) }),
        )
        .route(
            "/api/v1/docs/{*name}",
            get(|Path(name): Path<String>, headers: HeaderMap| async move { file(&name, &headers) }),
        )
}

fn file(name: &str, asked: &HeaderMap) -> Result<Response, Problem> {
    let file = FILES
        .get(name)
        .ok_or_else(|| Problem::not_found(format!("nothing is served at {ADDRESS}/{name}; {ADDRESS}/ is the page")))?;
    file.answer(asked, "no-cache")
        .map_err(|error| Problem::internal(&error))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_the_library_has_every_file_and_the_document_loads_no_other() {
        for name in NAMES {
            let content = FILES.get(name).unwrap_or_else(|| panic!("{name}")).content();
            assert!(!content.expect("it is whole").is_empty(), "{name}");
        }
        let document = FILES[INDEX].content().expect("it is whole");
        let text = String::from_utf8_lossy(&document).into_owned();
        let named = text.split(['"', '\'']).filter_map(|word| word.strip_prefix("./"));
        let named: Vec<&str> = named.chain(["index.css"]).collect();
        assert!(named.len() > 5, "{text}");
        for name in named {
            assert!(FILES.contains_key(name), "{name}");
        }
        let settings = FILES["swagger-initializer.js"].content().expect("it is whole");
        assert!(String::from_utf8_lossy(&settings).contains("/api/v1/openapi.json"));
    }

    #[test]
    fn val_an_unknown_file_is_a_problem() {
        assert!(file("none.js", &HeaderMap::new()).is_err());
    }
}
