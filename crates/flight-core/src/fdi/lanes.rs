//! The FDI engines of several flights side by side: the per-sample work of [`FdiEngine::step`] for each flight in turn, in plain
//! branch-free loops that a compiler can vectorise over the lanes. Bit-identical results.
//!
//! Blocks and windows end every few samples; each lane's own [`FdiEngine`] then takes over:
//!
//! ```text
//!  engine ──seat──▶ rows ──step, step, …──▶ rows ──at the end of a block──▶ engine.close ──▶ rows …
//! ```

use super::nominal_thrust::{NominalWrench, lag};
use super::residual::{BodyMomentum, observe};
use super::sequential::MeterRows;
use super::window::{WrenchStatistics, dot};
use super::{FdiEngine, FdiOutput, PLAUSIBLE};
use crate::control::lanes::{MeasuredRows, SineRows, nav};

/// Per-sample state of `L` flights with `N` rotors.
#[derive(Clone, Debug)]
pub struct FdiRows<const N: usize, const L: usize> {
    observer_state: [[f32; L]; 4],
    observer_rate: [[f32; L]; 4],
    lag_state: [[f32; L]; 4],
    window_count: [u32; L],
    window_mean: [[f32; L]; 4],
    window_co_moment: [[f32; L]; 10],
    baseline_seen: [u32; L],
    baseline_count: [u32; L],
    baseline_mean: [[f32; L]; 4],
    meter: MeterRows<N, L>,
    samples: [u32; L],
    /// Non-zero while the sequential detector measures the sensor noise.
    warm_up: [u32; L],
    /// Non-zero if the calibration had ended before this sample.
    calibrated: [u32; L],
    /// Non-zero if this sample was the last of a window.
    pub window_end: [u32; L],

    momentum: [[f32; L]; 4],
    drift: [[f32; L]; 4],
    vertical_speed: [f32; L],
    static_thrust: [[f32; L]; N],
    static_wrench: [[f32; L]; 4],
    nominal_wrench: [[f32; L]; 4],

    /// Wrench residual of this sample (F_z, M_x, M_y, M_z), kg·m/s and kg·m²/s.
    pub wrench_residual: [[f32; L]; 4],
    /// r_i of this sample: arm, lever, yaw of the first rotor, then of the next.
    pub residuals: [[[f32; L]; 3]; N],
    /// Non-zero where [`FdiEngine::step`] would reject the sample, or where it exceeds the range of the branch-free functions: the
    /// lane cannot continue.
    pub outside: [u32; L],
}

#[inline(always)]
fn get<const K: usize, const L: usize>(rows: &[[f32; L]; K], lane: usize) -> [f32; K] {
    let mut values = [0.0; K];
    for i in 0..K {
        values[i] = rows[i][lane];
    }
    values
}

#[inline(always)]
fn set<const K: usize, const L: usize>(rows: &mut [[f32; L]; K], lane: usize, values: &[f32; K]) {
    for i in 0..K {
        rows[i][lane] = values[i];
    }
}

impl<const N: usize, const L: usize> FdiRows<N, L> {
    /// No flights yet.
    pub const NONE: Self = Self {
        observer_state: [[0.0; L]; 4],
        observer_rate: [[0.0; L]; 4],
        lag_state: [[0.0; L]; 4],
        window_count: [0; L],
        window_mean: [[0.0; L]; 4],
        window_co_moment: [[0.0; L]; 10],
        baseline_seen: [0; L],
        baseline_count: [0; L],
        baseline_mean: [[0.0; L]; 4],
        meter: MeterRows::NONE,
        samples: [0; L],
        warm_up: [0; L],
        calibrated: [0; L],
        window_end: [0; L],
        momentum: [[0.0; L]; 4],
        drift: [[0.0; L]; 4],
        vertical_speed: [0.0; L],
        static_thrust: [[0.0; L]; N],
        static_wrench: [[0.0; L]; 4],
        nominal_wrench: [[0.0; L]; 4],
        wrench_residual: [[0.0; L]; 4],
        residuals: [[[0.0; L]; 3]; N],
        outside: [0; L],
    };

    /// Takes over an engine that has seen at least one sample. False if it has not, or has a different number of rotors.
    pub fn seat(&mut self, lane: usize, engine: &FdiEngine) -> bool {
        let Some(state) = engine.observer.state else {
            return false;
        };
        if engine.config.geometry.rotor_count() != N {
            return false;
        }
        set(&mut self.observer_state, lane, &state);
        set(&mut self.observer_rate, lane, &engine.observer.rate);
        if let NominalWrench::Lagged(lag) = &engine.nominal {
            set(&mut self.lag_state, lane, &lag.state.unwrap_or_default());
        }
        self.window_count[lane] = engine.window.count;
        set(&mut self.window_mean, lane, &engine.window.mean);
        set(&mut self.window_co_moment, lane, &engine.window.co_moment);
        self.baseline_seen[lane] = engine.baseline.seen;
        self.baseline_count[lane] = engine.baseline.count;
        set(&mut self.baseline_mean, lane, &engine.baseline.mean);
        self.samples[lane] = engine.sequential.seat_meter(lane, &mut self.meter);
        self.warm_up[lane] = u32::from(engine.sequential.is_warming_up());
        true
    }

    /// Writes the lane's state back to its engine, which must be the one it came from.
    fn leave(&self, lane: usize, engine: &mut FdiEngine) {
        engine.observer.state = Some(get(&self.observer_state, lane));
        engine.observer.rate = get(&self.observer_rate, lane);
        if let NominalWrench::Lagged(lag) = &mut engine.nominal {
            lag.state = Some(get(&self.lag_state, lane));
        }
        engine.window = WrenchStatistics {
            count: self.window_count[lane],
            mean: get(&self.window_mean, lane),
            co_moment: get(&self.window_co_moment, lane),
        };
        engine.baseline.seen = self.baseline_seen[lane];
        engine.baseline.count = self.baseline_count[lane];
        engine.baseline.mean = get(&self.baseline_mean, lane);
        engine.sequential.leave_meter(lane, &self.meter, self.samples[lane]);
        engine.output.wrench_residual = get(&self.wrench_residual, lane);
        for i in 0..N {
            engine.output.residuals.component[i] = get(&self.residuals[i], lane);
        }
    }

    /// Does what [`FdiEngine::step`] does at the end of a block or window, if this lane's last sample ended one; call it once per
    /// lane after each [`FdiRows::step`]. True at the end of a window.
    #[inline]
    pub fn close(&mut self, lane: usize, engine: &mut FdiEngine) -> bool {
        let count = self.window_count[lane] as u16;
        let window_end = count >= engine.config.window_len;
        self.window_end[lane] = u32::from(window_end);
        if window_end || engine.block_end.contains(&count) {
            self.close_block(lane, engine);
        }
        window_end
    }

    /// Copies in the residuals of a sample that an engine has processed itself.
    pub fn set_output(&mut self, lane: usize, output: &FdiOutput) {
        set(&mut self.wrench_residual, lane, &output.wrench_residual);
        for i in 0..N {
            set(&mut self.residuals[i], lane, &output.residuals.component[i]);
        }
        self.window_end[lane] = u32::from(output.window_end);
    }

    #[inline(never)]
    fn close_block(&mut self, lane: usize, engine: &mut FdiEngine) {
        self.leave(lane, engine);
        engine.close(self.calibrated[lane] != 0);
        self.seat(lane, engine);
    }

    /// One sample of every lane. `shared`: any engine of the same configuration, which all lanes share.
    #[inline(always)]
    pub fn step(&mut self, shared: &FdiEngine, measured: &MeasuredRows<L>, sines: &SineRows<L>, duty: &[[f32; L]; N]) {
        self.prepare(shared, measured, sines, duty);
        self.apply_nominal(shared, duty);
        self.observe(shared);
        let (first, end) = (shared.baseline.first, shared.baseline.end);
        let mut calibrating = false;
        for lane in 0..L {
            let calibrated = self.baseline_seen[lane] >= end;
            self.calibrated[lane] = u32::from(calibrated);
            calibrating |= !calibrated;
        }
        if calibrating {
            self.calibrate(first, end);
        }
        self.meter_step(shared);
    }

    #[inline(always)]
    fn meter_step(&mut self, shared: &FdiEngine) {
        let noise_from = shared.sequential.noise_from();
        for lane in 0..L {
            let learn = (self.warm_up[lane] != 0) & (self.samples[lane] >= noise_from);
            self.meter.learn_noise[lane] = u32::from(learn);
            self.samples[lane] = self.samples[lane].saturating_add(1);
        }
        for lane in 0..L {
            let body = self.body(lane);
            let wrench = get(&self.static_wrench, lane);
            let thrust = get(&self.static_thrust, lane);
            shared
                .sequential
                .step_lane(&mut self.meter, lane, &body, &wrench, &thrust);
        }
    }

    #[inline(always)]
    fn body(&self, lane: usize) -> BodyMomentum {
        BodyMomentum {
            momentum: get(&self.momentum, lane),
            drift: get(&self.drift, lane),
            vertical_speed: self.vertical_speed[lane],
        }
    }

    #[inline(always)]
    fn prepare(&mut self, shared: &FdiEngine, measured: &MeasuredRows<L>, sines: &SineRows<L>, duty: &[[f32; L]; N]) {
        let geometry = &shared.config.geometry;
        for lane in 0..L {
            let nav = nav(measured, lane);
            let voltage = measured[12][lane];
            let body = BodyMomentum::from_sines(&shared.body, &nav, &sines.get(lane));
            set(&mut self.momentum, lane, &body.momentum);
            set(&mut self.drift, lane, &body.drift);
            self.vertical_speed[lane] = body.vertical_speed;
            let mut thrust = [0.0; N];
            for i in 0..N {
                thrust[i] = shared.config.thrust_map.thrust(duty[i][lane], voltage);
            }
            set(&mut self.static_thrust, lane, &thrust);
            set(&mut self.static_wrench, lane, &geometry.wrench_of(&thrust));
        }
        for lane in 0..L {
            // As in `is_usable`: NaN and infinity fail the comparison.
            let mut usable = true;
            for row in 3..13 {
                usable &= measured[row][lane].abs() <= PLAUSIBLE;
            }
            for row in 0..3 {
                usable &= measured[row][lane].abs() < f32::INFINITY;
            }
            for i in 0..N {
                usable &= duty[i][lane].abs() < f32::INFINITY;
            }
            self.outside[lane] = u32::from(!usable) | sines.outside[lane];
        }
    }

    #[inline(always)]
    fn apply_nominal(&mut self, shared: &FdiEngine, duty: &[[f32; L]; N]) {
        match &shared.nominal {
            NominalWrench::Static => self.nominal_wrench = self.static_wrench,
            NominalWrench::Lagged(model) => {
                let (end_weight, mean_weight) = (model.end_weight, model.mean_weight);
                for lane in 0..L {
                    let mut state = get(&self.lag_state, lane);
                    let wrench = lag(end_weight, mean_weight, &mut state, &get(&self.static_wrench, lane));
                    set(&mut self.lag_state, lane, &state);
                    set(&mut self.nominal_wrench, lane, &wrench);
                }
            }
            NominalWrench::Linear(full_thrust) => {
                for lane in 0..L {
                    let mut thrust = [0.0; N];
                    for i in 0..N {
                        thrust[i] = *full_thrust * duty[i][lane];
                    }
                    set(
                        &mut self.nominal_wrench,
                        lane,
                        &shared.config.geometry.wrench_of(&thrust),
                    );
                }
            }
        }
    }

    #[inline(always)]
    fn observe(&mut self, shared: &FdiEngine) {
        let (gain, period) = (shared.observer.gain, shared.observer.period);
        for lane in 0..L {
            let mut state = get(&self.observer_state, lane);
            let mut rate = get(&self.observer_rate, lane);
            let wrench = get(&self.nominal_wrench, lane);
            let residual = observe(gain, period, &mut state, &mut rate, &self.body(lane), &wrench);
            set(&mut self.observer_state, lane, &state);
            set(&mut self.observer_rate, lane, &rate);
            set(&mut self.wrench_residual, lane, &residual);
            let mut window = WrenchStatistics {
                count: self.window_count[lane],
                mean: get(&self.window_mean, lane),
                co_moment: get(&self.window_co_moment, lane),
            };
            window.push(&residual);
            self.window_count[lane] = window.count;
            set(&mut self.window_mean, lane, &window.mean);
            set(&mut self.window_co_moment, lane, &window.co_moment);
        }
        let geometry = &shared.config.geometry;
        for i in 0..N {
            let basis = geometry.decoupling_basis(i);
            for c in 0..3 {
                for lane in 0..L {
                    self.residuals[i][c][lane] = dot(&basis[c], &get(&self.wrench_residual, lane));
                }
            }
        }
    }

    #[inline(always)]
    fn calibrate(&mut self, first: u32, end: u32) {
        for lane in 0..L {
            let seen = self.baseline_seen[lane];
            let counts = (seen < end) & (seen >= first);
            let count = self.baseline_count[lane].saturating_add(u32::from(counts));
            let weight = 1.0 / count as f32;
            for axis in 0..4 {
                let mean = self.baseline_mean[axis][lane];
                let moved = mean + weight * (self.wrench_residual[axis][lane] - mean);
                self.baseline_mean[axis][lane] = if counts { moved } else { mean };
            }
            self.baseline_count[lane] = count;
            self.baseline_seen[lane] = seen.saturating_add(u32::from(seen < end));
        }
    }

    /// Residuals of a lane's last sample: r_i of every rotor, and the 4-axis residual behind them.
    #[inline]
    pub fn residuals_of(&self, lane: usize) -> ([[f32; 3]; N], [f32; 4]) {
        let mut residuals = [[0.0; 3]; N];
        for i in 0..N {
            residuals[i] = get(&self.residuals[i], lane);
        }
        (residuals, get(&self.wrench_residual, lane))
    }

    /// Output of a lane's engine for its last sample, as [`FdiEngine::step`] would return it.
    pub fn output(&self, lane: usize, engine: &FdiEngine) -> FdiOutput {
        let mut output = engine.output;
        output.window_end = self.window_end[lane] != 0;
        output.wrench_residual = get(&self.wrench_residual, lane);
        for i in 0..N {
            output.residuals.component[i] = get(&self.residuals[i], lane);
        }
        output
    }
}
