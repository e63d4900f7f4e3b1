//! Parameters of the sequential detector, and their validation.

/// Maximum number of filter updates per window.
pub const MAX_UPDATES_PER_WINDOW: u8 = 8;

/// Initial fraction of the warm-up excluded from the noise measurement: the first commands of a flight are jumps.
pub(super) const NOISE_SKIP: f32 = 0.25;

/// Minimum number of samples for measuring the sensor noise: gives its standard deviation to a few per cent.
const LEAST_NOISE_SAMPLES: f32 = 200.0;

/// Parameters of the sequential detector. [`SequentialConfig::standard`] is the single tuning for all vehicles and weather.
///
/// Forces are fractions of a rotor's mean hover thrust (m g/n_a) and lengths fractions of the longest lever, so that the values do not
/// depend on the size of the vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SequentialConfig {
    /// End of the noise measurement, start of the calibration, s after the first sample; long enough for the start-up to be over.
    pub calibration_start: f32,
    /// End of the calibration, s; verdicts follow. At least two correlation times of the gusts after the start.
    pub calibration_end: f32,
    /// Filter updates per window, 1 to [`MAX_UPDATES_PER_WINDOW`]. With 2, half of the sudden faults are isolated within one window;
    /// more cost time without benefit.
    pub updates_per_window: u8,
    /// τ, s, above 0: initial value of the adaptation.
    pub rotor_time_constant: f32,
    /// Standard deviation of ln τ.
    pub rotor_time_constant_spread: f32,
    /// Standard deviation of the relative error of mass, inertia and moment ratio.
    pub gain_spread: f32,
    /// Standard deviation of the centre of mass, share of the longest lever.
    pub centre_of_mass_spread: f32,
    /// Standard deviation of the vertical drag, N·s/m per kg.
    pub drag_spread: f32,
    /// Standard deviation of the constant disturbance of an axis, share of the hover thrust.
    pub bias_spread: f32,
    /// T, correlation time of the gusts, s. The level is learnt, T is not: one value was tested with gusts of 0.2 s to 20 s.
    pub disturbance_correlation_time: f32,
    /// Lowest gust level, fraction of the hover thrust. Bounds the smallest fault detectable in perfect calm.
    pub disturbance_floor: f32,
    /// Highest level, share of the hover thrust.
    pub disturbance_ceiling: f32,
    /// λ, evidence required to name a rotor, nats. In 55 h of simulated healthy flight, most of it with wind and wrong parameters,
    /// the evidence for some rotor exceeded 24 in one flight, where it fitted none.
    pub evidence_to_isolate: f32,
    /// Lead over the next best rotor required to name one, nats.
    pub margin_to_isolate: f32,
    /// Log likelihood that a second rotor must add before a single one no longer suffices, nats.
    pub evidence_for_second: f32,
    /// By how much a pair of other rotors may be likelier than the single rotor named, nats: two simultaneous faults are rarer than
    /// one by this much. The reported probability weights the pair by these odds.
    pub handicap_of_pairs: f32,
    /// ln of the prior odds against a fault at any time, for the reported probability, nats.
    pub prior_log_odds: f32,
    /// Losses below this are not reported, share of the hover thrust.
    pub smallest_loss: f32,
    /// Time from the onset until a fault may be absorbed, s: its estimate has settled by then.
    pub settling_time: f32,
    /// Minimum standard deviation of the relative error of one rotor's thrust (10 mN of bias that ends where the rotor stops are 0.4
    /// %).
    pub rotor_gain_spread: f32,
    /// Squared standard deviation of the same quantity, assumed while calibrating.
    pub excursion_in_calibration: f32,
    /// Weight with which the constant disturbance found by the calibration is attributed to errors of the rotors' thrusts, 0 to 4.
    /// These would appear when thrusts leave hover, so manoeuvres count less in a vehicle with a large bias.
    pub bias_factor: f32,
    /// Loss of log likelihood for which the calibration still prefers a higher level, nats: caution after a short calibration.
    pub level_margin: f32,
    /// Adaptation rate of the level after the calibration, per nat. 0.036 follows a storm three times as strong within some seconds.
    pub level_gain: f32,
    /// Limit on the contribution of one block to the level, nats: a fault must not pass for a storm.
    pub level_clip: f32,
    /// Ratio of the variances of the two probes to the level in use, above 1.
    pub level_ratio: f32,
    /// Weight of a block in the average surprise that evidence is divided by, in (0, 1).
    pub surprise_weight: f32,
    /// Random walk of the bias, variance per second in squared levels, 1/s. Represents everything slower than T.
    pub drift_share: f32,
    /// Random walk of the defect per block, as a fraction of its measurement variance: keeps the filter gains from vanishing.
    pub momentum_noise_share: f32,
    /// Evidence above which a fault may be absorbed, nats; above `evidence_to_isolate`, so that a false alarm can pass.
    pub evidence_to_absorb: f32,
    /// Bonus of the rotor already known to be faulty when changes are compared, nats: a damaged propeller is likely to break further.
    /// Without it, a healing rotor and a failing opposite one differ in vertical force alone.
    pub repeat_bonus: f32,
    /// Time for which the evidence must fit several rotors equally, or none well, before the verdict is unknown, s.
    pub ambiguity_time: f32,
    /// Fraction of a rotor's evidence by which any other direction of force and torque may fit better. A torque half-way between two
    /// rotors of a hexarotor leaves a third; noise leaves a few nats, which are always allowed.
    pub unexplained_share: f32,
    /// A sample that differs from its neighbour by more than this many standard deviations of the noise is a spike; at most four in a
    /// row count as spikes.
    pub spike_sigma: f32,
}

impl SequentialConfig {
    /// Placeholder, to be filled with a configuration.
    pub(crate) const BLANK: Self = Self {
        calibration_start: 0.0,
        calibration_end: 0.0,
        updates_per_window: 0,
        rotor_time_constant: 0.0,
        rotor_time_constant_spread: 0.0,
        gain_spread: 0.0,
        centre_of_mass_spread: 0.0,
        drag_spread: 0.0,
        bias_spread: 0.0,
        disturbance_correlation_time: 0.0,
        disturbance_floor: 0.0,
        disturbance_ceiling: 0.0,
        evidence_to_isolate: 0.0,
        margin_to_isolate: 0.0,
        evidence_for_second: 0.0,
        handicap_of_pairs: 0.0,
        prior_log_odds: 0.0,
        smallest_loss: 0.0,
        settling_time: 0.0,
        rotor_gain_spread: 0.0,
        excursion_in_calibration: 0.0,
        bias_factor: 0.0,
        level_margin: 0.0,
        level_gain: 0.0,
        level_clip: 0.0,
        level_ratio: 0.0,
        surprise_weight: 0.0,
        drift_share: 0.0,
        momentum_noise_share: 0.0,
        evidence_to_absorb: 0.0,
        repeat_bonus: 0.0,
        ambiguity_time: 0.0,
        unexplained_share: 0.0,
        spike_sigma: 0.0,
    };

    /// The standard tuning.
    pub const fn standard() -> Self {
        Self {
            calibration_start: 2.0,
            calibration_end: 10.0,
            updates_per_window: 2,
            rotor_time_constant: 0.05,
            rotor_time_constant_spread: 0.15,
            gain_spread: 0.05,
            centre_of_mass_spread: 0.015,
            drag_spread: 0.065,
            bias_spread: 0.2,
            disturbance_correlation_time: 2.0,
            disturbance_floor: 2e-4,
            disturbance_ceiling: 0.6,
            evidence_to_isolate: 25.0,
            margin_to_isolate: 6.0,
            evidence_for_second: 10.0,
            handicap_of_pairs: 3.0,
            prior_log_odds: 12.0,
            smallest_loss: 0.0012,
            settling_time: 1.5,
            rotor_gain_spread: 0.003,
            excursion_in_calibration: 0.001,
            bias_factor: 1.0,
            level_margin: 4.0,
            level_gain: 0.036,
            level_clip: 1.5,
            level_ratio: 4.0,
            surprise_weight: 0.05,
            drift_share: 0.02,
            momentum_noise_share: 0.005,
            evidence_to_absorb: 45.0,
            repeat_bonus: 10.0,
            ambiguity_time: 1.0,
            unexplained_share: 0.2,
            spike_sigma: 15.0,
        }
    }

    /// Checks every value.
    ///
    /// * `period`: dt, s   * `window_len`: samples per decision
    pub fn check(&self, period: f32, window_len: u16) -> Result<(), SequentialConfigError> {
        let check = |ok: bool, field, expected| {
            if ok {
                Ok(())
            } else {
                Err(SequentialConfigError { field, expected })
            }
        };
        // Written so that NaN fails.
        let within = |x: f32, low: f32, high: f32| x >= low && x <= high;
        let noise_time = (1.0 - NOISE_SKIP) * self.calibration_start;
        check(
            noise_time >= LEAST_NOISE_SAMPLES * period && self.calibration_start <= 600.0,
            "calibration_start",
            "late enough for 200 samples in its last three quarters, 600 s at most",
        )?;
        check(
            self.disturbance_correlation_time > 10.0 * period && self.disturbance_correlation_time <= 100.0,
            "disturbance_correlation_time",
            "from ten periods to 100 s",
        )?;
        check(
            self.calibration_end >= self.calibration_start + 2.0 * self.disturbance_correlation_time
                && self.calibration_end <= 3600.0,
            "calibration_end",
            "two correlation times of the gusts after the start or later, 3600 s at most",
        )?;
        check(
            self.updates_per_window >= 1
                && self.updates_per_window <= MAX_UPDATES_PER_WINDOW
                && u16::from(self.updates_per_window) <= window_len,
            "updates_per_window",
            "from 1 to 8, and not more than samples in a window",
        )?;
        check(
            within(self.rotor_time_constant, 1e-3, 1.0),
            "rotor_time_constant",
            "from 0.001 to 1 s",
        )?;
        for (value, field) in [
            (self.rotor_time_constant_spread, "rotor_time_constant_spread"),
            (self.gain_spread, "gain_spread"),
            (self.centre_of_mass_spread, "centre_of_mass_spread"),
            (self.drag_spread, "drag_spread"),
            (self.rotor_gain_spread, "rotor_gain_spread"),
            (self.excursion_in_calibration, "excursion_in_calibration"),
            (self.smallest_loss, "smallest_loss"),
            (self.drift_share, "drift_share"),
            (self.momentum_noise_share, "momentum_noise_share"),
            (self.level_gain, "level_gain"),
            (self.unexplained_share, "unexplained_share"),
        ] {
            check(within(value, 0.0, 1.0), field, "from 0 to 1")?;
        }
        for (value, field) in [
            (self.margin_to_isolate, "margin_to_isolate"),
            (self.evidence_for_second, "evidence_for_second"),
            (self.handicap_of_pairs, "handicap_of_pairs"),
            (self.prior_log_odds, "prior_log_odds"),
            (self.level_margin, "level_margin"),
            (self.repeat_bonus, "repeat_bonus"),
        ] {
            check(within(value, 0.0, 1e3), field, "from 0 to 1000 nats")?;
        }
        check(within(self.bias_spread, 1e-3, 10.0), "bias_spread", "from 0.001 to 10")?;
        check(
            within(self.disturbance_floor, 1e-6, 1.0),
            "disturbance_floor",
            "from 0.000001 to 1",
        )?;
        check(
            within(self.disturbance_ceiling, 2.0 * self.disturbance_floor, 100.0),
            "disturbance_ceiling",
            "from twice the floor to 100",
        )?;
        check(
            within(self.evidence_to_isolate, 1.0, 1e3),
            "evidence_to_isolate",
            "from 1 to 1000 nats",
        )?;
        check(
            within(self.evidence_to_absorb, self.evidence_to_isolate, 1e4),
            "evidence_to_absorb",
            "from evidence_to_isolate to 10000 nats",
        )?;
        check(within(self.settling_time, 0.0, 60.0), "settling_time", "from 0 to 60 s")?;
        check(
            within(self.ambiguity_time, 0.0, 60.0),
            "ambiguity_time",
            "from 0 to 60 s",
        )?;
        check(within(self.bias_factor, 0.0, 4.0), "bias_factor", "from 0 to 4")?;
        check(
            within(self.level_clip, 0.01, 100.0),
            "level_clip",
            "from 0.01 to 100 nats",
        )?;
        check(within(self.level_ratio, 1.1, 100.0), "level_ratio", "from 1.1 to 100")?;
        check(
            within(self.surprise_weight, 1e-4, 1.0),
            "surprise_weight",
            "from 0.0001 to 1",
        )?;
        check(within(self.spike_sigma, 5.0, 1e6), "spike_sigma", "from 5 to 1000000")
    }
}

/// Calls a macro with the names of all fields of [`SequentialConfig`]: the single list for messages to processes and boards. The
/// macro's expansion must name every field, so that the compiler rejects an incomplete list.
#[macro_export]
macro_rules! with_sequential_fields {
    ($callback:ident) => {
        $callback!(
            calibration_start,
            calibration_end,
            updates_per_window,
            rotor_time_constant,
            rotor_time_constant_spread,
            gain_spread,
            centre_of_mass_spread,
            drag_spread,
            bias_spread,
            disturbance_correlation_time,
            disturbance_floor,
            disturbance_ceiling,
            evidence_to_isolate,
            margin_to_isolate,
            evidence_for_second,
            handicap_of_pairs,
            prior_log_odds,
            smallest_loss,
            settling_time,
            rotor_gain_spread,
            excursion_in_calibration,
            bias_factor,
            level_margin,
            repeat_bonus,
            evidence_to_absorb,
            momentum_noise_share,
            drift_share,
            level_gain,
            level_clip,
            level_ratio,
            surprise_weight,
            ambiguity_time,
            unexplained_share,
            spike_sigma,
        );
    };
}

/// Why a configuration of the sequential detector is rejected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SequentialConfigError {
    /// Field of [`SequentialConfig`].
    pub field: &'static str,
    /// The range, human-readable.
    pub expected: &'static str,
}

impl core::fmt::Display for SequentialConfigError {
    fn fmt(&self, out: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(out, "FDI: sequential.{} must be {}", self.field, self.expected)
    }
}

impl core::error::Error for SequentialConfigError {}
