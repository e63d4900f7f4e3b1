//! Fault detection and isolation (§4, §5): which propeller has lost thrust, from inertial data, duty and battery voltage alone.
//!
//! ```text
//!  Measurement ─▶ nominal_thrust ─▶ residual ─▶ window ─┬▶ t_test     ─┐
//!       │                                               └▶ network    ─┼─▶ FdiOutput
//!       └────────────────────────────────────────────────▶ sequential ─┘
//! ```
//!
//! [`FdiEngine::step`] takes one sample (400 Hz) and returns the residuals and three verdicts, which change only at the end of a
//! window (25 samples) and are held in between:
//!
//! * [`t_test`]: the paper's statistical test. * [`network`]: the paper's classifier, if weights are given.
//! * [`sequential`]: decides over time with a self-calibrated disturbance model; the one to leave switched on.
//!
//! Rejected samples: a measurement with a NaN or infinity (state, voltage, or the duty of a used rotor), or with a value beyond any
//! real flight (1000 m/s, 1000 rad/s, 1000 rad, 1000 V), never enters any state. The observers coast on their last rate for that
//! step, the window waits, residuals and verdicts are held, and [`FdiOutput::rejected_samples`] counts it.
//!
//! Glossary: *fault* is damage to a propeller, *failure* the loss of a rotor; *detect* decides that something is wrong, *isolate*
//! names the rotor; *baseline* is the healthy mean of a residual.

pub mod lanes;
pub mod network;
pub mod nominal_thrust;
pub mod residual;
pub mod sequential;
pub mod student_t;
pub mod t_test;
pub mod verdict_code;
pub mod window;

#[cfg(test)]
mod closed_loop;

pub use network::{Network, NetworkError, NetworkWeights, WeightTable};
pub use nominal_thrust::NominalThrust;
pub use residual::Residuals;
pub use sequential::{
    LossEstimate, MAX_HYPOTHESES, SequentialConfig, SequentialConfigError, SequentialDecision, Suspects,
};
pub use t_test::TTestConfig;

use crate::MAX_ROTORS;
use crate::geometry::Geometry;
use crate::signals::Measurement;
use crate::thrust_map::ThrustMap;
use nominal_thrust::{NominalWrench, static_thrust};
use residual::{BodyMomentum, RigidBody, WrenchObserver};
use sequential::{MAX_UPDATES_PER_WINDOW, SequentialDetector};
use t_test::TTest;
use window::{Baseline, WrenchStatistics};

/// Largest plausible magnitude of a velocity (m/s), rate (rad/s), angle (rad) or voltage (V).
const PLAUSIBLE: f32 = 1e3;

/// A detector's conclusion about the rotors.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum FaultVerdict {
    /// Still calibrating, or the detector has no parameters.
    #[default]
    NotReady,
    /// No fault.
    Healthy,
    /// One rotor has lost thrust.
    Faulty {
        /// Zero-based.
        rotor: u8,
    },
    /// Something is wrong, but neither a single rotor nor a pair fits.
    Unknown,
    /// Two rotors have lost thrust, and no other explanation comes close; only the sequential detector reports it.
    FaultyPair {
        /// Zero-based.
        first: u8,
        /// Zero-based, above `first`.
        second: u8,
    },
    /// Some rotors have lost thrust, but several sets of them explain it: see [`Suspects`]. Only the sequential detector reports it.
    Ambiguous,
}

/// Model of the healthy vehicle and tuning of the FDI engine.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FdiConfig {
    /// Rotor layout.
    pub geometry: Geometry,
    /// m, kg, above 0.
    pub mass: f32,
    /// Diagonal of J, kg·m², above 0, body.
    pub inertia_body: [f32; 3],
    /// g, m/s², above 0.
    pub gravity: f32,
    /// k_t, N·s/m, not negative; 0 in the paper.
    pub linear_drag: f32,
    /// k_r, N·m·s, not negative; 0 in the paper.
    pub angular_drag: f32,
    /// dt, s, from 0.1 ms to 50 ms; 2.5 ms in the paper.
    pub period: f32,
    /// Eq. 19 of a healthy propeller.
    pub thrust_map: ThrustMap,
    /// Rotor model of the residual generators; the sequential detector has its own.
    pub nominal_thrust: NominalThrust,
    /// h of H_i = h I, 1/s, above 0 and below 1/dt; 5 in the paper.
    pub observer_gain: f32,
    /// Samples per decision, from 2; 25 in the paper.
    pub window_len: u16,
    /// See [`TTestConfig`].
    pub t_test: TTestConfig,
    /// Trained classifier; without it the network's verdict stays [`FaultVerdict::NotReady`].
    pub network: Option<Network>,
    /// See [`SequentialConfig`].
    pub sequential: SequentialConfig,
}

impl FdiConfig {
    /// Placeholder without a vehicle, to be filled with a configuration.
    pub const BLANK: Self = Self {
        geometry: Geometry::BLANK,
        mass: 0.0,
        inertia_body: [0.0; 3],
        gravity: 0.0,
        linear_drag: 0.0,
        angular_drag: 0.0,
        period: 0.0,
        thrust_map: ThrustMap::BLANK,
        nominal_thrust: NominalThrust::Static,
        observer_gain: 0.0,
        window_len: 0,
        t_test: TTestConfig::BLANK,
        // Not None, whose bits are not all 0.
        network: Some(Network::BLANK),
        sequential: SequentialConfig::BLANK,
    };
}

/// Why a configuration is rejected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FdiConfigError {
    /// A number is not finite or out of range.
    OutOfRange {
        /// Field of [`FdiConfig`].
        field: &'static str,
        /// The range, human-readable.
        expected: &'static str,
    },
    /// The classifier was trained for a different number of rotors.
    NetworkRotorCount {
        /// Rotors of the vehicle.
        vehicle: usize,
        /// Rotors of the network.
        network: usize,
    },
    /// The sequential detector rejects its part.
    Sequential(SequentialConfigError),
}

impl core::fmt::Display for FdiConfigError {
    fn fmt(&self, out: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match *self {
            Self::OutOfRange { field, expected } => {
                write!(out, "FDI: {field} must be {expected}")
            }
            Self::NetworkRotorCount { vehicle, network } => write!(
                out,
                "FDI: the network was trained for {network} rotors, the vehicle has {vehicle}"
            ),
            Self::Sequential(error) => error.fmt(out),
        }
    }
}

impl core::error::Error for FdiConfigError {}

impl From<SequentialConfigError> for FdiConfigError {
    fn from(error: SequentialConfigError) -> Self {
        Self::Sequential(error)
    }
}

/// Output of one step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FdiOutput {
    /// r_i of this sample; held if it is rejected.
    pub residuals: Residuals,
    /// The 4-axis residual behind them (F_z, M_x, M_y, M_z), kg·m/s and kg·m²/s.
    pub wrench_residual: [f32; 4],
    /// Verdict of the T-test.
    pub t_test: FaultVerdict,
    /// Verdict of the network.
    pub network: FaultVerdict,
    /// Verdict of the sequential detector.
    pub sequential: FaultVerdict,
    /// Posterior probability of the sequential verdict, 0 to 1; 0 while it is not ready.
    pub sequential_probability: f32,
    /// Thrust lost by the rotor, or the two, that the sequential detector names, in the order of their numbers.
    pub thrust_loss: [LossEstimate; 2],
    /// Rotors that the sequential verdict concerns.
    pub suspects: Suspects,
    /// True on the last sample of a window: the verdicts are new.
    pub window_end: bool,
    /// Samples rejected so far.
    pub rejected_samples: u32,
}

impl FdiOutput {
    const NONE: Self = Self {
        residuals: Residuals::NONE,
        wrench_residual: [0.0; 4],
        t_test: FaultVerdict::NotReady,
        network: FaultVerdict::NotReady,
        sequential: FaultVerdict::NotReady,
        sequential_probability: 0.0,
        thrust_loss: [LossEstimate::NONE; 2],
        suspects: Suspects::NONE,
        window_end: false,
        rejected_samples: 0,
    };
}

/// Which detectors run; their verdicts are independent of each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Detectors {
    /// T-test (§5.3).
    pub t_test: bool,
    /// Network (§5.2), if there are weights.
    pub network: bool,
    /// Sequential detector.
    pub sequential: bool,
}

impl Detectors {
    /// All three.
    pub const ALL: Self = Self {
        t_test: true,
        network: true,
        sequential: true,
    };
    /// Residual generators only.
    pub const NONE: Self = Self {
        t_test: false,
        network: false,
        sequential: false,
    };
}

/// Residual generators and the three detectors.
#[derive(Clone, Copy, Debug)]
pub struct FdiEngine {
    config: FdiConfig,
    detectors: Detectors,
    body: RigidBody,
    nominal: NominalWrench,
    observer: WrenchObserver,
    window: WrenchStatistics,
    baseline: Baseline,
    t_test: TTest,
    sequential: SequentialDetector,
    /// Samples of a window after which the sequential detector updates.
    block_end: [u16; MAX_UPDATES_PER_WINDOW as usize],
    output: FdiOutput,
}

impl FdiEngine {
    /// An engine without a vehicle: its output is meaningless before [`FdiEngine::configure`]. All bits are 0, so that it takes no space in
    /// a board's image.
    pub const BLANK: Self = Self {
        config: FdiConfig::BLANK,
        detectors: Detectors::NONE,
        body: RigidBody {
            mass: 0.0,
            inertia_body: [0.0; 3],
            gravity: 0.0,
            linear_drag: 0.0,
            angular_drag: 0.0,
        },
        nominal: NominalWrench::BLANK,
        observer: WrenchObserver::new(0.0, 0.0),
        window: WrenchStatistics::EMPTY,
        baseline: Baseline::new(0, 0),
        t_test: TTest::BLANK,
        sequential: SequentialDetector::BLANK,
        block_end: [0; MAX_UPDATES_PER_WINDOW as usize],
        output: FdiOutput::NONE,
    };

    /// Checks the configuration and precomputes all constants.
    pub fn new(config: FdiConfig) -> Result<Self, FdiConfigError> {
        let mut engine = Self::BLANK;
        engine.configure(|own| {
            *own = config;
            Ok::<(), FdiConfigError>(())
        })?;
        Ok(engine)
    }

    /// Restarts in place with the configuration that `fill` writes: a board has no room for a second one. `fill` must set every field, as
    /// the fields still hold the previous configuration; all detectors run. After a rejected configuration the output is meaningless.
    pub fn configure<E: From<FdiConfigError>>(
        &mut self,
        fill: impl FnOnce(&mut FdiConfig) -> Result<(), E>,
    ) -> Result<(), E> {
        fill(&mut self.config)?;
        self.prepare().map_err(E::from)
    }

    #[inline(never)]
    fn prepare(&mut self) -> Result<(), FdiConfigError> {
        let config = &self.config;
        let check = |ok: bool, field, expected| {
            if ok {
                Ok(())
            } else {
                Err(FdiConfigError::OutOfRange { field, expected })
            }
        };
        let positive = |x: f32| x > 0.0 && x.is_finite();
        let not_negative = |x: f32| x >= 0.0 && x.is_finite();
        check(positive(config.mass), "mass", "above 0 kg")?;
        check(
            config.inertia_body.iter().all(|j| positive(*j)),
            "inertia_body",
            "above 0 kg·m² on each axis",
        )?;
        check(positive(config.gravity), "gravity", "above 0 m/s²")?;
        check(not_negative(config.linear_drag), "linear_drag", "0 N·s/m or more")?;
        check(not_negative(config.angular_drag), "angular_drag", "0 N·m·s or more")?;
        check(
            config.period >= 1e-4 && config.period <= 0.05,
            "period",
            "from 0.0001 to 0.05 s",
        )?;
        check(
            config.observer_gain > 0.0 && config.observer_gain * config.period < 1.0,
            "observer_gain",
            "above 0 and below one over the period",
        )?;
        check(config.window_len >= 2, "window_len", "2 samples or more")?;
        match config.nominal_thrust {
            NominalThrust::Static => {}
            NominalThrust::Lagged { time_constant } => {
                check(positive(time_constant), "nominal_thrust.time_constant", "above 0 s")?
            }
            NominalThrust::Linear { full_thrust } => {
                check(positive(full_thrust), "nominal_thrust.full_thrust", "above 0 N")?
            }
        }
        let samples = |seconds: f32| {
            let count = libm::roundf(seconds / config.period);
            (0.0..1e9).contains(&count).then_some(count as u32)
        };
        let (first, end) = match (
            samples(config.t_test.baseline_start),
            samples(config.t_test.baseline_end),
        ) {
            (Some(first), Some(end)) if first < end => (first, end),
            _ => {
                return Err(FdiConfigError::OutOfRange {
                    field: "t_test.baseline_start and baseline_end",
                    expected: "0 s or more, the end after the start",
                });
            }
        };
        let t_test = TTest::new(&config.t_test, config.window_len).ok_or(FdiConfigError::OutOfRange {
            field: "t_test.alpha_detect and alpha_isolate",
            expected: "significances between 0 and 1",
        })?;
        if let Some(network) = &config.network
            && network.rotor_count() != config.geometry.rotor_count()
        {
            return Err(FdiConfigError::NetworkRotorCount {
                vehicle: config.geometry.rotor_count(),
                network: network.rotor_count(),
            });
        }
        config.sequential.check(config.period, config.window_len)?;
        let u = config.sequential.updates_per_window;
        let mut block_end = [0; MAX_UPDATES_PER_WINDOW as usize];
        for k in 0..u {
            block_end[usize::from(k)] = (u32::from(config.window_len) * (u32::from(k) + 1) / u32::from(u)) as u16;
        }
        // Destructured, so that no field is forgotten.
        let Self {
            config: _,
            detectors,
            body,
            nominal,
            observer,
            window,
            baseline,
            t_test: own_t_test,
            sequential,
            block_end: own_block_end,
            output,
        } = self;
        *body = RigidBody {
            mass: config.mass,
            inertia_body: config.inertia_body,
            gravity: config.gravity,
            linear_drag: config.linear_drag,
            angular_drag: config.angular_drag,
        };
        *nominal = NominalWrench::new(config.nominal_thrust, config.period);
        *observer = WrenchObserver::new(config.observer_gain, config.period);
        *window = WrenchStatistics::EMPTY;
        *baseline = Baseline::new(first, end);
        *own_t_test = t_test;
        sequential.configure(
            &config.sequential,
            &config.geometry,
            body,
            config.period,
            config.window_len,
        );
        *own_block_end = block_end;
        *detectors = Detectors::ALL;
        *output = FdiOutput::NONE;
        Ok(())
    }

    /// The same engine running only these detectors; the verdicts of the others stay [`FaultVerdict::NotReady`]. For boards, where time is
    /// short; flights side by side ([`lanes`]) need all of them.
    #[must_use]
    pub const fn with_detectors(mut self, detectors: Detectors) -> Self {
        self.set_detectors(detectors);
        self
    }

    /// [`FdiEngine::with_detectors`] in place.
    pub const fn set_detectors(&mut self, detectors: Detectors) {
        self.detectors = detectors;
    }

    /// The configuration in use.
    #[inline]
    pub const fn config(&self) -> &FdiConfig {
        &self.config
    }

    /// Output of the last step.
    #[inline]
    pub const fn output(&self) -> &FdiOutput {
        &self.output
    }

    /// Processes one sample. Bounded work, no panic, no error: unusable samples are rejected and counted.
    #[inline]
    pub fn step(&mut self, input: &Measurement) -> FdiOutput {
        self.output.window_end = false;
        let geometry = &self.config.geometry;
        let rotor_count = geometry.rotor_count();
        if !is_usable(input, rotor_count) {
            self.output.rejected_samples = self.output.rejected_samples.saturating_add(1);
            self.observer.coast();
            self.sequential.coast();
            return self.output;
        }

        let thrust: [f32; MAX_ROTORS] = static_thrust(&self.config.thrust_map, rotor_count, input);
        let static_wrench = geometry.wrench_from_thrust(&thrust);
        let body = BodyMomentum::from_nav(&self.body, &input.nav);
        let wrench = self.nominal.step(geometry, input, &static_wrench);
        let residual = self.observer.step(&body, &wrench);
        self.output.wrench_residual = residual;
        self.output.residuals = Residuals::from_wrench(geometry, &residual);
        let calibrated = self.baseline.mean().is_some();
        self.baseline.push(&residual);
        self.window.push(&residual);
        if self.detectors.sequential {
            self.sequential.step(&body, &static_wrench, &thrust);
        }
        self.close(calibrated);
        self.output
    }

    /// Work due after a sample: the sequential detector's filters at the end of a block, the verdicts at the end of a window.
    ///
    /// * `calibrated`: the baseline calibration had ended before this sample
    #[inline]
    fn close(&mut self, calibrated: bool) {
        let geometry = &self.config.geometry;
        let count = self.window.count() as u16;
        if self.detectors.sequential && self.block_end.contains(&count) {
            self.sequential.close_block();
        }
        if count >= self.config.window_len {
            self.output.window_end = true;
            let calibrated = self.baseline.mean().filter(|_| calibrated);
            if let Some(mean) = calibrated.filter(|_| self.detectors.t_test) {
                self.output.t_test = self.t_test.evaluate(geometry, &self.window, &mean);
            }
            if let Some(network) = self.config.network.as_ref().filter(|_| self.detectors.network) {
                let mut mean = self.window.mean();
                let offset = if network.self_calibrated() {
                    calibrated
                } else {
                    Some([0.0; 4])
                };
                if let Some(offset) = offset {
                    for axis in 0..4 {
                        mean[axis] -= offset[axis];
                    }
                    self.output.network = network.evaluate(&Residuals::from_wrench(geometry, &mean));
                }
            }
            if self.detectors.sequential {
                self.sequential.decide();
                let decision = self.sequential.decision();
                self.output.sequential = decision.verdict;
                self.output.sequential_probability = decision.probability;
                self.output.thrust_loss = decision.thrust_loss;
                self.output.suspects = decision.suspects;
            }
            self.window.clear();
        }
    }
}

/// True if a measurement is safe to use: see the module documentation.
#[inline]
fn is_usable(input: &Measurement, rotor_count: usize) -> bool {
    // NaN and infinity fail the comparison.
    let plausible = |x: f32| x.abs() <= PLAUSIBLE;
    let nav = &input.nav;
    let v = nav.velocity_ned;
    let eta = nav.attitude;
    let w = nav.body_rates;
    plausible(v.x)
        && plausible(v.y)
        && plausible(v.z)
        && plausible(eta.roll)
        && plausible(eta.pitch)
        && plausible(eta.yaw)
        && plausible(w.x)
        && plausible(w.y)
        && plausible(w.z)
        && plausible(input.battery_voltage)
        && nav.position_ned.is_finite()
        && input.command.duty[..rotor_count].iter().all(|u| u.is_finite())
}

/// Reference vectors and their vehicle, for the tests of this module.
#[cfg(test)]
mod test_vectors {
    use super::*;
    use crate::frames::{EulerAngles, Vec3};
    use crate::signals::{MotorCommand, NavState};
    use std::string::String;
    use std::vec::Vec;

    pub(super) const PERIOD: f32 = 0.0025;

    fn text(file: &str) -> String {
        let path = std::format!("{}/../../tests/vectors/{file}", env!("CARGO_MANIFEST_DIR"));
        std::fs::read_to_string(path).expect("readable")
    }

    pub(super) fn json(file: &str) -> serde_json::Value {
        serde_json::from_str(&text(file)).expect("JSON")
    }

    /// Rows without the header.
    pub(super) fn csv(file: &str) -> Vec<Vec<f64>> {
        text(file)
            .lines()
            .skip(1)
            .map(|line| line.split(',').map(|x| x.trim().parse().expect("number")).collect())
            .collect()
    }

    pub(super) fn hexa_x() -> Geometry {
        Geometry::regular(6, 0.275, 0.016, core::f32::consts::FRAC_PI_6).expect("regular")
    }

    pub(super) fn blade_a() -> ThrustMap {
        ThrustMap::new([-1.4310e-2, 4.6339e-3, 1.0350e-4, -1.7318e-7], 5.2859).expect("Table 1")
    }

    pub(super) fn body() -> RigidBody {
        RigidBody {
            mass: 1.55,
            inertia_body: [0.0266, 0.0266, 0.0498],
            gravity: 9.81,
            linear_drag: 0.0,
            angular_drag: 0.0,
        }
    }

    pub(super) fn residual_input() -> Vec<Measurement> {
        let rows = csv("resid_input.csv");
        assert_eq!(rows.len(), 600);
        rows.iter()
            .map(|row| {
                let v: Vec<f32> = row.iter().map(|x| *x as f32).collect();
                let mut duty = [0.0; MAX_ROTORS];
                duty[..6].copy_from_slice(&v[13..19]);
                Measurement {
                    nav: NavState {
                        position_ned: Vec3::new(v[1], v[2], v[3]),
                        velocity_ned: Vec3::new(v[4], v[5], v[6]),
                        attitude: EulerAngles {
                            roll: v[7],
                            pitch: v[8],
                            yaw: v[9],
                        },
                        body_rates: Vec3::new(v[10], v[11], v[12]),
                    },
                    command: MotorCommand { duty },
                    battery_voltage: v[19],
                }
            })
            .collect()
    }
}
