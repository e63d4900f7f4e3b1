//! The body-rate loop of a scripted PX4, with the integrators and the limits that make it wind up on a test stand.
//!
//! ```text
//!  attitude error ─ P ─▶ rate error ─ P + ∫, bounded ─▶ torques ─ mixer, least squares ─▶ reduced until no motor is beyond its limits
//! ```
//! As PX4 describes its multicopter control, with its default gains: torques and thrust are fractions of a motor's range; a bound of 0.3 on
//! each integrator; what is beyond the limits is taken back from the thrust, then from roll, pitch and yaw, one after the other.

use super::autopilots::HEIGHT_M;
use rotortwin_flight_core::MAX_ROTORS;
use rotortwin_scenario::Scenario;

/// Roll, pitch, yaw: rad/s per rad; fraction per rad/s; fraction per rad.
const ATTITUDE: [f64; 3] = [6.5, 6.5, 2.8];
const RATE: [f64; 3] = [0.15, 0.15, 0.2];
const INTEGRAL: [f64; 3] = [0.2, 0.2, 0.1];
const INTEGRAL_LIMIT: f64 = 0.3;
/// The yaw may use this much beyond full duty, which is then taken from the thrust.
const YAW_MARGIN: f64 = 0.15;
/// First guess of the hovering duty; then of the height, per m, per m/s, per m·s.
const HOVER: f64 = 0.3;
const HEIGHT: [f64; 3] = [0.1, 0.1, 0.03];

/// Duties of the rotors, or a change of them per unit.
type Duties = [f64; MAX_ROTORS];

/// The loop.
pub(crate) struct RateLoop {
    rotors: usize,
    /// Of roll, pitch, yaw.
    mixer: [Duties; 3],
    /// Attitude that it wants, rad. On the stand it waits for it in vain, as for the end of a distance that only a tilt removes.
    wanted: [f64; 3],
    /// Whether its integrators integrate.
    integrates: bool,
    integral: [f64; 3],
    height_integral: f64,
    arms_s: f64,
    last_s: f64,
}

impl RateLoop {
    pub(crate) fn new(scenario: &Scenario, arms_s: f64, wanted: [f64; 3], integrates: bool) -> Self {
        let geometry = scenario.controller_config().geometry;
        let rotors = geometry.rotor_count();
        let mixer = [1, 2, 3].map(|axis| {
            let mut wrench = [0.0; 4];
            wrench[axis] = 1.0;
            let shares: Duties = geometry.allocate(wrench).map(f64::from);
            let size = (shares[..rotors].iter().map(|x| x * x).sum::<f64>() / (0.5 * rotors as f64)).sqrt();
            shares.map(|share| share / size)
        });
        Self {
            rotors,
            mixer,
            wanted,
            integrates,
            integral: [0.0; 3],
            height_integral: 0.0,
            arms_s,
            last_s: arms_s,
        }
    }

    /// Duties by rotor at `time_s`; 0 before it arms. Height and speed are those of NED, m and m/s.
    pub(crate) fn duties(
        &mut self,
        time_s: f64,
        (down_m, speed_down): (f64, f64),
        attitude: [f64; 3],
        rates: [f64; 3],
    ) -> [f32; MAX_ROTORS] {
        if time_s < self.arms_s {
            return [0.0; MAX_ROTORS];
        }
        let interval_s = time_s - self.last_s;
        self.last_s = time_s;
        let torque = [0, 1, 2].map(|axis| {
            let error = ATTITUDE[axis] * (self.wanted[axis] - attitude[axis]) - rates[axis];
            let torque = RATE[axis] * error + self.integral[axis];
            if self.integrates {
                let sum = self.integral[axis] + INTEGRAL[axis] * error * interval_s;
                self.integral[axis] = sum.clamp(-INTEGRAL_LIMIT, INTEGRAL_LIMIT);
            }
            torque
        });
        let height = (0.179 + (time_s - self.arms_s)).min(HEIGHT_M);
        let below = height + down_m;
        self.height_integral += below * interval_s;
        let thrust = HOVER + HEIGHT[0] * below + HEIGHT[1] * speed_down + HEIGHT[2] * self.height_integral;
        self.mixed(thrust.clamp(0.05, 0.9), torque).map(|duty| duty as f32)
    }

    /// Thrust and torques as duties within 0 … 1.
    fn mixed(&self, thrust: f64, torque: [f64; 3]) -> Duties {
        let mut even = [0.0; MAX_ROTORS];
        even[..self.rotors].fill(1.0);
        let mut duties = even.map(|share| share * thrust);
        for axis in [0, 1] {
            add(&mut duties, &self.mixer[axis], torque[axis]);
        }
        reduce(&mut duties, &even);
        relieve(&mut duties, &self.mixer[0], 1.0);
        relieve(&mut duties, &self.mixer[1], 1.0);
        add(&mut duties, &self.mixer[2], torque[2]);
        relieve(&mut duties, &self.mixer[2], 1.0 + YAW_MARGIN);
        reduce(&mut duties, &even);
        duties.map(|duty| duty.clamp(0.0, 1.0))
    }
}

/// Moves the duties along one axis until the excess is the same at both limits, or gone: the second, half step does that.
fn relieve(duties: &mut Duties, axis: &Duties, most: f64) {
    for share in [1.0, 0.5] {
        let by = share * excess(duties, axis, most);
        add(duties, axis, by);
    }
}

fn add(duties: &mut Duties, axis: &Duties, by: f64) {
    for (duty, share) in duties.iter_mut().zip(axis) {
        *duty += by * share;
    }
}

/// Takes thrust back, never adds some: there is no "air mode".
fn reduce(duties: &mut Duties, even: &Duties) {
    let by = excess(duties, even, 1.0);
    if by > 0.0 {
        return;
    }
    add(duties, even, by);
    let by = 0.5 * excess(duties, even, 1.0);
    add(duties, even, by);
}

/// The largest moves along an axis, to either side, that bring a motor back to its limit; their sum.
fn excess(duties: &Duties, axis: &Duties, most: f64) -> f64 {
    let (mut down, mut up): (f64, f64) = (0.0, 0.0);
    for (duty, share) in duties.iter().zip(axis) {
        if share.abs() < 1e-9 {
            continue;
        }
        let by = (duty.clamp(0.0, most) - duty) / share;
        (down, up) = (down.min(by), up.max(by));
    }
    down + up
}
