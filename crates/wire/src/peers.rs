//! Our own controller and FDI engine, as the peers of a link. They hold no truth and no scenario: only what the hand-shake brings.

use crate::frames::{CommandFrame, FdiReport, LossEstimate, SensorFrame, Stamp};
use crate::link::{ControllerPeer, FdiPeer};
use crate::setup;
use rotortwin_flight_core::control::Controller;
use rotortwin_flight_core::fdi::{self, FdiEngine};
use rotortwin_proto::{ControllerSetup, FdiSetup};

/// How our own controller calls itself, before its version.
const OUR_CONTROLLER: &str = "rotortwin-controller";

/// Whether a peer that calls itself so is [`PidPeer`], in whichever process.
pub fn is_our_controller(program: &str) -> bool {
    let rest = program.strip_prefix(OUR_CONTROLLER);
    rest.is_some_and(|rest| rest.is_empty() || rest.starts_with(' '))
}

/// The cascaded PID controller of `flight-core` (Table 5).
#[derive(Default)]
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
        // As the process of its own calls itself.
        format!("{OUR_CONTROLLER} {}", env!("CARGO_PKG_VERSION"))
    }
}

/// Residual generators, T-test, network and sequential detector of `flight-core`.
#[derive(Default)]
pub struct FdiEnginePeer {
    engine: Option<Box<FdiEngine>>,
}

impl FdiPeer for FdiEnginePeer {
    fn setup(&mut self, parameters: &FdiSetup) -> Result<(), String> {
        let config = setup::fdi_config(parameters)?;
        self.engine = Some(Box::new(FdiEngine::new(config).map_err(|error| error.to_string())?));
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

/// What the engine says of the step `stamp`, as a message.
#[inline]
pub fn report(stamp: Stamp, output: &fdi::FdiOutput) -> FdiReport {
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
