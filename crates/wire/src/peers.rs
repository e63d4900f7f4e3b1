//! Our own controller and FDI engine as link peers. They know neither truth nor scenario: only the handshake's parameters.

use crate::frames::{CommandFrame, FdiReport, LossEstimate, SensorFrame, Stamp};
use crate::link::{ControllerPeer, FdiPeer};
use crate::setup;
use rotortwin_flight_core::control::Controller;
use rotortwin_flight_core::fdi::{self, FdiConfig, FdiConfigError, FdiEngine, FdiOutput};
use rotortwin_flight_core::signals::Measurement;
use rotortwin_proto::{ControllerSetup, FdiSetup, Ground};

/// Name of our own controller, before its version.
const OUR_CONTROLLER: &str = "rotortwin-controller";

/// Whether a peer with this name is [`PidPeer`], in any process.
pub fn is_our_controller(program: &str) -> bool {
    let rest = program.strip_prefix(OUR_CONTROLLER);
    rest.is_some_and(|rest| rest.is_empty() || rest.starts_with(' '))
}

/// The cascaded PID controller of `flight-core` (Table 5).
#[derive(Clone, Default)]
pub struct PidPeer {
    controller: Option<Controller>,
}

impl ControllerPeer for PidPeer {
    fn setup(&mut self, parameters: &ControllerSetup) -> Result<(), String> {
        let (config, trim) = setup::controller_config(parameters)?;
        let mut controller = Controller::new(config).map_err(|error| error.to_string())?;
        if let Some(trim) = trim {
            controller.trim(trim.duty, trim.battery_voltage);
        }
        self.controller = Some(controller);
        Ok(())
    }

    #[inline]
    fn step(&mut self, sensors: &SensorFrame) -> CommandFrame {
        let controller = self
            .controller
            .as_mut()
            .expect("the link calls setup before the first step");
        let output = controller.step(&sensors.nav(), &sensors.reference(), sensors.battery_voltage_v);
        let setpoint = output.attitude_setpoint;
        CommandFrame {
            stamp: sensors.stamp,
            duty: output.command.duty,
            attitude_setpoint_rad: [setpoint.roll, setpoint.pitch, setpoint.yaw],
            saturated_rotors: output.saturated_rotors,
        }
    }

    fn program(&self) -> String {
        // As its own process reports itself.
        format!("{OUR_CONTROLLER} {}", env!("CARGO_PKG_VERSION"))
    }
}

/// A vehicle closer than this to its standing height counts as standing, m: rotors and ground then share its weight.
const STANDS_WITHIN: f32 = 0.1;
/// Time in the air before a calibration begins, s: the transient of the take-off.
const CLEAR_TIME: f32 = 2.0;

/// An FDI engine that only decides in the air, where there is ground that carries the vehicle.
///
/// Below [`STANDS_WITHIN`], by the measured position, and for [`CLEAR_TIME`] after that, its output has no verdict; then the engine is
/// reset, so that its calibration starts from there.
#[derive(Clone)]
pub struct AirborneEngine {
    engine: Box<FdiEngine>,
    landing: Option<Landing>,
}

#[derive(Clone)]
struct Landing {
    ground: Ground,
    /// The engine before its first sample.
    fresh: Box<FdiEngine>,
    clear_samples: u32,
    /// Samples until the engine starts.
    wait: u32,
    /// Samples of the current window without a verdict.
    samples: u16,
}

impl AirborneEngine {
    /// * `ground`: the ground under the vehicle
    pub fn new(config: FdiConfig, ground: Option<Ground>) -> Result<Self, FdiConfigError> {
        let engine = Box::new(FdiEngine::new(config)?);
        let landing = ground.map(|ground| Landing {
            ground,
            fresh: engine.clone(),
            clear_samples: (CLEAR_TIME / config.period).round() as u32,
            wait: 0,
            samples: 0,
        });
        Ok(Self { engine, landing })
    }

    /// Processes one sample.
    #[inline]
    pub fn step(&mut self, input: &Measurement) -> FdiOutput {
        match &mut self.landing {
            Some(landing) => landing.step(&mut self.engine, input),
            None => self.engine.step(input),
        }
    }
}

impl Landing {
    fn step(&mut self, engine: &mut FdiEngine, input: &Measurement) -> FdiOutput {
        let [north, east, down] = input.nav.position_ned.to_array();
        let ground = &self.ground;
        let height = ground.down_m + ground.slope_north * north + ground.slope_east * east - down;
        if height < ground.standing_height_m + STANDS_WITHIN {
            if self.wait == 0 {
                engine.clone_from(&self.fresh);
                self.samples = 0;
            }
            self.wait = self.clear_samples;
        } else if self.wait == 0 {
            return engine.step(input);
        } else {
            self.wait -= 1;
        }
        self.samples += 1;
        let window_end = self.samples == engine.config().window_len;
        if window_end {
            self.samples = 0;
        }
        FdiOutput {
            window_end,
            ..*engine.output()
        }
    }
}

/// Residual generators, T-test, network and sequential detector of `flight-core`.
#[derive(Clone, Default)]
pub struct FdiEnginePeer {
    engine: Option<AirborneEngine>,
}

impl FdiPeer for FdiEnginePeer {
    fn setup(&mut self, parameters: &FdiSetup) -> Result<(), String> {
        let config = setup::fdi_config(parameters)?;
        let engine = AirborneEngine::new(config, parameters.ground).map_err(|error| error.to_string())?;
        self.engine = Some(engine);
        Ok(())
    }

    #[inline]
    fn step(&mut self, sensors: &SensorFrame, command: &CommandFrame) -> FdiReport {
        let engine = self
            .engine
            .as_mut()
            .expect("the link calls setup before the first step");
        report(sensors.stamp, &engine.step(&command.measurement(sensors)))
    }
}

/// The engine's output for the step `stamp`, as a message.
#[inline]
pub fn report(stamp: Stamp, output: &FdiOutput) -> FdiReport {
    FdiReport {
        stamp,
        residuals_nms: output.residuals.component,
        wrench_residual: output.wrench_residual,
        t_test: output.t_test.code(),
        network: output.network.code(),
        sequential: output.sequential.code(),
        sequential_probability: output.sequential_probability,
        thrust_loss: loss_frame(&output.thrust_loss[0]),
        second_thrust_loss: loss_frame(&output.thrust_loss[1]),
        suspect_rotors: output.suspects.rotors,
        hypothesis_count: u32::from(output.suspects.hypothesis_count),
        hypothesis_rotors: output.suspects.hypotheses,
        window_end: u32::from(output.window_end),
    }
}

#[inline]
fn loss_frame(loss: &fdi::LossEstimate) -> LossEstimate {
    let share = loss.share();
    LossEstimate {
        loss_n: loss.loss,
        low_n: loss.low,
        high_n: loss.high,
        share: share[0],
        share_low: share[1],
        share_high: share[2],
    }
}
