//! Lists, states, events and files of jobs that are no runs: the same for every kind. What is particular, the submission, has a file of its
//! own.

/// Makes the routes of a kind of jobs.
macro_rules! collection {
    ($module:ident, $kind:expr, $result:ident, $word:literal, $all:literal, $one:literal, $cancel:literal, $events:literal, $files:literal, $file:literal) => {
        pub(crate) mod $module {
            use crate::App;
            use crate::access::Caller;
            use crate::jobs::JobKind;
            use crate::problem::Problem;
            use crate::routes::jobs::{self, JobPage, JobView, ListQuery, Shared};
            use crate::routes::results::{$result, JobWithResult};
            use crate::routes::{artifacts, events};
            use axum::Json;
            use axum::extract::rejection::{PathRejection, QueryRejection};
            use axum::extract::{Path, Query, Request};
            use axum::http::{HeaderMap, StatusCode};
            use axum::response::Response;
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
                (status = 200, description = "a page", body = JobPage),
                (status = 400, description = "a filter that is none", body = Problem, content_type = "application/problem+json")
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
                (status = 200, description = "its state", body = JobWithResult<$result>),
                (status = 400, description = "no id", body = Problem, content_type = "application/problem+json"),
                (status = 404, description = "there is none", body = Problem, content_type = "application/problem+json")
            ))]
            pub(crate) async fn get(
                app: Shared,
                caller: Caller,
                id: Result<Path<String>, PathRejection>,
            ) -> Result<Json<JobView>, Problem> {
                Ok(Json(jobs::find(&app, &caller, KIND, id).await?.into()))
            }

            /// Stops it: a queued one at once with its parts, a running one within about a second.
            #[utoipa::path(post, path = $cancel, tag = stringify!($module), operation_id = concat!("cancel_", stringify!($module)), params(("id" = String, Path)), responses(
                (status = 202, description = "it ends", body = JobView),
                (status = 400, description = "no id", body = Problem, content_type = "application/problem+json"),
                (status = 404, description = "there is none", body = Problem, content_type = "application/problem+json"),
                (status = 409, description = "it has ended already", body = Problem, content_type = "application/problem+json"),
                (status = 507, description = "the disk is full", body = Problem, content_type = "application/problem+json")
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
                (status = 400, description = "no id", body = Problem, content_type = "application/problem+json"),
                (status = 404, description = "there is none", body = Problem, content_type = "application/problem+json"),
                (status = 409, description = "it has not ended, or a job that waits or runs needs it", body = Problem, content_type = "application/problem+json"),
                (status = 507, description = "the disk is full", body = Problem, content_type = "application/problem+json")
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
                params(("id" = String, Path), ("Last-Event-ID" = Option<u64>, Header, description = "number of the last event that was seen")), responses(
                (status = 200, description = "a stream", body = events::StreamEvent, content_type = "text/event-stream"),
                (status = 400, description = "Last-Event-ID is no number", body = Problem, content_type = "application/problem+json"),
                (status = 404, description = "there is none", body = Problem, content_type = "application/problem+json")
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

            /// What files it has left.
            #[utoipa::path(get, path = $files, tag = stringify!($module), operation_id = concat!("files_of_", stringify!($module)), params(("id" = String, Path)), responses(
                (status = 200, description = "its files; none before it has ended", body = artifacts::Artifacts),
                (status = 400, description = "no id", body = Problem, content_type = "application/problem+json"),
                (status = 404, description = "there is none", body = Problem, content_type = "application/problem+json")
            ))]
            pub(crate) async fn files(
                app: Shared,
                caller: Caller,
                id: Result<Path<String>, PathRejection>,
            ) -> Result<Json<artifacts::Artifacts>, Problem> {
                let job = jobs::find(&app, &caller, KIND, id).await?;
                artifacts::of(&app, &job).await
            }

            /// A file; with ETag, conditional and range requests.
            #[utoipa::path(get, path = $file, tag = stringify!($module), operation_id = concat!("file_of_", stringify!($module)),
                params(("id" = String, Path), ("path" = String, Path, description = "path of the file, such as report.html")), responses(
                (status = 200, description = "the file", body = serde_json::Value, content_type = "*/*"),
                (status = 206, description = "the range", body = serde_json::Value, content_type = "*/*"),
                (status = 304, description = "unchanged"),
                (status = 400, description = "no path", body = Problem, content_type = "application/problem+json"),
                (status = 404, description = "no such job or file", body = Problem, content_type = "application/problem+json"),
                (status = 416, description = "range not satisfiable")
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
