//! Plant types that occur in results, with their API schemas: the plant itself knows of no API.

#![expect(dead_code, reason = "for documents: what is written are the plant's own types")]

use std::collections::BTreeMap;
use utoipa::ToSchema;

/// An effect as documents name it.
#[derive(ToSchema)]
pub(crate) struct EffectInstance {
    /// Id in the catalogue: `rotor-drag`.
    effect: String,
    /// Rotor, from 1, of an effect of one rotor.
    #[schema(nullable = false)]
    rotor: Option<usize>,
    /// Onset, s; absent: present from the start.
    #[schema(nullable = false)]
    onset_s: Option<f64>,
    /// Values by the names of the catalogue.
    parameters: BTreeMap<String, f64>,
}

/// Physics, or a fault of the log.
#[derive(ToSchema)]
#[schema(rename_all = "kebab-case")]
pub(crate) enum EffectClass {
    /// Missing in the model.
    Physics,
    /// A sensor.
    SensorFault,
    /// A clock.
    TimingFault,
    /// Belongs to a flight.
    Nuisance,
    /// Shows as noise.
    Noise,
}
