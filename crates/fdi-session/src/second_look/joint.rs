//! How much thrust some rotors have lost, followed over time on all four axes at once.
//!
//! ```text
//!  D_a' = w_a + b_a + g_a φ_own + s_a φ_second + t_a φ_lag + j_a φ_gyr − Σ_i F_ai f̂_i δ_i (+ F_ai f̂_i η_i, yaw)
//! ```
//! δ_i: lost share of the thrust f̂_i commanded of the rotor, η_i: change of its blade's drag. The same states as in
//! [`super::wrench`], but the axes share the loss: what roll and pitch determine well constrains the others. Losses
//! perform a random walk at one of [`SPEEDS`], as there. The filter starts from a snapshot of the wrench filter before
//! the fault and catches up to the present.
//!
//! Where the vehicle differs from the model, innovations e are larger than their variance s predicts, and so is the
//! error of a loss: its variance is multiplied by max(1, mean e²/s) (Birge's ratio; R. T. Birge, Phys. Rev. 40 (1932)
//! 207).

use super::imm;
use super::meter::{AXES, Block};
use super::wrench::{AxisState, Noise, OWN, SPEEDS, STATES, chance, log_density};
use rotortwin_flight_core::MAX_ROTORS;

const DEFECT: usize = 0;
const GUST: usize = 1;
/// A speed with a smaller probability contributes nothing to a mixture.
const NEGLIGIBLE: f64 = 1e-5;

/// Blocks over which e²/s is averaged: 10 s.
const SURPRISE_BLOCKS: f64 = 160.0;

/// Variance of a changing loss, in steps of its speed.
const BEHIND: f64 = 3.0;

/// Mean and covariance of all states at one speed.
#[derive(Clone, Debug)]
struct Mode {
    x: Vec<f64>,
    p: Vec<f64>,
}

/// See the module.
#[derive(Clone, Debug)]
pub(super) struct JointFilter {
    pub rotors: u32,
    members: Vec<usize>,
    with_drag: bool,
    column: [[f64; AXES]; MAX_ROTORS],
    n: usize,
    modes: Vec<Mode>,
    probability: [f64; SPEEDS.len()],
    /// Mean of e²/s over axes and speeds, and the blocks in it.
    surprise: f64,
    blocks: f64,
}

impl JointFilter {
    /// * `column`: of each rotor, levers taken out   * `with_drag`: the drag of a single rotor's blade is unknown   * `spread`: of the losses at the start
    pub(super) fn new(
        rotors: u32,
        with_drag: bool,
        start: &[AxisState; AXES],
        spread: f64,
        column: &[[f64; AXES]; MAX_ROTORS],
    ) -> Self {
        let members: Vec<usize> = (0..MAX_ROTORS).filter(|rotor| rotors >> rotor & 1 == 1).collect();
        let n = AXES * OWN + members.len() + usize::from(with_drag);
        let mut mode = Mode {
            x: vec![0.0; n],
            p: vec![0.0; n * n],
        };
        for (axis, (x, p)) in start.iter().enumerate() {
            for i in 0..OWN {
                let row = OWN * axis + i;
                mode.x[row] = x[i];
                for j in 0..OWN {
                    mode.p[row * n + OWN * axis + j] = p[i][j];
                }
            }
        }
        for state in AXES * OWN..n {
            mode.p[state * n + state] = spread * spread;
        }
        Self {
            rotors,
            members,
            with_drag,
            column: *column,
            n,
            modes: vec![mode; SPEEDS.len()],
            probability: std::array::from_fn(|speed| if speed == 0 { 0.97 } else { 0.01 }),
            surprise: 1.0,
            blocks: 0.0,
        }
    }

    /// Processes a block.
    ///
    /// * `phi`: of each axis as in the wrench filter; its last entry is not used   * `noise`: of each axis
    pub(super) fn step(&mut self, block: &Block, phi: &[[f64; STATES]; AXES], noise: &[Noise; AXES]) {
        let (next, share) = imm::predicted(&self.probability, chance);
        self.modes = share.iter().map(|share| self.mix(share)).collect();
        let mut log_likelihood = [0.0; SPEEDS.len()];
        let mut surprise = 0.0;
        for speed in 0..SPEEDS.len() {
            let square;
            (log_likelihood[speed], square) = self.advance(speed, block, phi, noise);
            surprise += next[speed] * square / AXES as f64;
        }
        self.blocks = (self.blocks + 1.0).min(SURPRISE_BLOCKS);
        self.surprise += (surprise - self.surprise) / self.blocks;
        self.probability = imm::updated(&next, &log_likelihood);
    }

    fn mix(&self, share: &[f64; SPEEDS.len()]) -> Mode {
        let n = self.n;
        let mut out = Mode {
            x: vec![0.0; n],
            p: vec![0.0; n * n],
        };
        let used = || self.modes.iter().zip(share).filter(|(_, share)| **share > NEGLIGIBLE);
        for (mode, share) in used() {
            for i in 0..n {
                out.x[i] += share * mode.x[i];
            }
        }
        for (mode, share) in used() {
            for i in 0..n {
                let far = share * (mode.x[i] - out.x[i]);
                for j in 0..n {
                    out.p[i * n + j] += share * mode.p[i * n + j] + far * (mode.x[j] - out.x[j]);
                }
            }
        }
        out
    }

    /// ln p of the block at a speed, and Σ e²/s over the axes.
    fn advance(
        &mut self,
        speed: usize,
        block: &Block,
        phi: &[[f64; STATES]; AXES],
        noise: &[Noise; AXES],
    ) -> (f64, f64) {
        let n = self.n;
        let faults = AXES * OWN;
        let walk = SPEEDS[speed].powi(2);
        let Mode { x, p } = &mut self.modes[speed];
        for state in faults..n {
            p[state * n + state] += walk;
        }
        let (mut log_likelihood, mut square) = (0.0, 0.0);
        for axis in 0..AXES {
            let at = OWN * axis;
            let d = at + DEFECT;
            let mut c: Vec<(usize, f64)> = (1..OWN).map(|j| (at + j, phi[axis][j])).collect();
            for (k, rotor) in self.members.iter().enumerate() {
                c.push((faults + k, -self.column[*rotor][axis] * block.thrust[*rotor]));
            }
            if self.with_drag && axis == AXES - 1 {
                let rotor = self.members[0];
                c.push((n - 1, self.column[rotor][axis] * block.thrust[rotor]));
            }
            // P ← A P Aᵀ with A = 1 + e_D cᵀ.
            x[d] += c.iter().map(|(j, c)| c * x[*j]).sum::<f64>();
            for k in 0..n {
                p[d * n + k] += c.iter().map(|(j, c)| c * p[j * n + k]).sum::<f64>();
            }
            for k in 0..n {
                p[k * n + d] += c.iter().map(|(j, c)| c * p[k * n + j]).sum::<f64>();
            }
            let noise = &noise[axis];
            p[d * n + d] += noise.white * block.elapsed * block.elapsed + block.untold[axis];
            let g = at + GUST;
            x[g] *= noise.correlation;
            for k in 0..n {
                p[g * n + k] *= noise.correlation;
                p[k * n + g] *= noise.correlation;
            }
            p[g * n + g] += (1.0 - noise.correlation.powi(2)) * noise.gust;

            let innovation = block.defect[axis] - x[d];
            let column: Vec<f64> = (0..n).map(|k| p[k * n + d]).collect();
            let variance = column[d] + noise.measurement;
            for i in 0..n {
                let gain = column[i] / variance;
                x[i] += gain * innovation;
                for j in 0..n {
                    p[i * n + j] -= gain * column[j];
                }
            }
            x[d] -= block.defect[axis];
            log_likelihood += log_density(innovation, variance);
            square += innovation * innovation / variance;
        }
        (log_likelihood, square)
    }

    /// Lost share of each rotor and its variance.
    pub(super) fn lost(&self) -> Vec<[f64; 2]> {
        let n = self.n;
        (0..self.members.len())
            .map(|k| {
                let state = AXES * OWN + k;
                let each = || self.modes.iter().zip(&self.probability);
                let mean: f64 = each().map(|(mode, p)| p * mode.x[state]).sum();
                let variance: f64 = each()
                    .map(|(mode, p)| p * (mode.p[state * n + state] + (mode.x[state] - mean).powi(2)))
                    .sum();
                // What moves has moved on since the middle of the block, and goes one way.
                let moves: f64 = self
                    .probability
                    .iter()
                    .zip(SPEEDS)
                    .map(|(p, speed)| p * speed * speed)
                    .sum();
                [mean, (variance + BEHIND * moves) * self.surprise.max(1.0)]
            })
            .collect()
    }
}
