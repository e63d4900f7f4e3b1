//! A blind bench to submit.

use rotortwin_blind::bench::cases::Preset;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use utoipa::openapi::schema::{Array, ArrayBuilder, ObjectBuilder, Type};

/// A vehicle to fly.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct BenchVehicle {
    /// Name of one of the server's vehicles; with `text`: the name to give it.
    #[schema(min_length = 1, max_length = 64, pattern = "^[a-z0-9][a-z0-9._-]*$")]
    pub vehicle: String,
    /// A vehicle document (TOML), as in the library's `vehicles`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub text: Option<String>,
    /// With `text`: its blade document (TOML), in place of the library's document that it names.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub blades: Option<String>,
}

/// Logs with hidden effects from an independent simulator, each diagnosed, and the answers scored.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct BlindBenchSubmission {
    /// What is to be shown: one after the other.
    #[serde(default = "usual_presets")]
    #[schema(schema_with = presets_schema)]
    pub presets: Vec<Preset>,
    /// Cases per preset.
    #[schema(minimum = 1, maximum = 10_000)]
    pub n: usize,
    /// Seed of the random draws.
    #[serde(default = "usual_seed")]
    pub seed: u64,
    /// Vehicles, used in turn; empty: `f550`.
    #[serde(default)]
    pub vehicles: Vec<BenchVehicle>,
    /// Length of a flight, s.
    #[serde(default = "usual_duration_s")]
    #[schema(minimum = 1, maximum = 3600)]
    pub duration_s: f64,
    /// From −100 to 100; larger values run first.
    #[serde(default)]
    #[schema(minimum = -100, maximum = 100)]
    pub priority: i64,
    /// Time limit of an attempt at a part, s of wall time; default 6 h.
    #[serde(default)]
    #[schema(minimum = 1, maximum = 86_400)]
    pub max_wall_s: Option<u64>,
}

fn usual_presets() -> Vec<Preset> {
    vec![Preset::Mixed]
}

const fn usual_seed() -> u64 {
    1
}

const fn usual_duration_s() -> f64 {
    90.0
}

fn presets_schema() -> Array {
    let name = ObjectBuilder::new()
        .schema_type(Type::String)
        .enum_values(Some(Preset::all().iter().map(|preset| preset.name())));
    ArrayBuilder::new()
        .description(Some("Presets to run, one after another; default `mixed`."))
        .items(name)
        .min_items(Some(1))
        .build()
}
