//! Response of a controller's duties to a small change of one sensor value, and the expected response.

use rotortwin_flight_core::MAX_ROTORS;
use rotortwin_plant::vehicle::model::{RotorPlacement, SpinDirection};
use rotortwin_scenario::Scenario;
use rotortwin_wire::frames::SensorFrame;

/// Number of sensed motion values: position, velocity, attitude, body rates.
pub(super) const MOTION: usize = 12;
/// Duties of all rotors.
pub(super) type Duties = [f64; MAX_ROTORS];

/// Wrench axes, as accelerations.
pub(super) const UP: usize = 0;
pub(super) const ROLL: usize = 1;
pub(super) const PITCH: usize = 2;
pub(super) const YAW: usize = 3;

/// One value of a [`SensorFrame`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Input {
    /// Index into the motion values.
    Motion(usize),
    /// Reference position, 0 to 2.
    ReferencePosition(usize),
    /// Reference yaw.
    ReferenceYaw,
    /// Voltage of the battery.
    Voltage,
}

impl Input {
    /// Message field, as in `proto/rotortwin/v1`.
    pub(super) fn field(self) -> String {
        const AXES: [&str; 3] = ["north", "east", "down"];
        const ANGLES: [&str; 3] = ["roll", "pitch", "yaw"];
        const RATES: [&str; 3] = ["p", "q", "r"];
        match self {
            Self::Motion(i @ 0..3) => format!("position_ned_m.{}", AXES[i]),
            Self::Motion(i @ 3..6) => format!("velocity_ned_m_s.{}", AXES[i - 3]),
            Self::Motion(i @ 6..9) => format!("attitude_rad.{}", ANGLES[i - 6]),
            Self::Motion(i) => format!("body_rates_rad_s.{}", RATES[(i - 9) % 3]),
            Self::ReferencePosition(i) => format!("reference.position_ned_m.{}", AXES[i]),
            Self::ReferenceYaw => "reference.yaw_rad".to_owned(),
            Self::Voltage => "battery_voltage_v".to_owned(),
        }
    }

    /// Smallest and largest change tried, in the unit of the field.
    pub(super) fn sizes(self) -> [f64; 2] {
        match self {
            Self::Motion(0..6) | Self::ReferencePosition(_) => [0.001, 2.0],
            Self::Motion(6..9) | Self::ReferenceYaw => [0.0005, 0.3],
            Self::Motion(_) => [0.001, 2.0],
            Self::Voltage => [0.05, 0.5],
        }
    }

    /// Unit of the field.
    pub(super) fn unit(self) -> &'static str {
        match self {
            Self::Motion(0..3) | Self::ReferencePosition(_) => "m",
            Self::Motion(3..6) => "m/s",
            Self::Motion(6..9) | Self::ReferenceYaw => "rad",
            Self::Motion(_) => "rad/s",
            Self::Voltage => "V",
        }
    }

    /// Changes this value of a frame.
    pub(super) fn add(self, frame: &mut SensorFrame, change: f64) {
        let number = match self {
            Self::Motion(i @ 0..3) => &mut frame.position_ned_m[i],
            Self::Motion(i @ 3..6) => &mut frame.velocity_ned_m_s[i - 3],
            Self::Motion(i @ 6..9) => &mut frame.attitude_rad[i - 6],
            Self::Motion(i) => &mut frame.body_rates_rad_s[(i - 9) % 3],
            Self::ReferencePosition(i) => &mut frame.reference_position_ned_m[i],
            Self::ReferenceYaw => &mut frame.reference_yaw_rad,
            Self::Voltage => &mut frame.battery_voltage_v,
        };
        *number += change as f32;
    }

    /// Wrench axis that must respond to an increase, at yaw 0, and its sign: the vehicle must return.
    ///
    /// North of the reference: nose up. East of it: left side down. Below it: more thrust. Tilted, turned, or turning: opposing it.
    pub(super) fn answer(motion: usize) -> (usize, f64) {
        match motion {
            0 | 3 => (PITCH, 1.0),
            1 | 4 => (ROLL, -1.0),
            2 | 5 => (UP, 1.0),
            _ => (ROLL + motion % 3, -1.0),
        }
    }
}

/// Name of an axis of a wrench, and of the acceleration about or along it.
pub(super) fn axis_name(axis: usize) -> &'static str {
    ["thrust", "roll moment", "pitch moment", "yaw moment"][axis]
}

/// Effect of the duties on the vehicle's accelerations around hover.
#[derive(Clone, Debug)]
pub(super) struct Airframe {
    rotors: Vec<RotorPlacement>,
    /// N per unit of duty, at hover.
    slope_n: f64,
    mass_kg: f64,
    inertia_kg_m2: [f64; 3],
    /// g, m/s².
    pub(super) gravity: f64,
    /// First-order lag of the thrust, s.
    pub(super) lag_s: f64,
    hover_duty: f64,
    hover_thrust_n: f64,
}

impl Airframe {
    /// The nominal vehicle of a scenario at a voltage, hovering at a given duty.
    pub(super) fn new(scenario: &Scenario, hover_duty: f32, voltage_v: f32) -> Self {
        let vehicle = scenario.vehicle();
        let map = scenario.thrust_map();
        let thrust = |duty: f32| f64::from(map.thrust(duty, voltage_v));
        const STEP: f32 = 0.02;
        Self {
            rotors: vehicle.rotors.layout.placements(),
            slope_n: (thrust(hover_duty + STEP) - thrust(hover_duty - STEP)) / f64::from(2.0 * STEP),
            mass_kg: vehicle.body.mass_kg,
            inertia_kg_m2: vehicle.body.inertia_body_kg_m2,
            gravity: vehicle.body.gravity_m_s2,
            lag_s: vehicle.rotors.thrust_lag_s,
            hover_duty: f64::from(hover_duty),
            hover_thrust_n: thrust(hover_duty),
        }
    }

    pub(super) fn rotor_count(&self) -> usize {
        self.rotors.len()
    }

    /// Counter-clockwise, seen from above.
    pub(super) fn turns_ccw(&self, rotor: usize) -> bool {
        self.rotors[rotor].spin == SpinDirection::Ccw
    }

    /// Azimuth, degrees clockwise from the nose.
    pub(super) fn azimuth_deg(&self, rotor: usize) -> f64 {
        let [x, y, _] = self.rotors[rotor].position_body;
        y.atan2(x).to_degrees()
    }

    /// Thrust-to-weight ratio at the given duties, around hover.
    pub(super) fn lift(&self, duties: &Duties) -> f64 {
        let weight = self.mass_kg * self.gravity;
        let thrust = |duty: &f64| self.hover_thrust_n + self.slope_n * (duty - self.hover_duty);
        duties[..self.rotor_count()].iter().map(thrust).sum::<f64>() / weight
    }

    /// Accelerations (up, m/s²; roll, pitch, yaw, rad/s²) per unit duty of a rotor; `reversed`: bit i set, rotor i turns the other way.
    fn column(&self, rotor: usize, reversed: u32) -> [f64; 4] {
        let mut arm = self.rotors[rotor].torque_arm([0.0; 3], 1.0);
        if reversed >> rotor & 1 == 1 {
            arm[2] = -arm[2];
        }
        let j = self.inertia_kg_m2;
        [
            self.slope_n / self.mass_kg,
            self.slope_n * arm[0] / j[0],
            self.slope_n * arm[1] / j[1],
            self.slope_n * arm[2] / j[2],
        ]
    }

    /// Accelerations of a change of duties.
    pub(super) fn accelerations(&self, duties: &Duties) -> [f64; 4] {
        let mut sum = [0.0; 4];
        for rotor in 0..self.rotor_count() {
            let column = self.column(rotor, 0);
            for axis in 0..4 {
                sum[axis] += column[axis] * duties[rotor];
            }
        }
        sum
    }

    /// Minimum-norm change of duties that produces one unit on each axis alone: Bᵀ(BBᵀ)⁻¹, by axis; `None`: the rotors do not span four axes.
    pub(super) fn patterns(&self, reversed: u32) -> Option<[Duties; 4]> {
        let columns: Vec<[f64; 4]> = (0..self.rotor_count()).map(|i| self.column(i, reversed)).collect();
        let mut gram = [[0.0; 8]; 4];
        for (row, line) in gram.iter_mut().enumerate() {
            for (other, cell) in line.iter_mut().enumerate().take(4) {
                *cell = columns.iter().map(|column| column[row] * column[other]).sum();
            }
            line[4 + row] = 1.0;
        }
        invert(&mut gram)?;
        let mut patterns = [[0.0; MAX_ROTORS]; 4];
        for (axis, pattern) in patterns.iter_mut().enumerate() {
            for (rotor, column) in columns.iter().enumerate() {
                pattern[rotor] = (0..4).map(|k| column[k] * gram[k][4 + axis]).sum();
            }
        }
        Some(patterns)
    }
}

/// Gauss–Jordan elimination on four rows; the right half becomes the inverse.
fn invert(rows: &mut [[f64; 8]; 4]) -> Option<()> {
    let scale = rows.iter().flatten().fold(0.0, |most: f64, x| most.max(x.abs()));
    for pivot in 0..4 {
        let best = (pivot..4).max_by(|&a, &b| rows[a][pivot].abs().total_cmp(&rows[b][pivot].abs()))?;
        rows.swap(pivot, best);
        let value = rows[pivot][pivot];
        if value.abs() <= 1e-12 * scale {
            return None;
        }
        rows[pivot] = rows[pivot].map(|x| x / value);
        let line = rows[pivot];
        for (row, other) in rows.iter_mut().enumerate() {
            let factor = other[pivot];
            if row != pivot {
                for (x, y) in other.iter_mut().zip(line) {
                    *x -= factor * y;
                }
            }
        }
    }
    Some(())
}

/// Norm of a change of duties.
pub(super) fn length(duties: &Duties) -> f64 {
    duties.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// Cosine between two changes of duties; 0 if either is zero.
pub(super) fn cosine(a: &Duties, b: &Duties) -> f64 {
    let product = length(a) * length(b);
    if product == 0.0 {
        return 0.0;
    }
    a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>() / product
}

/// All responses measured by changing one value at a time around hover.
#[derive(Clone, Debug)]
pub(super) struct Responses {
    /// Change of the duties per unit of each motion value, at yaw 0.
    pub(super) motion: [Duties; MOTION],
    /// Change of the duties per metre north of the reference with the vehicle yawed by [`TURN_RAD`].
    pub(super) turned_north: Duties,
    /// Steps from a change of the sensors to the first change of the duties.
    pub(super) delay_steps: usize,
}

/// Heading at which the response to position errors is measured again, rad.
pub(super) const TURN_RAD: f64 = 0.3;

/// Angle by which the response to a position error turns in the body frame between two headings, rad, clockwise from above: for a correct
/// controller, minus the change of heading. `None`: no response in one of the two.
pub(super) fn turn(airframe: &Airframe, north: &Duties, turned_north: &Duties, axes: &[f64; 4]) -> Option<f64> {
    let angle = |duties: &Duties| {
        let accelerations = airframe.accelerations(duties);
        let forward = axes[PITCH] * accelerations[PITCH];
        let right = -axes[ROLL] * accelerations[ROLL];
        (forward.hypot(right) > 0.0).then(|| right.atan2(forward))
    };
    Some(wrap(angle(turned_north)? - angle(north)?))
}

/// Wraps to (−π, π].
pub(super) fn wrap(angle: f64) -> f64 {
    let turn = std::f64::consts::TAU;
    angle - turn * (angle / turn).round()
}
