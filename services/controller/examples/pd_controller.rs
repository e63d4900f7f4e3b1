//! A third-party controller in the loop: position and attitude PD around the hover duty, and nothing else.
//!
//! ```text
//! cargo build --release -p rotortwin-controller --example pd_controller
//! rotortwin fly config/scenarios/short-hover.toml --external controller      # prints a link and a run id
//! target/release/examples/pd_controller --link LINK --run-id RUN_ID
//! ```
//! It takes the vehicle parameters from the handshake, and rejects a run that it cannot fly. Limits: small angles, no
//! integrator, trimmed starts only. `docs/own-controller.md` explains the protocol.

use clap::Parser as _;
use rotortwin_controller::Args;
use rotortwin_proto::ControllerSetup;
use rotortwin_proto::controller_setup::ThrustToDuty;
use rotortwin_wire::frames::{CommandFrame, SensorFrame};
use rotortwin_wire::link::ControllerPeer;
use std::f32::consts::TAU;
use std::process::ExitCode;

/// (K_p 1/s², K_d 1/s) of a north, east or down axis; of roll and pitch; of yaw.
const POSITION: (f32, f32) = (4.0, 3.0);
const TILT: (f32, f32) = (150.0, 22.0);
const YAW: (f32, f32) = (5.0, 4.0);

/// Largest commanded roll or pitch, rad.
const MOST_TILT: f32 = 0.4;

/// One rotor: its position, and the torque about z per 1 N of its thrust.
struct Rotor {
    forward: f32,
    right: f32,
    yaw_ratio: f32,
}

#[derive(Default)]
struct PdController {
    mass: f32,
    inertia: [f32; 3],
    gravity: f32,
    rotors: Vec<Rotor>,
    hover_duty: f32,
    full_thrust: f32,
}

impl ControllerPeer for PdController {
    fn setup(&mut self, setup: &ControllerSetup) -> Result<(), String> {
        let body = setup
            .body
            .as_ref()
            .ok_or("expected the mass of the vehicle, there is none")?;
        if setup.trim_duty == 0.0 {
            return Err("expected a trimmed start (start = \"trimmed\"): this controller has no integrator".to_owned());
        }
        let Some(ThrustToDuty::FullThrustN(full_thrust)) = setup.thrust_to_duty else {
            return Err("expected thrust_to_duty = \"linear\", got the inverse map".to_owned());
        };
        let rotor = |it: &rotortwin_proto::Rotor| {
            let position = it.position_m.unwrap_or_default();
            // Spin +1 turns counter-clockwise seen from above and pushes the nose to the right.
            Rotor {
                forward: position.forward,
                right: position.right,
                yaw_ratio: it.spin as f32 * it.moment_ratio_m,
            }
        };
        *self = Self {
            mass: body.mass_kg,
            inertia: body
                .inertia_body_kg_m2
                .as_slice()
                .try_into()
                .map_err(|_wrong_length| "expected three moments of inertia")?,
            gravity: body.gravity_m_s2,
            rotors: setup.rotors.iter().map(rotor).collect(),
            hover_duty: setup.trim_duty,
            full_thrust,
        };
        Ok(())
    }

    fn step(&mut self, sensors: &SensorFrame) -> CommandFrame {
        let pd = |(p, d): (f32, f32), error: f32, error_rate: f32| p * error + d * error_rate;
        let [north, east, down] = [0, 1, 2].map(|i| {
            pd(
                POSITION,
                sensors.reference_position_ned_m[i] - sensors.position_ned_m[i],
                sensors.reference_velocity_ned_m_s[i] - sensors.velocity_ned_m_s[i],
            )
        });
        let [roll, pitch, yaw] = sensors.attitude_rad;
        // Nose down (pitch below 0) accelerates forward, right side down (roll above 0) to the right.
        let limited = |angle: f32| angle.clamp(-MOST_TILT, MOST_TILT);
        // The short way round.
        let wrapped = |angle: f32| angle - TAU * (angle / TAU).round();
        let setpoint = [
            limited((east * yaw.cos() - north * yaw.sin()) / self.gravity),
            limited(-(north * yaw.cos() + east * yaw.sin()) / self.gravity),
            sensors.reference_yaw_rad,
        ];
        let rates = sensors.body_rates_rad_s;
        let torque = [
            self.inertia[0] * pd(TILT, setpoint[0] - roll, -rates[0]),
            self.inertia[1] * pd(TILT, setpoint[1] - pitch, -rates[1]),
            self.inertia[2] * pd(YAW, wrapped(setpoint[2] - yaw), -rates[2]),
        ];
        let mut command = CommandFrame {
            attitude_setpoint_rad: setpoint,
            ..CommandFrame::default()
        };
        let sum = |of: fn(&Rotor) -> f32| self.rotors.iter().map(|rotor| of(rotor) * of(rotor)).sum::<f32>();
        let (right, forward, yaw_ratio) = (sum(|r| r.right), sum(|r| r.forward), sum(|r| r.yaw_ratio));
        for (duty, rotor) in command.duty.iter_mut().zip(&self.rotors) {
            // Thrust beyond hover, N: lift, plus each torque distributed by lever. Correct for layouts that are regular
            // polygons.
            let extra = -self.mass * down / self.rotors.len() as f32 - torque[0] * rotor.right / right
                + torque[1] * rotor.forward / forward
                + torque[2] * rotor.yaw_ratio / yaw_ratio;
            *duty = (self.hover_duty + extra / self.full_thrust).clamp(0.0, 1.0);
        }
        command
    }
}

fn main() -> ExitCode {
    // Runs the loop with the options of `rotortwin controller`.
    Args::parse()
        .peer
        .serve_controller("pd-controller", &mut PdController::default())
}
