//! The addresses of a kind of document in the library: list, get, put, delete. Written once, described for each.

/// Makes a module with the addresses of one kind of document.
macro_rules! documents {
    ($module:ident, $kind:expr, $word:literal, $all:literal, $one:literal) => {
        pub(crate) mod $module {
            use crate::App;
            use crate::access::Caller;
            use crate::library::DocumentKind;
            use crate::problem::Problem;
            use crate::routes::jobs::Shared;
            use crate::routes::library::{self, Names, StoredDocument};
            use axum::Json;
            use axum::extract::Path;
            use axum::extract::rejection::{PathRejection, StringRejection};
            use axum::http::{HeaderMap, StatusCode};
            use axum::response::Response;
            use std::sync::Arc;
            use utoipa_axum::router::OpenApiRouter;
            use utoipa_axum::routes;

            const KIND: DocumentKind = $kind;

            /// All of them.
            pub(crate) fn routes() -> OpenApiRouter<Arc<App>> {
                OpenApiRouter::new().routes(routes!(list)).routes(routes!(get, put, delete))
            }

            #[doc = concat!("Names of every ", $word, ".")]
            #[utoipa::path(get, path = $all, summary = concat!("Names of every ", $word, "."), tag = "library", operation_id = concat!("list_", stringify!($module)), responses(
                (status = 200, description = "names", body = Names)
            ))]
            pub(crate) async fn list(app: Shared, caller: Caller) -> Result<Json<Names>, Problem> {
                library::list(&app, &caller, KIND).await.map(Json)
            }

            #[doc = concat!("The text of a ", $word, ".")]
            #[utoipa::path(get, path = $one, summary = concat!("The text of a ", $word, "."), tag = "library", operation_id = concat!("get_", stringify!($module)), params(("name" = String, Path)), responses(
                (status = 200, description = "TOML", body = String, content_type = "application/toml", headers(("ETag" = String, description = "changes with the text"))),
                (status = 400, description = "no name", body = Problem, content_type = "application/problem+json"),
                (status = 404, description = "there is none", body = Problem, content_type = "application/problem+json")
            ))]
            pub(crate) async fn get(
                app: Shared,
                caller: Caller,
                name: Result<Path<String>, PathRejection>,
            ) -> Result<Response, Problem> {
                let Path(name) = name?;
                library::get(&app, &caller, KIND, &name).await
            }

            #[doc = concat!("Leaves a ", $word, " in the library, on one's own account.")]
            ///
            /// It is checked as if it stood there already. One's own hides the server's of the same name. `If-None-Match: *` only creates,
            /// `If-Match: ETAG` only replaces what one has seen.
            #[utoipa::path(put, path = $one, summary = concat!("Leaves a ", $word, " in the library, on one's own account."), tag = "library", operation_id = concat!("put_", stringify!($module)),
                params(("name" = String, Path), ("If-Match" = Option<String>, Header), ("If-None-Match" = Option<String>, Header)),
                request_body(content = String, content_type = "application/toml"), responses(
                (status = 201, description = "created", body = StoredDocument, headers(("Location" = String, description = "its address"), ("ETag" = String, description = "changes with the text"))),
                (status = 200, description = "replaced", body = StoredDocument, headers(("ETag" = String, description = "changes with the text"))),
                (status = 400, description = "no name, or no text", body = Problem, content_type = "application/problem+json"),
                (status = 412, description = "it is not as `If-Match` or `If-None-Match` expect", body = Problem, content_type = "application/problem+json"),
                (status = 413, description = "too large", body = Problem, content_type = "application/problem+json"),
                (status = 422, description = "it is refused: `complaints` lists all that is wrong", body = Problem, content_type = "application/problem+json"),
                (status = 507, description = "the disk is full, or there are too many", body = Problem, content_type = "application/problem+json")
            ))]
            pub(crate) async fn put(
                app: Shared,
                caller: Caller,
                name: Result<Path<String>, PathRejection>,
                headers: HeaderMap,
                text: Result<String, StringRejection>,
            ) -> Result<Response, Problem> {
                let Path(name) = name?;
                library::put(&app, &caller, KIND, &name, &headers, &text?).await
            }

            #[doc = concat!("Takes a ", $word, " of one's own out of the library.")]
            #[utoipa::path(delete, path = $one, summary = concat!("Takes a ", $word, " of one's own out of the library."), tag = "library", operation_id = concat!("delete_", stringify!($module)), params(("name" = String, Path)), responses(
                (status = 204, description = "deleted"),
                (status = 400, description = "no name", body = Problem, content_type = "application/problem+json"),
                (status = 404, description = "there is none of one's own", body = Problem, content_type = "application/problem+json")
            ))]
            pub(crate) async fn delete(
                app: Shared,
                caller: Caller,
                name: Result<Path<String>, PathRejection>,
            ) -> Result<StatusCode, Problem> {
                let Path(name) = name?;
                library::delete(&app, &caller, KIND, &name).await
            }
        }
    };
}

pub(crate) use documents;
