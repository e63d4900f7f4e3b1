//! Summary of the request of each kind of job other than runs. Written when a job is accepted, and shown in lists.

use rotortwin_blind::bench::cases::Preset;
use rotortwin_jobs::submission::{Flights, ModelChoice};
use rotortwin_jobs::training::Method;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Short form of the request. Its type follows from `kind`.
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

/// Short form of the request for a campaign.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub(crate) struct CampaignFacts {
    /// Number of planned flights.
    pub(super) flights: u64,
    /// Seed of all its random draws.
    pub(super) seed: u64,
    /// Id of the job that trained its network.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) classifier: Option<String>,
    /// Number of jobs into which it is split.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) parts: Option<usize>,
}

/// Short form of the request for a part of a campaign.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub(crate) struct CampaignPartFacts {
    /// Index of its first flight.
    pub(super) first_flight: u64,
    /// Number of flights.
    pub(super) flights: u64,
}

/// Short form of the request for a blind bench.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub(crate) struct BlindBenchFacts {
    /// Number of cases of all presets.
    pub(super) cases: usize,
    /// Presets.
    pub(super) presets: Vec<Preset>,
    /// Cases per preset.
    pub(super) n: usize,
    /// Seed of the random draws.
    pub(super) seed: u64,
    /// Names, used in turn.
    pub(super) vehicles: Vec<String>,
    /// Length of a flight, s.
    pub(super) duration_s: f64,
    /// Number of jobs into which it is split.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) parts: Option<usize>,
}

/// Short form of the request for a part of a blind bench.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub(crate) struct BlindBenchPartFacts {
    /// Number of its first case, over all presets.
    pub(super) first_case: u64,
    /// Number of cases.
    pub(super) cases: u64,
}

/// Short form of the upload of a log.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub(crate) struct UploadFacts {
    /// Name of the uploaded file.
    pub(super) file: String,
    /// Size of the file, bytes.
    pub(super) bytes: u64,
    /// Hash of the file (XXH3, 64 bits).
    pub(super) xxh3: String,
    /// Where the server keeps the file, to read it again.
    pub(super) upload: String,
    /// Name of the vehicle that it was checked against.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) vehicle: Option<String>,
}

impl UploadFacts {
    /// Of a job's row; `None`: nothing was uploaded.
    pub(super) fn of(facts: &str) -> Option<Self> {
        serde_json::from_str(facts).ok()
    }
}

/// Short form of the request for a log from the independent simulator.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub(crate) struct ExampleFacts {
    /// Always true.
    pub(super) example: bool,
    /// Name of the vehicle.
    pub(super) vehicle: String,
    /// s.
    pub(super) duration_s: f64,
    /// Number of the case in the blind bench that is the job's parent; absent if it is an example.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) case: Option<usize>,
}

/// Short form of the request for a comparison, a diagnosis or an improvement.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub(crate) struct TwinFacts {
    /// The model.
    pub(super) model: ModelChoice,
    /// Names of the flights.
    pub(super) flights: Flights,
    /// Labels in the result of a comparison.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(super) more_models: Vec<ModelChoice>,
}

/// Short form of the request for an identification.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub(crate) struct IdentificationFacts {
    /// Name of the vehicle.
    pub(super) vehicle: String,
    /// Number of flights.
    pub(super) flights: Flights,
    /// Mass including battery, kg.
    pub(super) mass_kg: f64,
    /// Distance from the centre to the farthest rotor, m.
    pub(super) arm_m: f64,
}

/// Short form of the request for a proposal of a next flight.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub(crate) struct NextFlightFacts {
    /// The current model.
    pub(super) model: ModelChoice,
    /// The two effects.
    pub(super) between: [String; 2],
}

/// Short form of the request for a classifier.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub(crate) struct ClassifierFacts {
    /// What the network reads and how it is trained.
    pub(super) method: Method,
    /// Name of the scenario used for the training.
    pub(super) scenario: String,
    /// Number of data sets.
    pub(super) seeds: u32,
    /// First seed; the others follow.
    pub(super) first_seed: u64,
}

/// Short form of the request for a second execution.
#[derive(Debug, Clone, Serialize, ToSchema)]
pub(crate) struct VerificationFacts {
    /// Id of the run.
    pub(super) run: String,
}
