//! The state that [`DefectMeter::step`] changes, for several flights side by side.

use super::{AXES, DefectMeter, REGRESSORS};
use crate::fdi::residual::BodyMomentum;

/// One row per quantity that changes from sample to sample, one column for each of `L` flights with `N` rotors.
#[derive(Clone, Debug)]
pub(in crate::fdi) struct MeterRows<const N: usize, const L: usize> {
    /// Accounted, rate, last drift, last defect, defect sum, noise sum, noise square, spike limit.
    axes: [[[f32; L]; AXES]; 8],
    /// State, sensitivity, end weight, mean weight, end slope, mean slope.
    lag: [[[f32; L]; AXES]; 6],
    /// Rate, integral, sum.
    regressor: [[[f32; L]; REGRESSORS]; 3],
    /// Excursion, its sum, samples, noise count.
    single: [[f32; L]; 4],
    thrust_sum: [[f32; L]; N],
    loss_fraction: [[f32; L]; N],
    spikes_in_row: [u32; L],
    /// Non-zero while noise is learnt.
    pub(in crate::fdi) learn_noise: [u32; L],
}

#[inline(always)]
fn get<const K: usize, const L: usize>(rows: &[[f32; L]; K], lane: usize, values: &mut [f32; K]) {
    for i in 0..K {
        values[i] = rows[i][lane];
    }
}

#[inline(always)]
fn set<const K: usize, const L: usize>(rows: &mut [[f32; L]; K], lane: usize, values: &[f32; K]) {
    for i in 0..K {
        rows[i][lane] = values[i];
    }
}

impl<const N: usize, const L: usize> MeterRows<N, L> {
    /// No flights yet.
    pub(in crate::fdi) const NONE: Self = Self {
        axes: [[[0.0; L]; AXES]; 8],
        lag: [[[0.0; L]; AXES]; 6],
        regressor: [[[0.0; L]; REGRESSORS]; 3],
        single: [[0.0; L]; 4],
        thrust_sum: [[0.0; L]; N],
        loss_fraction: [[0.0; L]; N],
        spikes_in_row: [0; L],
        learn_noise: [0; L],
    };

    /// Copies in what the detector itself changes between blocks.
    pub(in crate::fdi::sequential) fn seat(&mut self, lane: usize, meter: &DefectMeter, loss_fraction: &[f32]) {
        self.read(lane, meter);
        set(&mut self.axes[7], lane, &meter.spike_limit);
        for axis in 0..AXES {
            let lag = &meter.lag[axis];
            let weights = [lag.end_weight, lag.mean_weight, lag.end_slope, lag.mean_slope];
            for (row, weight) in self.lag[2..].iter_mut().zip(weights) {
                row[axis][lane] = weight;
            }
        }
        for i in 0..N {
            self.loss_fraction[i][lane] = loss_fraction[i];
        }
    }

    /// Reads the per-sample state.
    #[inline(always)]
    fn read(&mut self, lane: usize, meter: &DefectMeter) {
        set(&mut self.axes[0], lane, &meter.accounted);
        set(&mut self.axes[1], lane, &meter.rate);
        set(&mut self.axes[2], lane, &meter.last_drift);
        set(&mut self.axes[3], lane, &meter.last_defect);
        set(&mut self.axes[4], lane, &meter.defect_sum);
        set(&mut self.axes[5], lane, &meter.noise_sum);
        set(&mut self.axes[6], lane, &meter.noise_square);
        for axis in 0..AXES {
            self.lag[0][axis][lane] = meter.lag[axis].state;
            self.lag[1][axis][lane] = meter.lag[axis].sensitivity;
        }
        set(&mut self.regressor[0], lane, &meter.regressor_rate);
        set(&mut self.regressor[1], lane, &meter.integrals.value);
        set(&mut self.regressor[2], lane, &meter.integrals.sum);
        self.single[0][lane] = meter.excursion;
        self.single[1][lane] = meter.excursion_sum;
        self.single[2][lane] = meter.samples;
        self.single[3][lane] = meter.noise_count;
        for i in 0..N {
            self.thrust_sum[i][lane] = meter.thrust_sum[i];
        }
        self.spikes_in_row[lane] = meter.spikes_in_row;
    }

    /// Writes the per-sample state.
    #[inline(always)]
    pub(in crate::fdi::sequential) fn write(&self, lane: usize, meter: &mut DefectMeter) {
        get(&self.axes[0], lane, &mut meter.accounted);
        get(&self.axes[1], lane, &mut meter.rate);
        get(&self.axes[2], lane, &mut meter.last_drift);
        get(&self.axes[3], lane, &mut meter.last_defect);
        get(&self.axes[4], lane, &mut meter.defect_sum);
        get(&self.axes[5], lane, &mut meter.noise_sum);
        get(&self.axes[6], lane, &mut meter.noise_square);
        for axis in 0..AXES {
            meter.lag[axis].state = self.lag[0][axis][lane];
            meter.lag[axis].sensitivity = self.lag[1][axis][lane];
        }
        get(&self.regressor[0], lane, &mut meter.regressor_rate);
        get(&self.regressor[1], lane, &mut meter.integrals.value);
        get(&self.regressor[2], lane, &mut meter.integrals.sum);
        meter.excursion = self.single[0][lane];
        meter.excursion_sum = self.single[1][lane];
        meter.samples = self.single[2][lane];
        meter.noise_count = self.single[3][lane];
        for i in 0..N {
            meter.thrust_sum[i] = self.thrust_sum[i][lane];
        }
        meter.spikes_in_row = self.spikes_in_row[lane];
    }

    /// [`DefectMeter::step`] of one lane. `shared`: any meter of the same configuration.
    #[inline(always)]
    pub(in crate::fdi::sequential) fn step(
        &mut self,
        shared: &DefectMeter,
        lane: usize,
        body: &BodyMomentum,
        static_wrench: &[f32; AXES],
        static_thrust: &[f32; N],
    ) {
        let mut meter = *shared;
        self.write(lane, &mut meter);
        get(&self.axes[7], lane, &mut meter.spike_limit);
        for axis in 0..AXES {
            let lag = &mut meter.lag[axis];
            lag.end_weight = self.lag[2][axis][lane];
            lag.mean_weight = self.lag[3][axis][lane];
            lag.end_slope = self.lag[4][axis][lane];
            lag.mean_slope = self.lag[5][axis][lane];
        }
        let mut loss_fraction = [0.0; N];
        get(&self.loss_fraction, lane, &mut loss_fraction);
        meter.take(
            body,
            static_wrench,
            static_thrust,
            &loss_fraction,
            self.learn_noise[lane] != 0,
        );
        self.read(lane, &meter);
    }
}
