//! The paper's tables, computed: which detectors on which flights, seed by seed.
//!
//! ```text
//!  for each seed:  48 flights ─▶ windows ─▶ 4 folds × network methods ─┐
//!                     (repeated for each choice that affects the T-test) ─┴▶ SeedResult ─▶ tables, files, report
//! ```
//! A seed determines everything random: noise and lift biases of the flights, splits, initial weights, order of the samples. So an
//! interval over seeds covers all of it. The deviation over the four folds is different: it shows how much the trajectories differ.

pub mod bench;
pub mod files;
pub mod parameters;
pub mod report;
pub mod tables;

use crate::learning::network::Activation;
use crate::learning::optimiser::Optimiser;
use crate::learning::samples::ZScore;
use crate::learning::training::{Overrides, TrainingConfig};
use crate::paper::cross_validation::{Fold, fold, paper_network};
use crate::paper::data_set::{DataSet, GroupedSamples};
use crate::paper::protocol::{CHARGES, Conduct, Course};
use crate::paper::scores::Confusion;
use crate::paper::windows::Collect;
use crate::parallel::map_in_order;
use rotortwin_flight_core::fdi::FaultVerdict;
use rotortwin_plant::vehicle::mismatch::{MismatchModel, MismatchPreset, Size};
use rotortwin_scenario::Scenario;
use rotortwin_scenario::scenario_document::Start;
use rotortwin_scenario::settings::{NominalThrustModel, ThrustToDutyMap};
use std::collections::{BTreeMap, BTreeSet};
use std::num::NonZeroUsize;
use std::time::{Duration, Instant};

/// Rotor count for which the paper gives numbers.
const PAPER_ROTORS: usize = 6;

/// One table to reproduce.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Item {
    /// Cross-validation of the network.
    Table6,
    /// Its confusion matrix.
    Table7,
    /// The network without battery compensation.
    Table8,
    /// The T-test.
    Table9,
    /// The network of [32] on tracking errors.
    Table10,
    /// Beyond the paper: lag-aware residuals, self-calibration, another optimiser.
    Improved,
}

impl Item {
    /// In the order of the paper.
    pub const ALL: [Self; 6] = [
        Self::Table6,
        Self::Table7,
        Self::Table8,
        Self::Table9,
        Self::Table10,
        Self::Improved,
    ];

    /// Name on the command line.
    pub fn key(self) -> &'static str {
        match self {
            Self::Table6 => "6",
            Self::Table7 => "7",
            Self::Table8 => "8",
            Self::Table9 => "9",
            Self::Table10 => "10",
            Self::Improved => "improved",
        }
    }

    fn methods(self) -> &'static [Method] {
        match self {
            Self::Table6 => &[Method::Paper, Method::PaperPooled],
            Self::Table7 => &[Method::Paper],
            Self::Table8 => &[Method::UncompensatedPooled, Method::Uncompensated],
            Self::Table9 => &[],
            Self::Table10 => &[Method::TrackingErrors],
            Self::Improved => &[Method::Paper, Method::LagAware, Method::Improved],
        }
    }

    fn t_tests(self) -> &'static [TTestVariant] {
        match self {
            Self::Table9 => &TTestVariant::ALL,
            Self::Improved => &[TTestVariant::Paper, TTestVariant::LagAware],
            _ => &[],
        }
    }
}

/// A network with its inputs and training.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Method {
    /// [32]: 240–30–7 sigmoid on tracking errors.
    TrackingErrors,
    /// Residuals with the rotor lag, minus their calibration mean; Adam, 30 epochs.
    Improved,
    /// The paper's network; z-score per feature.
    Paper,
    /// The same with one z-score for all features.
    PaperPooled,
    /// Residuals without battery model; one z-score for all features.
    UncompensatedPooled,
    /// The same, z-score per feature.
    Uncompensated,
    /// The paper's network and training on residuals with the rotor lag.
    LagAware,
}

impl Method {
    /// All methods, slowest first.
    pub const ALL: [Self; 7] = [
        Self::TrackingErrors,
        Self::Improved,
        Self::Paper,
        Self::PaperPooled,
        Self::UncompensatedPooled,
        Self::Uncompensated,
        Self::LagAware,
    ];

    /// Name in files.
    pub fn key(self) -> &'static str {
        match self {
            Self::TrackingErrors => "tracking-errors",
            Self::Improved => "improved",
            Self::Paper => "paper",
            Self::PaperPooled => "paper-pooled",
            Self::UncompensatedPooled => "uncompensated-pooled",
            Self::Uncompensated => "uncompensated",
            Self::LagAware => "lag-aware",
        }
    }

    /// Rotor model of the residuals; `None`: its inputs are tracking errors.
    pub fn model(self) -> Option<NominalThrustModel> {
        match self {
            Self::TrackingErrors => None,
            Self::Improved | Self::LagAware => Some(NominalThrustModel::Lagged),
            Self::Paper | Self::PaperPooled => Some(NominalThrustModel::Static),
            Self::UncompensatedPooled | Self::Uncompensated => Some(NominalThrustModel::Linear),
        }
    }

    /// Whether the calibration mean is subtracted from the residuals.
    pub fn self_calibrated(self) -> bool {
        self == Self::Improved
    }

    /// Samples of this method.
    pub fn samples(self, data: &DataSet) -> GroupedSamples {
        match self.model() {
            Some(model) => data.residual_samples(model, self.self_calibrated()),
            None => data.tracking_error_samples(),
        }
    }

    /// Network and training.
    pub fn training(self, rotor_count: usize, options: &Options) -> TrainingConfig {
        let usual = self.usual_training(rotor_count, options);
        options.overrides.apply(usual).unwrap_or(usual)
    }

    /// Those of the method, whatever else is asked for.
    fn usual_training(self, rotor_count: usize, options: &Options) -> TrainingConfig {
        let z_score = match self {
            Self::PaperPooled | Self::UncompensatedPooled => ZScore::Pooled,
            _ => ZScore::PerFeature,
        };
        let paper = paper_network(rotor_count, z_score);
        match self {
            Self::TrackingErrors => TrainingConfig {
                hidden: 30,
                activation: Activation::Sigmoid,
                optimiser: Optimiser::Sgdm {
                    learning_rate: TRACKING_LEARNING / f64::from(options.tracking_epochs),
                    momentum: 0.9,
                    l2: 1e-4,
                },
                epochs: options.tracking_epochs,
                ..paper
            },
            Self::Improved => TrainingConfig {
                optimiser: Optimiser::Adam {
                    learning_rate: 3e-3,
                    l2: 0.0,
                },
                epochs: 30,
                ..paper
            },
            _ => paper,
        }
    }
}

/// Learning rate times epochs of the network of [32]: 1e-6 × 2000 (§6.5.3).
pub const TRACKING_LEARNING: f64 = 2e-3;

/// Choices left open by the paper that affect the T-test's result.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum TTestVariant {
    /// The controller's map is u = f/full thrust; µ₀ from 2 s to 10 s, trimmed start.
    Paper,
    /// The controller inverts Eq. 19.
    InverseMap,
    /// Rotors at rest at the start, and µ₀ from 0 s to 10 s, including the fall.
    StartUp,
    /// Residuals without battery model.
    Uncompensated,
    /// Residuals with the rotor lag.
    LagAware,
}

impl TTestVariant {
    /// In the order of the table.
    pub const ALL: [Self; 5] = [
        Self::Paper,
        Self::InverseMap,
        Self::StartUp,
        Self::Uncompensated,
        Self::LagAware,
    ];

    /// Name in files.
    pub fn key(self) -> &'static str {
        match self {
            Self::Paper => "t-test",
            Self::InverseMap => "t-test-inverse-map",
            Self::StartUp => "t-test-start-up",
            Self::Uncompensated => "t-test-uncompensated",
            Self::LagAware => "t-test-lag-aware",
        }
    }

    /// Column header.
    pub fn title(self) -> &'static str {
        match self {
            Self::Paper => "linear map",
            Self::InverseMap => "inverse map",
            Self::StartUp => "start-up in µ₀",
            Self::Uncompensated => "no battery model",
            Self::LagAware => "lag-aware",
        }
    }

    fn model(self) -> NominalThrustModel {
        match self {
            Self::Uncompensated => NominalThrustModel::Linear,
            Self::LagAware => NominalThrustModel::Lagged,
            _ => NominalThrustModel::Static,
        }
    }

    /// Separate flights, if those of the networks are not suitable.
    fn own_flights(self) -> Option<(Conduct, [f64; 2])> {
        match self {
            Self::InverseMap => Some((
                Conduct {
                    thrust_to_duty: ThrustToDutyMap::InverseMap,
                    ..Conduct::STANDARD
                },
                CALIBRATION_S,
            )),
            Self::StartUp => Some((
                Conduct {
                    start: Start::MotorsOff,
                    ..Conduct::STANDARD
                },
                [0.0, CALIBRATION_S[1]],
            )),
            _ => None,
        }
    }
}

/// Calibration of the T-test and of self-calibrating networks, s ("during the first 10 seconds …, excluding the initial transient").
pub const CALIBRATION_S: [f64; 2] = [2.0, 10.0];

/// What to compute.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// Requested tables.
    pub items: BTreeSet<Item>,
    /// Additional networks, e.g. for figures.
    pub methods: BTreeSet<Method>,
    /// Seeds, one data set each.
    pub seeds: Vec<u64>,
    /// Threads.
    pub threads: NonZeroUsize,
    /// Epochs of the network of [32]; its learning rate is [`TRACKING_LEARNING`] over this.
    pub tracking_epochs: u32,
    /// Settings in place of the methods'; in range for each of them ([`Options::check`]).
    pub overrides: Overrides,
}

impl Options {
    /// Whether the overrides are in range.
    ///
    /// # Errors
    /// One sentence.
    pub fn check(&self, rotor_count: usize) -> Result<(), String> {
        self.all_methods().into_iter().try_for_each(|method| {
            self.overrides
                .apply(method.usual_training(rotor_count, self))
                .map(|_fits| ())
        })
    }

    /// All networks of the requested tables.
    fn all_methods(&self) -> Vec<Method> {
        let wanted = |method: &Method| {
            self.methods.contains(method) || self.items.iter().any(|item| item.methods().contains(method))
        };
        Method::ALL.into_iter().filter(wanted).collect()
    }

    fn all_t_tests(&self) -> Vec<TTestVariant> {
        let wanted = |variant: &TTestVariant| self.items.iter().any(|item| item.t_tests().contains(variant));
        TTestVariant::ALL.into_iter().filter(wanted).collect()
    }

    fn needs_standard_flights(&self) -> bool {
        !self.all_methods().is_empty() || self.all_t_tests().iter().any(|variant| variant.own_flights().is_none())
    }

    /// Number of calls of `done` of [`run`].
    pub fn jobs(&self, rotor_count: usize) -> u64 {
        let flights = Course::ALL.len() * CHARGES.len() * rotor_count;
        let own = self
            .all_t_tests()
            .iter()
            .filter(|variant| variant.own_flights().is_some())
            .count();
        let sets = own + usize::from(self.needs_standard_flights());
        let per_seed = sets * flights + self.all_methods().len() * Course::ALL.len();
        (per_seed * self.seeds.len()) as u64
    }
}

/// Results of one seed.
#[derive(Clone, Debug, PartialEq)]
pub struct SeedResult {
    /// The seed.
    pub seed: u64,
    /// Folds of each network, in the order of [`Course::ALL`].
    pub networks: BTreeMap<Method, Vec<Fold>>,
    /// Verdicts of each T-test after its calibration, in the order of [`Course::ALL`].
    pub t_tests: BTreeMap<TTestVariant, Vec<Confusion>>,
    /// The flights of the networks, without tracking errors.
    pub data: Option<DataSet>,
    /// Content hash over windows and labels of the paper's residuals.
    pub data_hash: String,
    /// Flights flown.
    pub flights: usize,
    /// Steps flown.
    pub steps: u64,
    /// Wall-clock time of the flights of the networks.
    pub generation: Duration,
    /// Total wall-clock time.
    pub wall: Duration,
}

/// The result of all seeds.
#[derive(Clone, Debug, PartialEq)]
pub struct Reproduction {
    /// Options used.
    pub options: Options,
    /// n_a.
    pub rotor_count: usize,
    /// Name of the base scenario.
    pub scenario: String,
    /// Deviations of the true vehicle from its document, human-readable.
    pub world: String,
    /// Name of the vehicle.
    pub vehicle: String,
    /// Content hash of vehicle and blades.
    pub model_hash: String,
    /// In the order of [`Options::seeds`].
    pub seeds: Vec<SeedResult>,
}

/// Computes the results requested by `options`. `done` is called from any thread whenever a flight or fold has finished. The error is
/// a message.
pub fn run(base: &Scenario, options: &Options, done: &(dyn Fn() + Sync)) -> Result<Reproduction, String> {
    let seeds = options
        .seeds
        .iter()
        .map(|seed| run_seed(base, options, *seed, done))
        .collect::<Result<_, String>>()?;
    Ok(of_seeds(base, options, seeds))
}

/// The flights of the networks for one seed, on which nothing is trained yet ([`classifiers::train`](crate::paper::classifiers::train)).
/// `done` is called after each flight. The error is a message.
pub fn fly_only(
    base: &Scenario,
    options: &Options,
    seed: u64,
    done: &(dyn Fn() + Sync),
) -> Result<Reproduction, String> {
    let collect = standard_windows(&options.all_methods());
    let data = DataSet::fly(base, Conduct::STANDARD, seed, &collect, options.threads, done)?;
    let result = SeedResult {
        seed,
        networks: BTreeMap::new(),
        t_tests: BTreeMap::new(),
        data_hash: Method::Paper.samples(&data).samples.content_hash(),
        flights: data.flights.len(),
        steps: data.steps(),
        generation: data.wall,
        wall: data.wall,
        data: Some(data),
    };
    Ok(of_seeds(base, options, vec![result]))
}

fn of_seeds(base: &Scenario, options: &Options, seeds: Vec<SeedResult>) -> Reproduction {
    Reproduction {
        options: options.clone(),
        rotor_count: base.fdi_config().geometry.rotor_count(),
        scenario: base.name().to_owned(),
        world: world(base),
        vehicle: base.vehicle().name.clone(),
        model_hash: rotortwin_flight::run_hash::model_hash(base),
        seeds,
    }
}

/// The mismatch of the base scenario, human-readable.
fn world(base: &Scenario) -> String {
    let mismatch = &base.document().mismatch;
    let preset = match mismatch.preset {
        MismatchPreset::None => "no mismatch",
        MismatchPreset::Paper => "the paper's mismatch",
        MismatchPreset::Realistic => "the realistic mismatch",
    };
    let size = Size::of(base.vehicle());
    if mismatch.magnitudes(size)
        == (MismatchModel {
            preset: mismatch.preset,
            ..MismatchModel::default()
        })
        .magnitudes(size)
    {
        preset.to_owned()
    } else {
        format!("{preset}, with magnitudes of its own")
    }
}

fn run_seed(base: &Scenario, options: &Options, seed: u64, done: &(dyn Fn() + Sync)) -> Result<SeedResult, String> {
    let start = Instant::now();
    let rotor_count = base.fdi_config().geometry.rotor_count();
    let methods = options.all_methods();
    let mut result = SeedResult {
        seed,
        networks: BTreeMap::new(),
        t_tests: BTreeMap::new(),
        data: None,
        data_hash: String::new(),
        flights: 0,
        steps: 0,
        generation: Duration::ZERO,
        wall: Duration::ZERO,
    };
    let mut fly = |conduct, collect: &Collect| {
        let data = DataSet::fly(base, conduct, seed, collect, options.threads, done)?;
        result.flights += data.flights.len();
        result.steps += data.steps();
        Ok::<_, String>(data)
    };
    let mut t_tests = BTreeMap::new();
    for variant in options.all_t_tests() {
        if let Some((conduct, calibration_s)) = variant.own_flights() {
            let collect = Collect {
                models: vec![variant.model()],
                calibration_s,
                attitude_errors: false,
            };
            t_tests.insert(variant, t_test_scores(&fly(conduct, &collect)?, variant));
        }
    }
    if options.needs_standard_flights() {
        let mut data = fly(Conduct::STANDARD, &standard_windows(&methods))?;
        for variant in options.all_t_tests() {
            if variant.own_flights().is_none() {
                t_tests.insert(variant, t_test_scores(&data, variant));
            }
        }
        result.generation = data.wall;
        result.networks = train_networks(&data, &methods, options, seed, rotor_count, done);
        result.data_hash = Method::Paper.samples(&data).samples.content_hash();
        for (_, flight) in &mut data.flights {
            flight.attitude_errors = Vec::new();
        }
        result.data = Some(data);
    }
    result.t_tests = t_tests;
    result.wall = start.elapsed();
    Ok(result)
}

/// What is kept of the flights of the networks.
fn standard_windows(methods: &[Method]) -> Collect {
    Collect {
        models: vec![
            NominalThrustModel::Static,
            NominalThrustModel::Lagged,
            NominalThrustModel::Linear,
        ],
        calibration_s: CALIBRATION_S,
        attitude_errors: methods.contains(&Method::TrackingErrors),
    }
}

fn train_networks(
    data: &DataSet,
    methods: &[Method],
    options: &Options,
    seed: u64,
    rotor_count: usize,
    done: &(dyn Fn() + Sync),
) -> BTreeMap<Method, Vec<Fold>> {
    let samples: BTreeMap<Method, GroupedSamples> =
        methods.iter().map(|method| (*method, method.samples(data))).collect();
    let jobs: Vec<(Method, Course)> = methods
        .iter()
        .flat_map(|method| Course::ALL.map(|course| (*method, course)))
        .collect();
    let train = |(method, course): &(Method, Course)| {
        let config = method.training(rotor_count, options);
        let seed = options.overrides.seed.unwrap_or(seed);
        fold(&samples[method], &config, rotor_count, Some(*course), seed)
    };
    let mut folds: BTreeMap<Method, Vec<Fold>> = BTreeMap::new();
    for ((method, _), fold) in jobs.iter().zip(map_in_order(options.threads, &jobs, train, done)) {
        folds.entry(*method).or_default().push(fold);
    }
    folds
}

/// Verdicts after the calibration, trajectory by trajectory.
fn t_test_scores(data: &DataSet, variant: TTestVariant) -> Vec<Confusion> {
    let mut scores = vec![Confusion::new(data.geometry.rotor_count()); Course::ALL.len()];
    for (plan, flight) in &data.flights {
        for (label, verdict) in flight.labels.iter().zip(&flight.of(variant.model()).t_test) {
            if *verdict != FaultVerdict::NotReady {
                scores[plan.course.index()].add(*label, *verdict);
            }
        }
    }
    scores
}
