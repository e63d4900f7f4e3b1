//! Detector selection on the command line, and the arguments of `rotortwin fdi-service`: the detectors on flights flown elsewhere.

use rotortwin_process::LinkAddress;
use rotortwin_scenario::Detectors;
use rotortwin_twin::model::ModelStore;
use rotortwin_verdicts::detectors::DetectorChoice;
use std::path::{Path, PathBuf};

/// Which detectors.
#[derive(Debug, clap::Args)]
pub struct DetectorArgs {
    /// Healthy vehicle assumed by the detectors: a vehicle, MODEL, MODEL@BRANCH, MODEL@v2, or a version file, with those of its effects that the detectors can
    /// represent
    #[arg(long, alias = "vehicle", value_name = "MODEL")]
    model: String,
    /// Folder of the models
    #[arg(long, value_name = "DIR", default_value = "models")]
    models: PathBuf,
    /// Classifier, a file or a name; without one the network gives no verdict
    #[arg(long, value_name = "CLASSIFIER", value_parser = crate::named::classifier())]
    classifier: Option<PathBuf>,
    /// Set a key of the [fdi] table of scenarios, such as calibration_end_s=5 [default: as the classifier was trained]
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
}

impl DetectorArgs {
    /// The model, as named.
    pub fn model(&self) -> &str {
        &self.model
    }

    /// Folder of the models.
    pub fn models(&self) -> &Path {
        &self.models
    }

    /// File of the classifier.
    pub(crate) fn classifier(&self) -> Option<&Path> {
        self.classifier.as_deref()
    }

    /// `KEY=VALUE` of the [fdi] table.
    pub(crate) fn settings(&self) -> &[String] {
        &self.set
    }

    /// The detectors, and the parts of the model that they ignore.
    pub fn detectors(&self) -> Result<(Detectors, Option<String>), String> {
        let choice = DetectorChoice {
            store: &ModelStore::new(&self.models),
            model: &self.model,
            classifier: self.classifier.as_deref(),
            settings: &self.set,
        };
        choice.detectors()
    }
}

/// Arguments of `rotortwin fdi-service`.
#[derive(Debug, clap::Args)]
pub struct ServiceArgs {
    /// Where measurements come from: zenoh:listen=ENDPOINT or zenoh:connect=ENDPOINT
    #[arg(long, value_name = "LINK")]
    pub link: LinkAddress,
    /// Which detectors.
    #[command(flatten)]
    pub detectors: DetectorArgs,
    /// Name of the session, part of its topics
    #[arg(long, value_name = "NAME", default_value = "default")]
    pub session: String,
}
