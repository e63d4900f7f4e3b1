//! Rigid body for the closed-loop tests of this crate, in `f64` and Euler angles: independent of the project's plant, which the
//! detectors must not see, and of its quaternions. Each test adds the rotors, the battery and the noise that it needs.

/// A body in still air.
pub(crate) struct FreeBody {
    /// kg.
    pub(crate) mass: f64,
    /// m/s².
    pub(crate) gravity: f64,
    /// Principal moments, kg·m².
    pub(crate) inertia: [f64; 3],
}

impl FreeBody {
    /// Eq. 1 without drag: the derivative of p (NED), v (NED), η (roll, pitch, yaw), ω (FRD).
    ///
    /// * `wrench`: force along the body's z and torques, N and N·m   * `push`: external force (NED) and torque (FRD)
    pub(crate) fn rates(&self, x: &[f64; 12], wrench: &[f64; 4], push: &[f64; 6]) -> [f64; 12] {
        let (m, j) = (self.mass, self.inertia);
        let (sin_roll, cos_roll) = (libm::sin(x[6]), libm::cos(x[6]));
        let (sin_pitch, cos_pitch) = (libm::sin(x[7]), libm::cos(x[7]));
        let (sin_yaw, cos_yaw) = (libm::sin(x[8]), libm::cos(x[8]));
        let (p, q, r) = (x[9], x[10], x[11]);
        let down = [
            sin_roll * sin_yaw + cos_roll * cos_yaw * sin_pitch,
            cos_roll * sin_yaw * sin_pitch - cos_yaw * sin_roll,
            cos_roll * cos_pitch,
        ];
        let turn = q * sin_roll + r * cos_roll;
        [
            x[3],
            x[4],
            x[5],
            (down[0] * wrench[0] + push[0]) / m,
            (down[1] * wrench[0] + push[1]) / m,
            (down[2] * wrench[0] + push[2]) / m + self.gravity,
            p + turn * sin_pitch / cos_pitch,
            q * cos_roll - r * sin_roll,
            turn / cos_pitch,
            (wrench[1] + push[3] + (j[1] - j[2]) * q * r) / j[0],
            (wrench[2] + push[4] + (j[2] - j[0]) * r * p) / j[1],
            (wrench[3] + push[5] + (j[0] - j[1]) * p * q) / j[2],
        ]
    }
}
