//! Kinds of jobs, as the queue, the API and its clients name them.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Kind of a job.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum JobKind {
    /// One flight.
    Run,
    /// Many flights, with statistics.
    Campaign,
    /// Some of a campaign's flights.
    CampaignShard,
    /// Logs with hidden effects, diagnosed and scored.
    BlindBench,
    /// Some of a blind bench's cases.
    BlindBenchShard,
    /// A flight log that is imported.
    Log,
    /// A model compared with a log.
    Comparison,
    /// Which effects a model lacks.
    Diagnosis,
    /// Compare, diagnose, add, compare again: versions of a model.
    Improvement,
    /// A vehicle that is identified from logs.
    Identification,
    /// The manoeuvre that would distinguish two effects.
    NextFlight,
    /// A classifier that is trained.
    Classifier,
    /// A run that is flown again.
    Verification,
}

impl JobKind {
    /// All kinds, for look-ups.
    const ALL: [Self; 13] = [
        Self::Run,
        Self::Campaign,
        Self::CampaignShard,
        Self::BlindBench,
        Self::BlindBenchShard,
        Self::Log,
        Self::Comparison,
        Self::Diagnosis,
        Self::Improvement,
        Self::Identification,
        Self::NextFlight,
        Self::Classifier,
        Self::Verification,
    ];

    /// Name in the database.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Run => "run",
            Self::Campaign => "campaign",
            Self::CampaignShard => "campaign-shard",
            Self::BlindBench => "blind-bench",
            Self::BlindBenchShard => "blind-bench-shard",
            Self::Log => "log",
            Self::Comparison => "comparison",
            Self::Diagnosis => "diagnosis",
            Self::Improvement => "improvement",
            Self::Identification => "identification",
            Self::NextFlight => "next-flight",
            Self::Classifier => "classifier",
            Self::Verification => "verification",
        }
    }

    /// Collection of this kind in the API: `/api/v1/COLLECTION`.
    pub const fn collection(self) -> &'static str {
        match self {
            Self::Run => "runs",
            Self::Campaign => "campaigns",
            Self::CampaignShard => "campaign-shards",
            Self::BlindBench => "blind-benches",
            Self::BlindBenchShard => "blind-bench-shards",
            Self::Log => "logs",
            Self::Comparison => "comparisons",
            Self::Diagnosis => "diagnoses",
            Self::Improvement => "improvements",
            Self::Identification => "identifications",
            Self::NextFlight => "next-flights",
            Self::Classifier => "classifiers",
            Self::Verification => "verifications",
        }
    }

    /// By its name in the database; `None`: it is of a later version.
    pub fn parse(text: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.as_str() == text)
    }
}
