//! What an effect of the catalogue does to a flight of a vehicle, for chosen parameters: computed by the effect itself.

use super::jobs::Shared;
use crate::access::Caller;
use crate::problem::Problem;
use crate::worker::answer::{answered, json};
use axum::extract::rejection::{PathRejection, QueryRejection};
use axum::extract::{Path, Query};
use axum::response::Response;
use rotortwin_jobs::{EffectPicture as EffectQuestion, Question};
use rotortwin_twin::sandbox::EffectPicture;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::time::Duration;
use utoipa::IntoParams;

/// Longest time that a picture takes.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(60);

/// On which vehicle, how large.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(crate) struct Asked {
    /// Name of one of the server's vehicles.
    vehicle: String,
    /// Rotor, from 1, of an effect of one rotor; 1 without it.
    rotor: Option<usize>,
    /// Comma-separated `name:value`; default: typical values.
    #[param(
        example = "drag_n_s_m:0.3",
        max_length = 1000,
        pattern = "^[^,:=]+:[^,:=]+(,[^,:=]+:[^,:=]+)*$"
    )]
    parameters: Option<String>,
    /// Manoeuvre to fly; by default all are flown, and the one that shows the effect best is used.
    #[param(example = "speed-runs")]
    flight: Option<String>,
}

/// How an effect changes the channels of a simulated flight, over time and over the conditions that excite it.
#[utoipa::path(get, path = "/api/v1/catalogue/{effect}/picture", tag = "library", operation_id = "effect_picture", params(("effect" = String, Path), Asked), responses(
    (status = 200, description = "the channels that the effect changes most", body = EffectPicture),
    (status = 400, description = "invalid parameter", body = Problem, content_type = "application/problem+json"),
    (status = 404, description = "effect or vehicle not found", body = Problem, content_type = "application/problem+json"),
    (status = 422, description = "unknown parameter, rotor or manoeuvre, or the vehicle cannot fly it", body = Problem, content_type = "application/problem+json"),
    (status = 503, description = "too many checks at the same time", body = Problem, content_type = "application/problem+json")
))]
pub(crate) async fn picture(
    app: Shared,
    caller: Caller,
    effect: Result<Path<String>, PathRejection>,
    asked: Result<Query<Asked>, QueryRejection>,
) -> Result<Response, Problem> {
    let (Path(effect), Query(asked)) = (effect?, asked?);
    let library = app.library(&caller).await?;
    if app.readers.read(|| library.catalogue()).await?.find(&effect).is_none() {
        return Err(Problem::not_found(format!(
            "effect '{effect}' not found in the catalogue"
        )));
    }
    // Only to be refused by name.
    app.readers.read(|| library.vehicle_documents(&asked.vehicle)).await?;
    let named = asked
        .rotor
        .map_or_else(|| effect.clone(), |rotor| format!("{effect}#{rotor}"));
    let documents = library.names("effects").into_iter();
    let question = Question::EffectPicture(EffectQuestion {
        effect: named,
        model: library.file("vehicles", &asked.vehicle, "toml").display().to_string(),
        models: "models".into(),
        parameters: parameters(asked.parameters.as_deref().unwrap_or_default())?,
        flight: asked.flight,
        effects: documents.map(|name| library.file("effects", &name, "toml")).collect(),
    });
    let for_callers = |sentence: &str| library.without_root(&sentence);
    answered(&app, &question, ANSWER_TIMEOUT, for_callers).await.map(json)
}

/// `name:value,…`; what is no such pair is passed over.
fn parameters(text: &str) -> Result<BTreeMap<String, f64>, Problem> {
    let pairs = text.split(',').filter_map(|pair| pair.split_once(':'));
    pairs
        .map(|(name, value)| {
            let number = value.parse().ok().filter(|number: &f64| number.is_finite());
            let number = number.ok_or_else(|| {
                Problem::unprocessable(format!("`parameters`, {name}: expected a number, got `{value}`"))
            })?;
            Ok((name.to_owned(), number))
        })
        .collect()
}
