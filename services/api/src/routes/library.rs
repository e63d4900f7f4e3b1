//! Documents that submissions can name: scenarios, vehicles, blades, effects, models.

use super::jobs::Shared;
use super::results::DeclaredEffect;
use crate::access::Caller;
use crate::json_object::JsonObject;
use crate::library::{Complaint, DocumentKind};
use crate::problem::Problem;
use axum::Json;
use rotortwin_jobs::submission::ScenarioToCheck;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

super::documents!(
    scenarios,
    crate::library::DocumentKind::Scenario,
    "a scenario",
    "/api/v1/scenarios",
    "/api/v1/scenarios/{name}"
);
super::documents!(
    vehicles,
    crate::library::DocumentKind::Vehicle,
    "a vehicle",
    "/api/v1/vehicles",
    "/api/v1/vehicles/{name}"
);
super::documents!(
    blades,
    crate::library::DocumentKind::Blades,
    "a blade set",
    "/api/v1/blades",
    "/api/v1/blades/{name}"
);
super::documents!(
    effects,
    crate::library::DocumentKind::Effect,
    "an effect document",
    "/api/v1/effects",
    "/api/v1/effects/{name}"
);
super::documents!(
    models,
    crate::library::DocumentKind::Model,
    "a version of a model",
    "/api/v1/models",
    "/api/v1/models/{name}"
);

/// Result of a check.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct Validation {
    /// True if the document is valid.
    valid: bool,
    /// Why it is invalid, one sentence: the first of the complaints.
    refusal: Option<String>,
    /// All errors. Later ones were found after the earlier ones had been corrected or left out.
    complaints: Vec<Complaint>,
    /// Settings that are allowed but probably unintended.
    warnings: Vec<String>,
    /// Of a scenario: every setting in effect (TOML).
    effective: Option<String>,
}

impl Validation {
    fn refused(complaints: Vec<Complaint>) -> Self {
        Self {
            valid: false,
            refusal: complaints.first().map(|complaint| complaint.sentence.clone()),
            complaints,
            warnings: Vec::new(),
            effective: None,
        }
    }
}

/// Checks a scenario without flying it: lists every error, or all settings in effect.
#[utoipa::path(post, path = "/api/v1/scenarios/validate", tag = "library", operation_id = "validate_scenario", request_body = ScenarioToCheck, responses(
    (status = 200, description = "the findings", body = Validation),
    (status = 400, description = "malformed request", body = Problem, content_type = "application/problem+json"),
    (status = 404, description = "scenario not found", body = Problem, content_type = "application/problem+json"),
    (status = 413, description = "request body too large", body = Problem, content_type = "application/problem+json"),
    (status = 415, description = "the body is not JSON", body = Problem, content_type = "application/problem+json"),
    (status = 422, description = "malformed request", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn validate_scenario(
    app: Shared,
    caller: Caller,
    body: Result<JsonObject<ScenarioToCheck>, Problem>,
) -> Result<Json<Validation>, Problem> {
    let JsonObject(body) = body?;
    let library = app.library(&caller).await?;
    let (name, text) = (body.scenario.as_deref(), body.text.as_deref());
    let read = || {
        let alone = text.filter(|_| name.is_none() && body.set.is_empty());
        let complaints = alone.map(|text| library.complaints(DocumentKind::Scenario, text));
        if let Some(complaints) = complaints.filter(|complaints| !complaints.is_empty()) {
            return Ok(Validation::refused(complaints));
        }
        let scenario = super::submissions::find_scenario(&library, name, text, &body.set)?;
        Ok::<_, Problem>(Validation {
            valid: true,
            refusal: None,
            complaints: Vec::new(),
            warnings: scenario.warnings(),
            effective: Some(scenario.documents().to_toml()),
        })
    };
    match app.readers.read(read).await {
        Ok(validation) => Ok(Json(validation)),
        Err(problem) if problem.kind.ends_with("unprocessable") => Ok(Json(Validation::refused(vec![Complaint {
            key: None,
            line: None,
            sentence: problem.detail,
        }]))),
        Err(problem) => Err(problem),
    }
}

/// A document to check.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct TextToValidate {
    /// TOML.
    text: String,
}

macro_rules! validation {
    ($function:ident, $kind:expr, $word:literal, $path:literal) => {
        #[doc = concat!("Checks ", $word, " and lists every error.")]
        #[utoipa::path(post, path = $path, summary = concat!("Checks ", $word, " and lists every error."), tag = "library", operation_id = stringify!($function), request_body = TextToValidate, responses(
            (status = 200, description = "the findings", body = Validation),
            (status = 400, description = "malformed request", body = Problem, content_type = "application/problem+json"),
            (status = 413, description = "request body too large", body = Problem, content_type = "application/problem+json"),
            (status = 415, description = "the body is not JSON", body = Problem, content_type = "application/problem+json"),
            (status = 422, description = "malformed request", body = Problem, content_type = "application/problem+json")
        ))]
        pub(crate) async fn $function(
            app: Shared,
            caller: Caller,
            body: Result<JsonObject<TextToValidate>, Problem>,
        ) -> Result<Json<Validation>, Problem> {
            let JsonObject(body) = body?;
            let library = app.library(&caller).await?;
            let complaints = app.readers.read(|| library.complaints($kind, &body.text)).await;
            let valid = complaints.is_empty();
            Ok(Json(Validation {
                valid,
                ..Validation::refused(complaints)
            }))
        }
    };
}

validation!(
    validate_vehicle,
    DocumentKind::Vehicle,
    "a vehicle",
    "/api/v1/vehicles/validate"
);
validation!(
    validate_blades,
    DocumentKind::Blades,
    "a blade set",
    "/api/v1/blades/validate"
);
validation!(
    validate_effect,
    DocumentKind::Effect,
    "an effect document",
    "/api/v1/effects/validate"
);
validation!(
    validate_model,
    DocumentKind::Model,
    "a version of a model",
    "/api/v1/models/validate"
);

/// The effects that a model can have.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct EffectCatalogue {
    /// The built-in ones, then those of the library.
    items: Vec<DeclaredEffect>,
}

/// The catalogue of effects: the built-in ones and the library's effect documents, as used by the diagnosis.
#[utoipa::path(get, path = "/api/v1/catalogue", tag = "library", operation_id = "catalogue", responses(
    (status = 200, description = "declarations", body = EffectCatalogue),
    (status = 422, description = "a document in the library is not a valid effect", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn catalogue(app: Shared, caller: Caller) -> Result<Json<EffectCatalogue>, Problem> {
    let library = app.library(&caller).await?;
    let catalogue = app.readers.read(|| library.catalogue()).await?;
    let items = catalogue.entries().iter().map(|entry| DeclaredEffect::of(entry));
    Ok(Json(EffectCatalogue {
        items: items.collect::<Result<_, Problem>>()?,
    }))
}

/// A campaign of the library.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct LibraryCampaign {
    /// Value for `campaign` in `POST /api/v1/campaigns`.
    name: String,
    /// What it tests; empty if its document does not say.
    description: String,
}

/// The campaigns of the library.
#[derive(Debug, Serialize, ToSchema)]
pub(crate) struct LibraryCampaigns {
    /// Ordered by name.
    items: Vec<LibraryCampaign>,
}

/// Campaigns of the library that can be submitted by name.
#[utoipa::path(get, path = "/api/v1/library/campaigns", tag = "library", operation_id = "list_library_campaigns", responses(
    (status = 200, description = "names, and what each campaign tests", body = LibraryCampaigns)
))]
pub(crate) async fn campaigns(app: Shared, caller: Caller) -> Result<Json<LibraryCampaigns>, Problem> {
    let library = app.library(&caller).await?;
    let described = |name: String| {
        let text = library.text("campaigns", &name)?;
        let document: toml::Table = toml::from_str(&text).unwrap_or_default();
        let description = document.get("description").and_then(toml::Value::as_str);
        Ok(LibraryCampaign {
            description: description.unwrap_or_default().to_owned(),
            name,
        })
    };
    let items = library.names("campaigns").into_iter().map(described);
    Ok(Json(LibraryCampaigns {
        items: items.collect::<Result<_, Problem>>()?,
    }))
}
