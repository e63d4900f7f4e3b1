//! The lost wrench that innovations show since an onset time, with a variance per axis.

use super::defect::AXES;

/// Variance of an uninformative axis, N².
pub(super) const NOTHING_KNOWN: f32 = 1e9;

/// A lasting lost wrench as the innovations show it, levers divided out, N.
#[derive(Clone, Copy, Debug)]
pub(super) struct Observation {
    pub wrench: [f32; AXES],
    pub variance: [f32; AXES],
}

impl Observation {
    /// * `score`, `information`: per axis
    pub(super) fn new(score: &[f32; AXES], information: &[f32; AXES]) -> Self {
        let mut observation = Self {
            wrench: [0.0; AXES],
            variance: [NOTHING_KNOWN; AXES],
        };
        for axis in 0..AXES {
            if information[axis] * NOTHING_KNOWN > 1.0 {
                observation.wrench[axis] = score[axis] / information[axis];
                observation.variance[axis] = 1.0 / information[axis];
            }
        }
        observation
    }

    /// Removes an axis.
    pub(super) fn forget(&mut self, axis: usize) {
        self.wrench[axis] = 0.0;
        self.variance[axis] = NOTHING_KNOWN;
    }

    /// Corrects for the learnt gains of the axes, and adds the uncertainty proportional to the wrench.
    ///
    /// * `gain`, `gain_variance`: relative   * `centre_variance`: of the centre of mass, squared share of the longest lever
    #[must_use]
    pub(super) fn tolerant(mut self, gain: &[f32; AXES], gain_variance: &[f32; AXES], centre_variance: f32) -> Self {
        for axis in 0..AXES {
            let factor = 1.0 / (1.0 + gain[axis].clamp(-0.5, 0.5));
            self.wrench[axis] *= factor;
            self.variance[axis] *= factor * factor;
        }
        let vertical = self.wrench[0] * self.wrench[0];
        for axis in 0..AXES {
            self.variance[axis] += gain_variance[axis] * self.wrench[axis] * self.wrench[axis];
            if axis == 1 || axis == 2 {
                self.variance[axis] += centre_variance * vertical;
            }
        }
        self
    }

    /// ln of the likelihood ratio of the best wrench of any direction, nats.
    pub(super) fn free(&self) -> f32 {
        let axes = self.wrench.iter().zip(&self.variance);
        axes.map(|(wrench, variance)| 0.5 * wrench * wrench / variance).sum()
    }
}
