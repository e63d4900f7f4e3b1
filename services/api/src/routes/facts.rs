//! Summary of the request of each kind of job other than runs. Written when a job is accepted, and shown in lists.

use super::asked::{Flights, ModelChoice};
use rotortwin_blind::bench::cases::Preset;
use rotortwin_jobs::training::Method;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// The request, in short. Which of these it is follows from `kind`.
#[derive(Debug, Clone, Serialize, ToSchema)]
#[serde(untagged)]
pub(crate) enum JobFacts {
    /// `campaign`.
    Campaign(CampaignFacts),
    /// `campaign-shard`.
    CampaignPart(CampaignPartFacts),
    /// `blind-bench`.
    BlindBench(BlindBenchFacts),
    /// `blind-bench-shard`.
    BlindBenchPart(BlindBenchPartFacts),
    /// `log` that was uploaded.
    Upload(UploadFacts),
    /// `log` of the independent simulator.
    Example(ExampleFacts),
    /// `comparison`, `diagnosis`, `improvement`.
    Twin(TwinFacts),
    /// `identification`.
    Identification(IdentificationFacts),
    /// `next-flight`.
    NextFlight(NextFlightFacts),
    /// `classifier`.
    Classifier(ClassifierFacts),
    /// `verification`.
    Verification(VerificationFacts),
}

impl JobFacts {
    /// The same of a job that is divided.
    #[must_use]
    pub(super) fn with_parts(mut self, count: usize) -> Self {
        match &mut self {
            Self::Campaign(CampaignFacts { parts, .. }) | Self::BlindBench(BlindBenchFacts { parts, .. }) => {
                *parts = Some(count);
            }
            _ => {}
        }
        self
    }
}

/// Of a campaign.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub(crate) struct CampaignFacts {
    /// That are planned.
    pub(super) flights: u64,
    /// Of all its draws.
    pub(super) seed: u64,
    /// Id of the job that trained its network.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) classifier: Option<String>,
    /// Jobs that it is divided into.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) parts: Option<usize>,
}

/// Of a part of a campaign.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub(crate) struct CampaignPartFacts {
    /// Number of its first flight.
    pub(super) first_flight: u64,
    /// Flights.
    pub(super) flights: u64,
}

/// Of a blind bench.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub(crate) struct BlindBenchFacts {
    /// Of all presets.
    pub(super) cases: usize,
    /// What is to be shown.
    pub(super) presets: Vec<Preset>,
    /// Cases of each preset.
    pub(super) n: usize,
    /// Of the draws.
    pub(super) seed: u64,
    /// Names, taken in turn.
    pub(super) vehicles: Vec<String>,
    /// Length of a flight, s.
    pub(super) duration_s: f64,
    /// Jobs that it is divided into.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) parts: Option<usize>,
}

/// Of a part of a blind bench.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub(crate) struct BlindBenchPartFacts {
    /// Number of its first case, over all presets.
    pub(super) first_case: u64,
    /// Cases.
    pub(super) cases: u64,
}

/// Of a log that was uploaded.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub(crate) struct UploadFacts {
    /// Name of the file that was sent.
    pub(super) file: String,
    /// Of that file.
    pub(super) bytes: u64,
    /// Hash of that file (XXH3, 64 bits).
    pub(super) xxh3: String,
    /// Where the server keeps that file, to read it again.
    pub(super) upload: String,
    /// Name of the vehicle that it was read for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) vehicle: Option<String>,
}

impl UploadFacts {
    /// Of a job's row; `None`: nothing was uploaded.
    pub(super) fn of(facts: &str) -> Option<Self> {
        serde_json::from_str(facts).ok()
    }
}

/// Of a log of the independent simulator.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub(crate) struct ExampleFacts {
    /// True.
    pub(super) example: bool,
    /// Name of the vehicle.
    pub(super) vehicle: String,
    /// s.
    pub(super) duration_s: f64,
    /// Number of the case in the blind bench that is the job's parent; absent if it is an example.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) case: Option<usize>,
}

/// Of a comparison, a diagnosis or an improvement.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub(crate) struct TwinFacts {
    /// Compared, diagnosed or improved.
    pub(super) model: ModelChoice,
    /// With which flights.
    pub(super) flights: Flights,
    /// Of a comparison.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(super) more_models: Vec<ModelChoice>,
}

/// Of a vehicle from logs.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub(crate) struct IdentificationFacts {
    /// Name of the vehicle.
    pub(super) vehicle: String,
    /// Of this vehicle.
    pub(super) flights: Flights,
    /// With battery, kg.
    pub(super) mass_kg: f64,
    /// From the centre to the furthest rotor, m.
    pub(super) arm_m: f64,
}

/// Of the proposal of a next flight.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub(crate) struct NextFlightFacts {
    /// As it stands.
    pub(super) model: ModelChoice,
    /// The two effects.
    pub(super) between: [String; 2],
}

/// Of a classifier that is trained.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub(crate) struct ClassifierFacts {
    /// What the network reads and how it is trained.
    pub(super) method: Method,
    /// Name of the scenario that it is trained with.
    pub(super) scenario: String,
    /// Data sets.
    pub(super) seeds: u32,
    /// The others follow.
    pub(super) first_seed: u64,
}

/// Of a run that is flown again.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub(crate) struct VerificationFacts {
    /// Id of the run.
    pub(super) run: String,
}
