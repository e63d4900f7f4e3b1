//! A Betaflight hexarotor as the plant sees it, written from docs/autopilots.md alone: its packets, and a loop that levels itself by stick.

/// A packet of motors of a hexarotor.
pub(crate) fn motors(pulses_us: [f32; 6]) -> Vec<u8> {
    let mut bytes = vec![6, 0, 0, 0];
    bytes.extend(pulses_us.iter().flat_map(|pulse| pulse.to_le_bytes()));
    bytes.resize(68, 0);
    bytes
}

/// Channels, µs, of a packet of sticks.
pub(crate) fn channels(bytes: &[u8]) -> [u16; 16] {
    assert_eq!(bytes.len(), 40);
    std::array::from_fn(|i| u16::from_le_bytes([bytes[8 + 2 * i], bytes[9 + 2 * i]]))
}

/// Where the motors of HEX6X sit, degrees clockwise from the nose, and whether they turn clockwise, by channel: docs/autopilots.md.
const HEX6X: [(f64, bool); 6] = [
    (150.0, false),
    (30.0, false),
    (-150.0, true),
    (-30.0, true),
    (90.0, true),
    (-90.0, false),
];

/// A Betaflight that levels itself: sticks to tilts and a yaw rate, these to rates, rates to motors.
#[derive(Default)]
pub(crate) struct Leveller {
    sticks: Option<[u16; 16]>,
    /// It started with the arm switch on, and waits for it to be off once.
    blocked: bool,
}

impl Leveller {
    /// Takes in sticks.
    pub(crate) fn take(&mut self, sticks: [u16; 16]) {
        self.blocked &= sticks[4] > 1500;
        self.sticks = Some(sticks);
    }

    /// Its process ends and starts again.
    pub(crate) fn restart(&mut self) {
        (self.sticks, self.blocked) = (None, true);
    }

    /// Pulses, µs, for one packet of state.
    pub(crate) fn pulses(&self, state: &[u8]) -> [f32; 6] {
        let number = |i: usize| f64::from_le_bytes(state[8 * i..8 * i + 8].try_into().expect("eight bytes"));
        let Some(sticks) = self.sticks.filter(|sticks| sticks[4] > 1500 && !self.blocked) else {
            return [1000.0; 6];
        };
        let stick = |i: usize| (f64::from(sticks[i]) - 1500.0) / 500.0;
        let (p, q, r) = (number(1), number(2), -number(3));
        let [roll, pitch] = tilt([7, 8, 9, 10].map(number));
        let (full_tilt, full_yaw) = (60f64.to_radians(), 100f64.to_radians());
        let wanted = [
            5.0 * (full_tilt * stick(0) - roll),
            5.0 * (-full_tilt * stick(1) - pitch),
            full_yaw * stick(3),
        ];
        let torque = [0.03 * (wanted[0] - p), 0.03 * (wanted[1] - q), 0.2 * (wanted[2] - r)];
        let throttle = (f64::from(sticks[2]) - 1000.0) / 1000.0;
        HEX6X.map(|(degrees, clockwise)| {
            let (sin, cos) = degrees.to_radians().sin_cos();
            let turn = if clockwise { -torque[2] } else { torque[2] };
            let share = throttle - torque[0] * sin + torque[1] * cos + turn;
            (1000.0 + 1000.0 * share).clamp(1055.0, 2000.0) as f32
        })
    }
}

/// Roll and pitch, rad, from the quaternion that its compass is derived from: back by a quarter turn, and half a turn about x on both
/// sides.
fn tilt([a, b, c, d]: [f64; 4]) -> [f64; 2] {
    let k = std::f64::consts::SQRT_2;
    let [a, b, c, d] = [a, b, c, d].map(|x| k * x);
    let (w, x, y, z) = ((a - d) / 2.0, (b + c) / 2.0, (b - c) / 2.0, (a + d) / 2.0);
    let (y, z) = (-y, -z);
    [
        (2.0 * (w * x + y * z)).atan2(1.0 - 2.0 * (x * x + y * y)),
        (2.0 * (w * y - z * x)).clamp(-1.0, 1.0).asin(),
    ]
}
