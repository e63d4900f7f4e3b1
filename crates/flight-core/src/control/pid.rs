//! Gains and integrators of three independent PID axes (Table 5).

/// Gains of one axis; the output is an acceleration, m/s² or rad/s².
///
/// Table 5 prints no units; {Kp, Ki, Kd} are the coefficients of (s+1)(s+1.3)(s+1.6) and (s+8)(s+9)(s+10), which only
/// makes sense for an acceleration output.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PidGains {
    /// Kp, 1/s².
    pub proportional: f32,
    /// Ki, 1/s³.
    pub integral: f32,
    /// Kd, 1/s.
    pub derivative: f32,
}

impl PidGains {
    /// All gains zero.
    pub const NONE: Self = Self {
        proportional: 0.0,
        integral: 0.0,
        derivative: 0.0,
    };
}

/// Integrators of three axes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct PidState {
    /// ∫e dt.
    pub(super) integral: [f32; 3],
}

impl PidState {
    pub(super) const ZERO: Self = Self { integral: [0.0; 3] };

    /// Kp e + Ki ∫e dt + Kd ė per axis; the integrators are updated after use, without anti-windup.
    ///
    /// * `error`: e   * `error_rate`: ė, taken as measured and never differentiated here   * `period`: dt, s
    #[inline(always)]
    pub(super) fn step(
        &mut self,
        gains: &[PidGains; 3],
        error: [f32; 3],
        error_rate: [f32; 3],
        period: f32,
    ) -> [f32; 3] {
        let mut output = [0.0; 3];
        for axis in 0..3 {
            let k = &gains[axis];
            output[axis] =
                k.proportional * error[axis] + k.integral * self.integral[axis] + k.derivative * error_rate[axis];
            self.integral[axis] += error[axis] * period;
        }
        output
    }
}
