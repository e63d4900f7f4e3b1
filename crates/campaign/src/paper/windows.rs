//! Flights condensed to the detectors' inputs: window means of the residuals, T-test verdicts, labels.
//!
//! ```text
//!  Scenario, seed ─▶ plant ⇄ PID controller ─▶ residual generators, one per rotor model ─▶ window ─▶ Window, Window, …
//! ```
//!
//! The same parts of `flight-core` as in [`FdiEngine`](rotortwin_flight_core::fdi::FdiEngine), combined so that one flight gives the
//! residuals of all rotor models at once; a test compares the two. No samples are kept, except the tracking errors of roll and pitch
//! if requested: a flight of 90 s takes 0.2 MB.

use rotortwin_flight_core::fdi::nominal_thrust::{NominalWrench, static_thrust};
use rotortwin_flight_core::fdi::residual::{BodyMomentum, RigidBody, WrenchObserver};
use rotortwin_flight_core::fdi::t_test::TTest;
use rotortwin_flight_core::fdi::window::{Baseline, WrenchStatistics};
use rotortwin_flight_core::fdi::{FaultVerdict, FdiConfig, NominalThrust, Residuals};
use rotortwin_flight_core::geometry::Geometry;
use rotortwin_plant::STEP_S;
use rotortwin_scenario::Scenario;
use rotortwin_scenario::settings::NominalThrustModel;
use rotortwin_wire::frames::{SensorFrame, Stamp};
use rotortwin_wire::link::ControllerPeer;
use rotortwin_wire::peers::PidPeer;

/// Data to collect from a flight.
#[derive(Clone, Debug, PartialEq)]
pub struct Collect {
    /// Rotor models whose residuals are requested.
    pub models: Vec<NominalThrustModel>,
    /// Start and end of the calibration of the T-test, s.
    pub calibration_s: [f64; 2],
    /// Tracking errors of roll and pitch, every step.
    pub attitude_errors: bool,
}

/// The residuals of one rotor model over a flight.
#[derive(Clone, Debug, PartialEq)]
pub struct ResidualWindows {
    /// Rotor model of the residual generators.
    pub model: NominalThrustModel,
    /// Mean of the 4-axis residual over each window.
    pub mean: Vec<[f32; 4]>,
    /// Its mean over the calibration time.
    pub baseline: [f32; 4],
    /// Verdict of the T-test at the end of each window.
    pub t_test: Vec<FaultVerdict>,
}

/// One flight.
#[derive(Clone, Debug, PartialEq)]
pub struct FlightWindows {
    /// Samples of a window.
    pub window_len: usize,
    /// Median of the fault labels of each window: 0 healthy, rotor from 1.
    pub labels: Vec<u8>,
    /// One for each of [`Collect::models`].
    pub residuals: Vec<ResidualWindows>,
    /// φ_r − φ and θ_r − θ as measured, rad, every step; empty if not requested.
    pub attitude_errors: Vec<[f32; 2]>,
    /// Steps flown.
    pub steps: u64,
}

/// Residual generator, window and T-test of one rotor model.
struct Channel {
    nominal: NominalWrench,
    observer: WrenchObserver,
    window: WrenchStatistics,
    baseline: Baseline,
    windows: ResidualWindows,
}

impl Channel {
    fn new(model: NominalThrustModel, config: &FdiConfig, scenario: &Scenario, collect: &Collect) -> Self {
        let rotors = &scenario.vehicle().rotors;
        let nominal = match model {
            NominalThrustModel::Static => NominalThrust::Static,
            NominalThrustModel::Lagged => NominalThrust::Lagged {
                time_constant: rotors.thrust_lag_s as f32,
            },
            NominalThrustModel::Linear => NominalThrust::Linear {
                full_thrust: rotors.full_thrust_n as f32,
            },
        };
        let [first, end] = collect.calibration_s.map(|time| libm::round(time / STEP_S) as u32);
        Self {
            nominal: NominalWrench::new(nominal, config.period),
            observer: WrenchObserver::new(config.observer_gain, config.period),
            window: WrenchStatistics::default(),
            baseline: Baseline::new(first, end),
            windows: ResidualWindows {
                model,
                mean: Vec::new(),
                baseline: [0.0; 4],
                t_test: Vec::new(),
            },
        }
    }
}

/// Flies `scenario` with the random numbers of `seed` and keeps the data requested by `collect`. The error is a message.
pub fn fly(scenario: &Scenario, seed: u64, collect: &Collect) -> Result<FlightWindows, String> {
    let config = scenario.fdi_config();
    let geometry = config.geometry;
    let rotor_count = geometry.rotor_count();
    let body = RigidBody {
        mass: config.mass,
        inertia_body: config.inertia_body,
        gravity: config.gravity,
        linear_drag: config.linear_drag,
        angular_drag: config.angular_drag,
    };
    let t_test =
        TTest::new(&config.t_test, config.window_len).ok_or("the significances of the T-test are not usable")?;
    let mut simulation = scenario.simulation(seed).map_err(|error| error.to_string())?;
    let mut controller = PidPeer::default();
    controller.setup(&rotortwin_flight::setup::run_setup(scenario, &simulation, 1).controller)?;
    let mut channels: Vec<Channel> = collect
        .models
        .iter()
        .map(|model| Channel::new(*model, &config, scenario, collect))
        .collect();
    let window_len = usize::from(config.window_len);
    let mut labels = Vec::new();
    let mut window_labels = Vec::with_capacity(window_len);
    let mut attitude_errors = Vec::new();
    while !simulation.done() {
        let sensed = simulation.sense();
        let label = simulation.truth().fault_label;
        let label = u8::try_from(label).map_err(|_several| "more than one rotor is faulty at a time".to_owned())?;
        let sensors =
            SensorFrame::new(Stamp::default(), &sensed.nav, &sensed.reference, sensed.battery_voltage).canonical();
        let command = controller.step(&sensors).canonical();
        let input = command.measurement(&sensors);
        if !input.nav.is_finite() {
            return Err(format!("step {}: the sensed state is not finite", sensed.step));
        }
        if collect.attitude_errors {
            attitude_errors.push([0, 1].map(|axis| command.attitude_setpoint_rad[axis] - sensors.attitude_rad[axis]));
        }
        let thrust = static_thrust(&config.thrust_map, rotor_count, &input);
        let static_wrench = geometry.wrench_from_thrust(&thrust);
        let momentum = BodyMomentum::from_nav(&body, &input.nav);
        window_labels.push(label);
        let window_end = window_labels.len() == window_len;
        for channel in &mut channels {
            let wrench = channel.nominal.step(&geometry, &input, &static_wrench);
            let residual = channel.observer.step(&momentum, &wrench);
            let calibrated = channel.baseline.mean();
            channel.baseline.push(&residual);
            channel.window.push(&residual);
            if window_end {
                channel.windows.mean.push(channel.window.mean());
                channel.windows.t_test.push(match calibrated {
                    Some(mean) => t_test.evaluate(&geometry, &channel.window, &mean),
                    None => FaultVerdict::NotReady,
                });
                channel.window.clear();
            }
        }
        if window_end {
            window_labels.sort_unstable();
            labels.push(window_labels[window_len / 2]);
            window_labels.clear();
        }
        simulation
            .advance(&command.command())
            .map_err(|error| error.to_string())?;
    }
    let residuals = channels
        .into_iter()
        .map(|channel| {
            let mut windows = channel.windows;
            windows.baseline = channel
                .baseline
                .mean()
                .ok_or("the flight ends before the calibration does")?;
            Ok(windows)
        })
        .collect::<Result<_, String>>()?;
    Ok(FlightWindows {
        window_len,
        labels,
        residuals,
        attitude_errors,
        steps: simulation.step(),
    })
}

impl FlightWindows {
    /// The windows of one rotor model, which must have been requested.
    pub fn of(&self, model: NominalThrustModel) -> &ResidualWindows {
        self.residuals
            .iter()
            .find(|windows| windows.model == model)
            .expect("this model was collected")
    }
}

impl ResidualWindows {
    /// Network input of window `i`: the 3 n_a residuals, with or without their calibration mean.
    pub fn network_input(&self, geometry: &Geometry, i: usize, self_calibrated: bool) -> Residuals {
        let mut mean = self.mean[i];
        if self_calibrated {
            for (mean, baseline) in mean.iter_mut().zip(&self.baseline) {
                *mean -= baseline;
            }
        }
        Residuals::from_wrench(geometry, &mean)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::paper::protocol::{Conduct, Course, FlightPlan, flight_scenario};
    use rotortwin_flight::lockstep::{self, FlightEnd, FlightObserver, StopReason};
    use rotortwin_flight::pace::Pace;
    use rotortwin_flight::sample::Sample;
    use rotortwin_scenario::Documents;
    use rotortwin_wire::link::in_process::InProcessLink;
    use rotortwin_wire::peers::FdiEnginePeer;

    /// Keeps the FDI engine's verdicts at the end of each window.
    #[derive(Default)]
    struct Verdicts {
        t_test: Vec<i32>,
        network: Vec<i32>,
        sum: [f64; 4],
        mean: Vec<[f64; 4]>,
    }

    impl FlightObserver for Verdicts {
        fn sample(&mut self, sample: &Sample) -> Result<(), String> {
            for (sum, x) in self.sum.iter_mut().zip(sample.report.wrench_residual) {
                *sum += f64::from(x) / 25.0;
            }
            if sample.report.window_end == 1 {
                self.t_test.push(sample.report.t_test);
                self.network.push(sample.report.network);
                self.mean.push(std::mem::take(&mut self.sum));
            }
            Ok(())
        }

        fn stop_requested(&mut self) -> Option<StopReason> {
            None
        }
    }

    /// Welford's recursion in f32 over 25 samples of up to 10 N·s compared with an f64 sum.
    const MEAN_TOLERANCE: f64 = 1e-5;

    fn base() -> Scenario {
        let path = concat!(
            env!("CARGO_MANIFEST_DIR"),
            "/../../config/scenarios/reference-flight.toml"
        );
        Scenario::load(path).expect("the reference flight is good")
    }

    #[test]
    fn val_windows_are_those_of_the_fdi_engine() {
        for model in [
            NominalThrustModel::Static,
            NominalThrustModel::Lagged,
            NominalThrustModel::Linear,
        ] {
            let plan = FlightPlan {
                course: Course::Waypoints,
                charge: 0.4,
                rotor: 4,
                seed: 11,
            };
            let scenario = flight_scenario(&base(), Conduct::STANDARD, &plan).expect("a good scenario");
            let mut documents: Documents = scenario.documents().clone();
            documents.scenario.fdi.nominal_thrust = model;
            documents.scenario.duration_s = 50.0;
            documents.scenario.fault.truncate(1);
            let scenario = Scenario::from_documents(&documents).expect("a good scenario");
            let mut simulation = scenario.simulation(11).expect("a good scenario");
            let setup = rotortwin_flight::setup::run_setup(&scenario, &simulation, 1);
            let mut link = InProcessLink::new(PidPeer::default(), FdiEnginePeer::default());
            let mut engine = Verdicts::default();
            let outcome = lockstep::fly(&mut simulation, &mut link, &setup, Pace::Fast, &mut engine);
            assert_eq!(outcome.end, FlightEnd::Done);

            let collect = Collect {
                models: vec![model],
                calibration_s: [2.0, 10.0],
                attitude_errors: true,
            };
            let windows = fly(&scenario, 11, &collect).expect("a good flight");
            assert_eq!((windows.steps, windows.labels.len()), (20_000, 800));
            assert_eq!(windows.attitude_errors.len(), 20_000);
            let codes: Vec<i32> = windows.of(model).t_test.iter().map(|verdict| verdict.code()).collect();
            assert_eq!(codes, engine.t_test, "{model:?}");
            for (got, want) in windows.of(model).mean.iter().zip(&engine.mean) {
                for (got, want) in got.iter().zip(want) {
                    assert!((f64::from(*got) - want).abs() < MEAN_TOLERANCE, "{got} {want}");
                }
            }
            // Blade b on rotor 5 from 45 s on, i.e. from window 720 on.
            assert!(windows.labels[..720].iter().all(|label| *label == 0));
            assert!(windows.labels[720..].iter().all(|label| *label == 5));
        }
    }

    /// A network's training inputs equal its inputs in flight, with and without self-calibration.
    #[test]
    fn val_network_verdicts_are_those_of_the_fdi_engine() {
        for name in ["reference-flight", "lag-aware-reference-flight"] {
            let path = format!("{}/../../config/scenarios/{name}.toml", env!("CARGO_MANIFEST_DIR"));
            let scenario = Scenario::load(path).expect("a good scenario");
            let mut simulation = scenario.simulation(5).expect("a good scenario");
            let setup = rotortwin_flight::setup::run_setup(&scenario, &simulation, 1);
            let mut link = InProcessLink::new(PidPeer::default(), FdiEnginePeer::default());
            let mut engine = Verdicts::default();
            lockstep::fly(&mut simulation, &mut link, &setup, Pace::Fast, &mut engine);

            let classifier = scenario.classifier().expect("the scenario names one");
            let network = classifier.network().expect("it was checked");
            let model = classifier.inputs.nominal_thrust;
            let collect = Collect {
                models: vec![model],
                calibration_s: [2.0, 10.0],
                attitude_errors: false,
            };
            let flown = fly(&scenario, 5, &collect).expect("a good flight");
            let windows = flown.of(model);
            let geometry = scenario.fdi_config().geometry;
            let verdicts: Vec<i32> = (0..flown.labels.len())
                .map(|i| {
                    if network.self_calibrated() && windows.t_test[i] == FaultVerdict::NotReady {
                        return FaultVerdict::NotReady.code();
                    }
                    let input = windows.network_input(&geometry, i, network.self_calibrated());
                    network.evaluate(&input).code()
                })
                .collect();
            assert_eq!(verdicts, engine.network, "{name}");
            assert_eq!(verdicts[0] == FaultVerdict::NotReady.code(), network.self_calibrated());
            assert!(verdicts.contains(&3), "{name}: the fault was not found");
        }
    }
}
