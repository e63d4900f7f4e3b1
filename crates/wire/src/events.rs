//! Progress events of a run: one JSON object per line on the plant's standard output.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// One event of a run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(tag = "event", rename_all = "kebab-case")]
pub enum RunEvent {
    /// The link is being opened, waiting for the peers.
    Waiting,
    /// Step 0 is about to be flown, or progress of the flight.
    Progress(Progress),
    /// A notable change.
    Change(Change),
    /// A row of the telemetry, for live viewers (`--live`).
    Sample(LiveSample),
    /// The flight is over and its folder is being written.
    Recording {
        /// Complete steps.
        steps: u64,
    },
    /// The folder is complete. Its summary states how the run ended.
    Finished,
}

/// A row of the telemetry.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct LiveSample {
    /// Step number, from 0.
    pub step: u64,
    /// Simulated time at the start of the step, s.
    pub sim_time_s: f64,
    /// One value for each of `rotortwin_store::telemetry_columns`, in their order; none if it is not finite.
    pub values: Vec<Option<f64>>,
}

/// Progress of the flight, and its current state.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[schema(as = RunProgress)]
pub struct Progress {
    /// Complete steps.
    pub step: u64,
    /// Steps of the whole flight.
    pub step_count: u64,
    /// Simulated time of the last complete step, s.
    pub sim_time_s: f64,
    /// Measured voltage, V.
    pub battery_voltage_v: f32,
    /// True state of charge, fraction.
    pub state_of_charge: f64,
    /// Truth: 0 no fault, i rotor i, −1 several.
    pub fault_label: i32,
    /// Verdict codes: −3 ambiguous, −2 not ready, −1 unknown, 0 healthy, i rotor i, 100 i + j rotors i and j.
    pub t_test: i32,
    /// Verdict of the network; codes as for `t_test`.
    pub network: i32,
    /// Verdict of the sequential detector; codes as for `t_test`.
    pub sequential: i32,
}

/// A notable event.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[schema(as = RunChange)]
#[serde(tag = "what", rename_all = "kebab-case")]
pub enum Change {
    /// The truth changed: a fault began or ended.
    Truth {
        /// s.
        sim_time_s: f64,
        /// 0 no fault, i rotor i, −1 several.
        fault_label: i32,
    },
    /// A load was dropped.
    Load {
        /// s.
        sim_time_s: f64,
        /// kg.
        mass_kg: f64,
    },
    /// The sequential detector changed its verdict.
    Verdict {
        /// s.
        sim_time_s: f64,
        /// Verdict code.
        sequential: i32,
        /// Its probability according to the detector, fraction.
        probability: f32,
        /// Bit i set: rotor i (from 0) is or may be faulty.
        suspect_rotors: u32,
    },
    /// Loss of thrust of the rotor named by the sequential detector: sent once, when the name has been stable for
    /// long enough. In the first windows the detector does not know when within a window the loss began, so an early
    /// estimate is unreliable.
    Severity {
        /// s.
        sim_time_s: f64,
        /// Verdict code.
        sequential: i32,
        /// Estimated loss of thrust, N; for a pair that of the first rotor.
        thrust_loss_n: f32,
        /// Lower end of its 95 % interval, N.
        thrust_loss_low_n: f32,
        /// Upper end, N.
        thrust_loss_high_n: f32,
    },
    /// An autopilot with its own clock has armed, climbed and settled at the first point: the flight begins.
    HandOver {
        /// Simulated time before it, s.
        prelude_s: f64,
    },
    /// A message from an autopilot, or from the pilot that commands it.
    Words {
        /// Since the start of the plant, prelude included, s.
        plant_time_s: f64,
        /// One line.
        text: String,
    },
    /// An accident on the ground.
    Ground {
        /// End of the step in which it happened, s.
        sim_time_s: f64,
        /// Kind of mishap.
        mishap: Mishap,
    },
}

/// Kinds of accidents on the ground.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[schema(as = GroundMishap)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum Mishap {
    /// Touched down too fast.
    HardLanding {
        /// Along the normal of the ground, m/s.
        speed_m_s: f64,
    },
    /// Lying on its side or back.
    TipOver {
        /// Relative to the ground, rad.
        tilt_rad: f64,
    },
    /// A rotor's disc reached the ground.
    RotorStrike {
        /// From 1.
        rotor: usize,
    },
}
