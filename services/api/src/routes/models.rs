//! Versioned models: history, additions, undo, branches, differences, exports. Versions are defined in
//! [`rotortwin_twin::model`].

use super::asked;
use super::documents::{checked_name, precondition};
use super::jobs::Shared;
use super::model_views::{AddedVersion, DifferenceView, ModelHistory, UndoneVersion, VersionView, label};
use super::tasks::done;
use crate::App;
use crate::access::Caller;
use crate::json_object::JsonObject;
use crate::library::own::Precondition;
use crate::library::versions::{Changed, StoredModel};
use crate::library::{DocumentKind, Library};
use crate::problem::Problem;
use axum::Json;
use axum::extract::rejection::{PathRejection, QueryRejection};
use axum::extract::{Path, Query};
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse as _, Response};
use rotortwin_jobs::JobKind;
use rotortwin_jobs::submission::ModelChoice;
use rotortwin_twin::improve::from_diagnosis;
use rotortwin_twin::model::store::{History, MAIN, version_number};
use rotortwin_twin::model::{ModelEffect, ModelStore, ModelVersion, Provenance};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use utoipa::{IntoParams, ToSchema};

/// A note is not longer, bytes.
const LONGEST_NOTE: usize = 1000;

/// A model to start.
#[derive(Debug, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct NewModel {
    /// Its name.
    #[schema(min_length = 1, max_length = 64, pattern = "^[a-z0-9][a-z0-9._-]*$")]
    name: String,
    /// A version file that becomes its version 0, whatever its number was elsewhere.
    model: ModelChoice,
}

/// What to add: the effects found by a diagnosis, its proposal, or one effect by hand.
#[derive(Debug, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct Addition {
    /// Branch to extend; default `main`.
    branch: Option<String>,
    /// Id of a diagnosis that was made on this model: adds all effects that it found.
    diagnosis: Option<String>,
    /// With `diagnosis`: only this effect, from 1.
    #[schema(minimum = 1)]
    pick: Option<usize>,
    /// With `diagnosis`: its proposal for an error that is not in the catalogue.
    #[serde(default)]
    proposal: bool,
    /// An effect by hand.
    effect: Option<HandEffect>,
    /// Reason, as a note for readers.
    #[serde(default)]
    #[schema(max_length = 1000)]
    note: String,
}

/// An effect with given values.
#[derive(Debug, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct HandEffect {
    /// Id in the catalogue, or of an effect document of the library.
    effect: String,
    /// Rotor, from 1, of an effect of one rotor.
    rotor: Option<usize>,
    /// Onset, s of the flight.
    onset_s: Option<f64>,
    /// Values by name, in the units of the catalogue.
    parameters: BTreeMap<String, f64>,
    /// Standard deviations by name.
    #[serde(default)]
    deviations: BTreeMap<String, f64>,
}

/// Branch to move back.
#[derive(Debug, Default, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct Undo {
    /// Default `main`.
    branch: Option<String>,
}

/// A branch to create.
#[derive(Debug, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct NewBranch {
    /// Its name: a valid document name that cannot be mistaken for a version.
    #[schema(min_length = 1, max_length = 64, pattern = "^[a-z0-9][a-z0-9._-]*$")]
    name: String,
    /// Where it begins: `v1`, or a branch; default `main`.
    at: Option<String>,
}

/// Which two versions.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(crate) struct Between {
    /// Before: `v0`, or a branch.
    from: String,
    /// After; `main` without it.
    to: Option<String>,
}

/// How a version is written.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(crate) struct VersionQuery {
    /// `toml`, the complete file, or `json`, a summary; default `toml`.
    #[param(inline)]
    format: Option<VersionFormat>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub(crate) enum VersionFormat {
    Toml,
    Json,
}

/// Starts a model: a vehicle, or a version exported elsewhere, becomes its version 0.
#[utoipa::path(post, path = "/api/v1/models", tag = "models", operation_id = "create_model", request_body = NewModel, responses(
    (status = 201, description = "created", body = ModelHistory, headers(("Location" = String, description = "URL of the history of the model"))),
    (status = 400, description = "malformed request, or invalid name", body = Problem, content_type = "application/problem+json"),
    (status = 404, description = "vehicle, model or improvement not found", body = Problem, content_type = "application/problem+json"),
    (status = 409, description = "a model with this name already exists, or the improvement is not done", body = Problem, content_type = "application/problem+json"),
    (status = 413, description = "request body too large", body = Problem, content_type = "application/problem+json"),
    (status = 422, description = "the document is not a valid model", body = Problem, content_type = "application/problem+json"),
    (status = 507, description = "disk full, or quota of documents exceeded", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn create(
    app: Shared,
    caller: Caller,
    body: Result<JsonObject<NewModel>, Problem>,
) -> Result<Response, Problem> {
    let JsonObject(body) = body?;
    let name = &body.name;
    checked_name(name)?;
    let mut version = asked::version(&app, &caller, &body.model).await?;
    version.name.clone_from(name);
    let taken = || Problem::conflict(format!("model '{name}' already exists; choose another name"));
    if app
        .database
        .has_document(&caller.tenant, DocumentKind::Model, name)
        .await?
    {
        return Err(taken());
    }
    app.readers.read(|| check(&version)).await?;
    match app.database.begin_model(&caller.tenant, name, &[&version]).await? {
        Changed::To(_) => {}
        Changed::Moved => return Err(taken()),
        Changed::Full => return Err(full(&caller)),
    }
    let base = Base::find(&app, &caller, name).await?;
    let location = format!("/api/v1/models/{name}/history");
    let history = ModelHistory::new(name, base.begun, &base.model)?;
    Ok((StatusCode::CREATED, [(header::LOCATION, location)], Json(history)).into_response())
}

/// All versions and branches of a model. A vehicle, or a single version in the library, is its own version 0.
#[utoipa::path(get, path = "/api/v1/models/{name}/history", tag = "models", operation_id = "model_history", params(("name" = String, Path)), responses(
    (status = 200, description = "oldest first", body = ModelHistory),
    (status = 400, description = "invalid name", body = Problem, content_type = "application/problem+json"),
    (status = 404, description = "not found", body = Problem, content_type = "application/problem+json"),
    (status = 422, description = "the document in the library is not a valid model", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn history(
    app: Shared,
    caller: Caller,
    name: Result<Path<String>, PathRejection>,
) -> Result<Json<ModelHistory>, Problem> {
    let Path(name) = name?;
    let base = Base::find(&app, &caller, &name).await?;
    ModelHistory::new(&name, base.begun, &base.model).map(Json)
}

/// Makes the next version of a model, with the findings of a diagnosis or with an effect added by hand.
///
/// For a vehicle of the library, this starts a model with its name. With `If-Match: "HASH"` of the base version, a concurrent
/// change is rejected with 412.
#[utoipa::path(post, path = "/api/v1/models/{name}/versions", tag = "models", operation_id = "add_to_model", request_body = Addition,
    params(("name" = String, Path), ("If-Match" = Option<String>, Header, description = "content hash of the head of the branch")), responses(
    (status = 201, description = "created", body = AddedVersion, headers(
        ("Location" = String, description = "URL of the version"), ("ETag" = String, description = "content hash"))),
    (status = 400, description = "malformed request", body = Problem, content_type = "application/problem+json"),
    (status = 404, description = "model, branch or diagnosis not found", body = Problem, content_type = "application/problem+json"),
    (status = 409, description = "the diagnosis is not done", body = Problem, content_type = "application/problem+json"),
    (status = 412, description = "the branch has moved to another version", body = Problem, content_type = "application/problem+json"),
    (status = 413, description = "request body too large", body = Problem, content_type = "application/problem+json"),
    (status = 422, description = "nothing to add: nothing was found, the model has it already, it was found on another model, or the values yield an invalid vehicle", body = Problem, content_type = "application/problem+json"),
    (status = 507, description = "disk full, or quota of documents exceeded", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn add(
    app: Shared,
    caller: Caller,
    name: Result<Path<String>, PathRejection>,
    headers: HeaderMap,
    body: Result<JsonObject<Addition>, Problem>,
) -> Result<Response, Problem> {
    let Path(name) = name?;
    let JsonObject(body) = body?;
    if body.note.len() > LONGEST_NOTE {
        return Err(Problem::unprocessable(format!(
            "`note` has {} bytes; expected at most {LONGEST_NOTE}",
            body.note.len()
        )));
    }
    let mut base = Base::find(&app, &caller, &name).await?;
    let branch = body.branch.clone().unwrap_or_else(|| MAIN.to_owned());
    let (stands_at, head) = base.head(&name, &branch)?;
    let head = head.clone();
    check_match(&headers, &name, &branch, &head)?;
    let effects = body.effects(&app, &caller, &base.line(stands_at)).await?;
    let library = app.library(&caller).await?;
    let next = effects.onto(&head, body.note);
    let checked = || {
        let next = with_documents_of(&library, next)?;
        check(&next).map(|()| next)
    };
    let next = app.readers.read(checked).await?;
    if head.has_all_of(&next) {
        return Err(Problem::unprocessable(format!(
            "{} has all of this already: nothing to add",
            label(&name, stands_at)
        )));
    }
    let changed = if base.begun {
        let database = &app.database;
        database
            .append_version(&caller.tenant, &name, &branch, stands_at, &next)
            .await?
    } else {
        checked_name(&name)?;
        app.database.begin_model(&caller.tenant, &name, &[&head, &next]).await?
    };
    let number = match changed {
        Changed::To(number) => number,
        Changed::Moved => return Err(moved(&name, &branch)),
        Changed::Full => return Err(full(&caller)),
    };
    let difference = DifferenceView::between((label(&name, stands_at), &head), (label(&name, number), &next));
    base.model.history.versions.insert(number, next);
    base.model.made_ms.insert(number, crate::clock::now_ms());
    let version = base.view(&name, number)?;
    let headers = [
        (header::LOCATION, format!("/api/v1/models/{name}/versions/v{number}")),
        (header::ETAG, format!("\"{}\"", version.hash)),
    ];
    let added = AddedVersion {
        model: name,
        branch,
        version,
        difference,
    };
    Ok((StatusCode::CREATED, headers, Json(added)).into_response())
}

/// Moves a branch back to the previous version. No version is deleted: a branch can be made at the one left behind.
#[utoipa::path(post, path = "/api/v1/models/{name}/undo", tag = "models", operation_id = "undo_model", request_body = Undo,
    params(("name" = String, Path), ("If-Match" = Option<String>, Header, description = "content hash of the head of the branch")), responses(
    (status = 200, description = "restored", body = UndoneVersion, headers(("ETag" = String, description = "content hash of its current version"))),
    (status = 400, description = "malformed request", body = Problem, content_type = "application/problem+json"),
    (status = 404, description = "model or branch not found", body = Problem, content_type = "application/problem+json"),
    (status = 409, description = "the branch is at its first version", body = Problem, content_type = "application/problem+json"),
    (status = 412, description = "the branch has moved to another version", body = Problem, content_type = "application/problem+json"),
    (status = 413, description = "request body too large", body = Problem, content_type = "application/problem+json"),
    (status = 422, description = "invalid body", body = Problem, content_type = "application/problem+json"),
    (status = 507, description = "disk full", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn undo(
    app: Shared,
    caller: Caller,
    name: Result<Path<String>, PathRejection>,
    headers: HeaderMap,
    body: Result<JsonObject<Undo>, Problem>,
) -> Result<Response, Problem> {
    let Path(name) = name?;
    let JsonObject(body) = body?;
    let base = Base::find(&app, &caller, &name).await?;
    let branch = body.branch.unwrap_or_else(|| MAIN.to_owned());
    let (left, head) = base.head(&name, &branch)?;
    check_match(&headers, &name, &branch, head)?;
    let parent = base.model.history.parent_of(left);
    let parent = parent.and_then(|number| {
        base.model
            .history
            .versions
            .get(&number)
            .map(|version| (number, version))
    });
    let Some(parent) = parent else {
        return Err(Problem::conflict(format!(
            "{name}@{branch} is at v{left}, the first version; there is nothing to undo"
        )));
    };
    let database = &app.database;
    let changed = database
        .move_model_branch(&caller.tenant, &name, &branch, left, parent)
        .await?;
    if !matches!(changed, Changed::To(_)) {
        return Err(moved(&name, &branch));
    }
    let version = base.view(&name, parent.0)?;
    let tag = format!("\"{}\"", version.hash);
    let undone = UndoneVersion {
        model: name,
        branch,
        left,
        version,
    };
    Ok(([(header::ETAG, tag)], Json(undone)).into_response())
}

/// Creates a branch at a version of a model.
#[utoipa::path(post, path = "/api/v1/models/{name}/branches", tag = "models", operation_id = "branch_model", request_body = NewBranch,
    params(("name" = String, Path)), responses(
    (status = 201, description = "created", body = ModelHistory),
    (status = 400, description = "malformed request, or invalid name", body = Problem, content_type = "application/problem+json"),
    (status = 404, description = "model or version not found", body = Problem, content_type = "application/problem+json"),
    (status = 409, description = "a branch with this name already exists", body = Problem, content_type = "application/problem+json"),
    (status = 413, description = "request body too large", body = Problem, content_type = "application/problem+json"),
    (status = 422, description = "the name could be mistaken for a version", body = Problem, content_type = "application/problem+json"),
    (status = 507, description = "disk full, or quota of documents exceeded", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn branch(
    app: Shared,
    caller: Caller,
    name: Result<Path<String>, PathRejection>,
    body: Result<JsonObject<NewBranch>, Problem>,
) -> Result<Response, Problem> {
    let Path(name) = name?;
    let JsonObject(body) = body?;
    checked_name(&body.name)?;
    if version_number(&body.name).is_some() {
        return Err(Problem::unprocessable(format!(
            "'{}' could be mistaken for a version; choose another name",
            body.name
        )));
    }
    let mut base = Base::find(&app, &caller, &name).await?;
    let at = base.number(&name, body.at.as_deref().unwrap_or(MAIN))?;
    if !base.begun {
        checked_name(&name)?;
        let begun = app
            .database
            .begin_model(&caller.tenant, &name, &[base.version(&name, at)?])
            .await?;
        if begun == Changed::Full {
            return Err(full(&caller));
        }
    }
    let database = &app.database;
    match database
        .make_model_branch(&caller.tenant, &name, &body.name, at)
        .await?
    {
        Changed::To(_) => {}
        Changed::Moved => {
            return Err(Problem::conflict(format!(
                "branch {name}@{} already exists; choose another name",
                body.name
            )));
        }
        Changed::Full => return Err(full(&caller)),
    }
    base = Base::find(&app, &caller, &name).await?;
    let history = ModelHistory::new(&name, base.begun, &base.model)?;
    Ok((StatusCode::CREATED, Json(history)).into_response())
}

/// What differs between two versions of a model.
#[utoipa::path(get, path = "/api/v1/models/{name}/diff", tag = "models", operation_id = "diff_model", params(("name" = String, Path), Between), responses(
    (status = 200, description = "the differences", body = DifferenceView),
    (status = 400, description = "invalid parameter", body = Problem, content_type = "application/problem+json"),
    (status = 404, description = "model or version not found", body = Problem, content_type = "application/problem+json"),
    (status = 422, description = "the document in the library is not a valid model", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn diff(
    app: Shared,
    caller: Caller,
    name: Result<Path<String>, PathRejection>,
    between: Result<Query<Between>, QueryRejection>,
) -> Result<Json<DifferenceView>, Problem> {
    let (Path(name), Query(between)) = (name?, between?);
    let base = Base::find(&app, &caller, &name).await?;
    let from = base.number(&name, &between.from)?;
    let to = base.number(&name, between.to.as_deref().unwrap_or(MAIN))?;
    Ok(Json(DifferenceView::between(
        (label(&name, from), base.version(&name, from)?),
        (label(&name, to), base.version(&name, to)?),
    )))
}

/// One version of a model (`v1`, or a branch): the complete file, or a summary.
#[utoipa::path(get, path = "/api/v1/models/{name}/versions/{at}", tag = "models", operation_id = "get_model_version",
    params(("name" = String, Path), ("at" = String, Path), VersionQuery), responses(
    (status = 200, description = "the version", content((String = "application/toml"), (VersionView = "application/json")),
     headers(("ETag" = String, description = "content hash"))),
    (status = 400, description = "invalid parameter", body = Problem, content_type = "application/problem+json"),
    (status = 404, description = "model or version not found", body = Problem, content_type = "application/problem+json"),
    (status = 422, description = "the document in the library is not a valid model", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn version(
    app: Shared,
    caller: Caller,
    path: Result<Path<(String, String)>, PathRejection>,
    query: Result<Query<VersionQuery>, QueryRejection>,
) -> Result<Response, Problem> {
    let (Path((name, at)), Query(query)) = (path?, query?);
    let base = Base::find(&app, &caller, &name).await?;
    let number = base.number(&name, &at)?;
    let version = base.version(&name, number)?;
    let tag = (header::ETAG, format!("\"{}\"", version.hash()));
    Ok(match query.format.unwrap_or(VersionFormat::Toml) {
        VersionFormat::Toml => {
            let kind = (header::CONTENT_TYPE, "application/toml".to_owned());
            ([tag, kind], version.to_toml()).into_response()
        }
        VersionFormat::Json => ([tag], Json(base.view(&name, number)?)).into_response(),
    })
}

impl App {
    /// The version that `f550@v1` or `f550@windy` names.
    ///
    /// # Errors
    /// 404, 422.
    pub(super) async fn model_version(&self, caller: &Caller, name: &str, at: &str) -> Result<ModelVersion, Problem> {
        let base = Base::find(self, caller, name).await?;
        let number = base.number(name, at)?;
        base.version(name, number).cloned()
    }
}

/// A model as it stands, or as it would begin.
struct Base {
    model: StoredModel,
    begun: bool,
}

impl Base {
    async fn find(app: &App, caller: &Caller, name: &str) -> Result<Self, Problem> {
        if let Some(model) = app.database.model(&app.readers, &caller.tenant, name).await? {
            return Ok(Self { model, begun: true });
        }
        let library = app.library(caller).await?;
        let first = if library.has("models", name) {
            app.readers.read(|| library.model(name)).await?
        } else if library.has("vehicles", name) {
            app.readers.read(|| library.first_version(name)).await?
        } else {
            return Err(Problem::not_found(format!(
                "model or vehicle '{name}' not found; /api/v1/models and /api/v1/vehicles list those that exist"
            )));
        };
        let history = History {
            versions: BTreeMap::from([(0, first)]),
            branches: BTreeMap::from([(MAIN.to_owned(), 0)]),
        };
        let model = StoredModel {
            history,
            made_ms: BTreeMap::new(),
        };
        Ok(Self { model, begun: false })
    }

    fn version(&self, name: &str, number: u32) -> Result<&ModelVersion, Problem> {
        let version = self.model.history.versions.get(&number);
        version.ok_or_else(|| Problem::not_found(format!("there is no version {}", label(name, number))))
    }

    fn view(&self, name: &str, number: u32) -> Result<VersionView, Problem> {
        VersionView::of(name, &self.model, number)
            .ok_or_else(|| Problem::not_found(format!("there is no version {}", label(name, number))))
    }

    /// Number of `v1`, or of the head of a branch.
    fn number(&self, name: &str, at: &str) -> Result<u32, Problem> {
        match version_number(at) {
            Some(number) => self.version(name, number).map(|_| number),
            None => self.head(name, at).map(|(number, _)| number),
        }
    }

    /// Where a branch stands.
    fn head(&self, name: &str, branch: &str) -> Result<(u32, &ModelVersion), Problem> {
        let history = &self.model.history;
        let number = history.branches.get(branch).copied().ok_or_else(|| {
            let known: Vec<&str> = history.branches.keys().map(String::as_str).collect();
            Problem::not_found(format!(
                "{name}@{branch} not found; expected a version such as v0, or one of the branches {}",
                known.join(", ")
            ))
        })?;
        Ok((number, self.version(name, number)?))
    }

    /// The versions from the first to this one.
    fn line(&self, number: u32) -> Vec<ModelVersion> {
        let history = &self.model.history;
        let line = history.line_to(number);
        line.iter()
            .filter_map(|number| history.versions.get(number).cloned())
            .collect()
    }
}

impl Addition {
    async fn effects(
        &self,
        app: &App,
        caller: &Caller,
        line: &[ModelVersion],
    ) -> Result<from_diagnosis::Addition, Problem> {
        match (&self.diagnosis, &self.effect) {
            (Some(id), None) => self.of_diagnosis(app, caller, id, line).await,
            (None, Some(effect)) if self.pick.is_none() && !self.proposal => {
                let effect = ModelEffect {
                    effect: effect.effect.clone(),
                    rotor: effect.rotor,
                    onset_s: effect.onset_s,
                    parameters: effect.parameters.clone(),
                    deviations: effect.deviations.clone(),
                    provenance: Provenance::by_hand(),
                };
                Ok(from_diagnosis::Addition::of_one(effect, Vec::new()))
            }
            _ => Err(Problem::unprocessable(
                "expected either `diagnosis`, with `pick` or `proposal` or neither, or `effect`",
            )),
        }
    }

    async fn of_diagnosis(
        &self,
        app: &App,
        caller: &Caller,
        id: &str,
        line: &[ModelVersion],
    ) -> Result<from_diagnosis::Addition, Problem> {
        let refused = |sentence: String| Problem::unprocessable(format!("diagnosis {id}: {sentence}"));
        let job = done(app, caller, JobKind::Diagnosis, id).await?;
        let text = job.result.unwrap_or_default();
        let json = serde_json::from_str(&text).map_err(|error| refused(format!("its result is not JSON: {error}")))?;
        from_diagnosis::check_base(&json, line).map_err(refused)?;
        if self.proposal {
            if self.pick.is_some() {
                return Err(Problem::unprocessable("`pick` and `proposal`; expected one of them"));
            }
            return from_diagnosis::Addition::proposed(&json).map_err(refused);
        }
        let found = from_diagnosis::Addition::found(&json, line).map_err(refused)?;
        if found.is_empty() {
            return Err(refused("it found no missing physics to add".to_owned()));
        }
        match self.pick {
            None => Ok(found),
            Some(pick) => found.picked(pick, "`pick`").map_err(refused),
        }
    }
}

/// The version with the documents of the library for those of its effects that are in no catalogue and have none.
fn with_documents_of(library: &Library, version: ModelVersion) -> Result<ModelVersion, Problem> {
    let known = version
        .catalogue()
        .map_err(|refusal| Problem::unprocessable(refusal.reason))?;
    let missing = |id: &str| version.effect.iter().any(|effect| effect.effect == id) && known.find(id).is_none();
    let mut documents = library.effect_documents()?;
    documents.retain(|document| missing(&document.id));
    Ok(version.with_documents(&documents))
}

fn check(version: &ModelVersion) -> Result<(), Problem> {
    ModelStore::check(version).map_err(|error| Problem::unprocessable(error.to_string()))
}

/// Whether the branch stands where the caller saw it.
fn check_match(headers: &HeaderMap, name: &str, branch: &str, head: &ModelVersion) -> Result<(), Problem> {
    match precondition(headers)? {
        Precondition::None => Ok(()),
        Precondition::Hash(hash) if hash == head.hash() => Ok(()),
        Precondition::Hash(_) => Err(moved(name, branch)),
        Precondition::Absent => Err(Problem::bad_request(
            "unexpected `If-None-Match`; `If-Match` states the version that the change is based on",
        )),
    }
}

fn moved(name: &str, branch: &str) -> Problem {
    Problem::precondition_failed(format!(
        "{name}@{branch} has changed in the meantime: another client added or undid a version; nothing was written"
    ))
}

fn full(caller: &Caller) -> Problem {
    Problem::disk_full(format!(
        "'{}' has reached its quota of models, versions or branches; delete some that are no longer needed",
        caller.tenant
    ))
}
