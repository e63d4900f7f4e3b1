//! Lists, states, events and files of jobs other than runs: the same for every kind. The submission, which differs, has
//! a file of its own.

/// Makes the routes of a kind of jobs.
macro_rules! collection {
    ($module:ident, $kind:expr, $result:ident, $word:literal, $all:literal, $one:literal, $cancel:literal, $events:literal, $files:literal, $file:literal) => {
        pub(crate) mod $module {
            use crate::App;
            use crate::access::Caller;
            use crate::problem::Problem;
            use crate::routes::jobs::{self, JobPage, JobView, ListQuery, Shared};
            use crate::routes::results::{$result, JobWithResult};
            use crate::routes::{artifacts, events};
            use axum::Json;
            use axum::extract::rejection::{PathRejection, QueryRejection};
            use axum::extract::{Path, Query, Request};
            use axum::http::{HeaderMap, StatusCode};
            use axum::response::Response;
            use rotortwin_jobs::JobKind;
            use std::sync::Arc;
            use utoipa_axum::router::OpenApiRouter;
            use utoipa_axum::routes;

            const KIND: JobKind = $kind;

            /// All of them but the submission.
            pub(crate) fn routes() -> OpenApiRouter<Arc<App>> {
                OpenApiRouter::new()
                    .routes(routes!(list))
                    .routes(routes!(get, delete))
                    .routes(routes!(cancel))
                    .routes(routes!(events))
                    .routes(routes!(files))
                    .routes(routes!(file))
            }

            #[doc = concat!("Every ", $word, ", latest first.")]
            #[utoipa::path(get, path = $all, summary = concat!("Every ", $word, ", latest first."), tag = stringify!($module), operation_id = concat!("list_", stringify!($module)), params(ListQuery), responses(
                (status = 200, description = "one page of the list", body = JobPage),
                (status = 400, description = "invalid filter", body = Problem, content_type = "application/problem+json")
            ))]
            pub(crate) async fn list(
                app: Shared,
                caller: Caller,
                query: Result<Query<ListQuery>, QueryRejection>,
            ) -> Result<Json<JobPage>, Problem> {
                jobs::page_of_views(&app, &caller, KIND, query).await
            }

            #[doc = concat!("One ", $word, " with its result.")]
            #[utoipa::path(get, path = $one, summary = concat!("One ", $word, " with its result."), tag = stringify!($module), operation_id = concat!("get_", stringify!($module)), params(("id" = String, Path)), responses(
                (status = 200, description = "the job", body = JobWithResult<$result>),
                (status = 400, description = "invalid id", body = Problem, content_type = "application/problem+json"),
                (status = 404, description = "not found", body = Problem, content_type = "application/problem+json")
            ))]
            pub(crate) async fn get(
                app: Shared,
                caller: Caller,
                id: Result<Path<String>, PathRejection>,
            ) -> Result<Json<JobView>, Problem> {
                Ok(Json(jobs::find(&app, &caller, KIND, id).await?.into()))
            }

            /// Cancels it: a queued job at once with its parts, a running one within about a second.
            #[utoipa::path(post, path = $cancel, tag = stringify!($module), operation_id = concat!("cancel_", stringify!($module)), params(("id" = String, Path)), responses(
                (status = 202, description = "the job is being stopped", body = JobView),
                (status = 400, description = "invalid id", body = Problem, content_type = "application/problem+json"),
                (status = 404, description = "not found", body = Problem, content_type = "application/problem+json"),
                (status = 409, description = "the job has already ended", body = Problem, content_type = "application/problem+json"),
                (status = 507, description = "disk full", body = Problem, content_type = "application/problem+json")
            ))]
            pub(crate) async fn cancel(
                app: Shared,
                caller: Caller,
                id: Result<Path<String>, PathRejection>,
            ) -> Result<(StatusCode, Json<JobView>), Problem> {
                let job = jobs::find(&app, &caller, KIND, id).await?;
                Ok((StatusCode::ACCEPTED, Json(jobs::cancel(&app, &job).await?.into())))
            }

            /// Deletes it once it has ended, with its parts and files.
            #[utoipa::path(delete, path = $one, tag = stringify!($module), operation_id = concat!("delete_", stringify!($module)), params(("id" = String, Path)), responses(
                (status = 204, description = "deleted"),
                (status = 400, description = "invalid id", body = Problem, content_type = "application/problem+json"),
                (status = 404, description = "not found", body = Problem, content_type = "application/problem+json"),
                (status = 409, description = "the job has not ended, or a queued or running job needs its files", body = Problem, content_type = "application/problem+json"),
                (status = 507, description = "disk full", body = Problem, content_type = "application/problem+json")
            ))]
            pub(crate) async fn delete(
                app: Shared,
                caller: Caller,
                id: Result<Path<String>, PathRejection>,
            ) -> Result<StatusCode, Problem> {
                let job = jobs::find(&app, &caller, KIND, id).await?;
                jobs::delete(&app, &job).await
            }

            /// All its events (server-sent), from the first or after `Last-Event-ID`, without gaps; ends after `ended`.
            #[utoipa::path(get, path = $events, tag = stringify!($module), operation_id = concat!("events_of_", stringify!($module)),
                params(("id" = String, Path), ("Last-Event-ID" = Option<u64>, Header, description = "number of the last event received")), responses(
                (status = 200, description = "stream of events", body = events::StreamEvent, content_type = "text/event-stream"),
                (status = 400, description = "Last-Event-ID is not a number", body = Problem, content_type = "application/problem+json"),
                (status = 404, description = "not found", body = Problem, content_type = "application/problem+json")
            ))]
            pub(crate) async fn events(
                app: Shared,
                caller: Caller,
                id: Result<Path<String>, PathRejection>,
                headers: HeaderMap,
            ) -> Result<Response, Problem> {
                let job = jobs::find(&app, &caller, KIND, id).await?;
                events::of(&app, &job, &headers)
            }

            /// Lists its files.
            #[utoipa::path(get, path = $files, tag = stringify!($module), operation_id = concat!("files_of_", stringify!($module)), params(("id" = String, Path)), responses(
                (status = 200, description = "its files; none until the job has ended", body = artifacts::Artifacts),
                (status = 400, description = "invalid id", body = Problem, content_type = "application/problem+json"),
                (status = 404, description = "not found", body = Problem, content_type = "application/problem+json")
            ))]
            pub(crate) async fn files(
                app: Shared,
                caller: Caller,
                id: Result<Path<String>, PathRejection>,
            ) -> Result<Json<artifacts::Artifacts>, Problem> {
                let job = jobs::find(&app, &caller, KIND, id).await?;
                artifacts::of(&app, &job).await
            }

            /// Downloads a file; with ETag, conditional and range requests.
            #[utoipa::path(get, path = $file, tag = stringify!($module), operation_id = concat!("file_of_", stringify!($module)),
                params(("id" = String, Path), ("path" = String, Path, description = "path of the file, such as report.html")), responses(
                (status = 200, description = "the file", body = serde_json::Value, content_type = "*/*"),
                (status = 206, description = "the requested range", body = serde_json::Value, content_type = "*/*"),
                (status = 304, description = "not modified"),
                (status = 400, description = "invalid path", body = Problem, content_type = "application/problem+json"),
                (status = 404, description = "job or file not found", body = Problem, content_type = "application/problem+json"),
                (status = 412, description = "`If-Match` or `If-Unmodified-Since` does not hold", body = Problem, content_type = "application/problem+json"),
                (status = 416, description = "range not satisfiable", body = Problem, content_type = "application/problem+json")
            ))]
            pub(crate) async fn file(
                app: Shared,
                caller: Caller,
                path: Result<Path<(String, String)>, PathRejection>,
                request: Request,
            ) -> Result<Response, Problem> {
                let Path((id, name)) = path?;
                let job = jobs::find(&app, &caller, KIND, Ok(Path(id))).await?;
                artifacts::one(&app, &job, &name, request).await
            }
        }
    };
}
pub(crate) use collection;
