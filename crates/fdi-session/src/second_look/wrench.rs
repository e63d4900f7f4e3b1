//! The wrench that healthy rotors do not explain, at the present time, with its variance: one Kalman filter per axis
//! and speed of change.
//!
//! ```text
//!  D' = w + b + g φ_own + s φ_second + t φ_lag + j φ_gyr + Σ a_k φ_air,k + u c    D: momentum defect, measured once per block
//!  w' = −w/T + noise    u' = noise of one of four speeds          u: lost wrench at hover, c: thrust of all rotors over the weight
//! ```
//! b, s, t, j as in the engine's filters. φ_own is the wrench that *acted* (nominal and lost together: lagged rotors
//! plus the measured defect), as an error of mass, inertia, arm or moment ratio scales both; in a steady hover after a
//! loss it is zero, so that no such error is mistaken for a part of the loss. The lost wrench has no onset time: it
//! performs a random walk at one of [`SPEEDS`], and the speed is a Markov chain with the same speed on all axes
//! (interacting multiple models). So a step, a loss that grows, one that comes and goes and one that heals are the same
//! thing at different speeds. Gust level and white force of each axis are those that maximise the likelihood of the
//! calibration; afterwards their common scale follows the innovations slowly.

use super::imm;
use super::meter::{AIRS, AXES, Block, air_spread};
use rotortwin_flight_core::fdi::FdiConfig;

pub(super) const STATES: usize = 8 + AIRS;
/// Of an axis without the lost wrench.
pub(super) const OWN: usize = STATES - 1;
const DEFECT: usize = 0;
const GUST: usize = 1;
const BIAS: usize = 2;
const SECOND: usize = 4;
const LOST: usize = STATES - 1;

/// Standard deviation of the lost wrench's step in a block, share of a rotor's thrust in hover.
pub(super) const SPEEDS: [f64; 4] = [1.5e-4, 2e-3, 1.2e-2, 7e-2];
/// The same if only the vertical force changes, as by a load.
const VERTICAL_SPEED: f64 = 0.2;
/// Probability per block of leaving the slowest speed, to each of the others; of falling back from one of the others by
/// one; of rising.
const AWAKES: f64 = 2e-4;
const CALMS: f64 = 0.06;
const RISES: f64 = 0.01;
/// Smallest correlation time of gusts if the momentum along z is an integral of the force itself, s. The engine has no
/// white force and uses a shorter one at low rates; here there is one, and with 1 s instead of 2 s gusts became false
/// alarms.
pub(super) const LEAST_GUST_TIME: f64 = 2.0;
/// Gust levels tried, share of a rotor's hover thrust; each √10 times the previous one.
const LEAST_GUST: f64 = 3e-4;
const GUST_LEVELS: i32 = 8;
/// White force, standard deviation of its mean over a block in the same unit.
const LEAST_WHITE: f64 = 3e-4;
const WHITE_LEVELS: i32 = 7;
/// Largest squared normalised innovation that counts towards the scale of the noise; its mean is 0.97 if the model
/// holds.
const LIMIT: f64 = 6.0;
/// Weight of a block in the scale of the noise: half a minute.
const SCALE_WEIGHT: f64 = 2e-3;
/// Standard deviation of the change by a load in a block in which it may occur, share of a rotor's hover thrust: of its
/// force, and of its moments over the levers.
const FREE: f64 = 0.3;
const FREE_MOMENT: f64 = 0.05;
/// Possible error of the force of a load while the vehicle still climbs or sinks, share of it.
const LOAD_ERROR: f64 = 0.015;
/// Degrees of freedom of the innovations' distribution.
const FREEDOM: f64 = 8.0;

/// States of an axis without the lost wrench, and their covariance.
pub(super) type AxisState = ([f64; OWN], [[f64; OWN]; OWN]);

#[derive(Clone, Copy, Debug)]
struct Filter {
    x: [f64; STATES],
    p: [[f64; STATES]; STATES],
}

#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Noise {
    /// e^(−block/T).
    pub correlation: f64,
    /// Of the gusts, N².
    pub gust: f64,
    /// Of a block's mean white force, N².
    pub white: f64,
    /// Of the mean of a block's momentum, (N·s)².
    pub measurement: f64,
}

impl Filter {
    fn new(variance: &[f64; STATES]) -> Self {
        let mut p = [[0.0; STATES]; STATES];
        for i in 0..STATES {
            p[i][i] = variance[i];
        }
        Self { x: [0.0; STATES], p }
    }

    /// Advances by a block and processes its defect, with the variance of the impulse that it leaves open; returns
    /// innovation and variance.
    fn step(&mut self, phi: &[f64; STATES], noise: &Noise, walk: f64, [defect, untold]: [f64; 2]) -> (f64, f64) {
        let p = &mut self.p;
        p[LOST][LOST] += walk;
        let mut row = [0.0; STATES];
        let mut change = 0.0;
        for i in 0..STATES {
            row[i] = (1..STATES).map(|j| p[i][j] * phi[j]).sum();
        }
        for j in 1..STATES {
            change += phi[j] * self.x[j];
        }
        let spread: f64 = (1..STATES).map(|j| phi[j] * row[j]).sum();
        p[DEFECT][DEFECT] += 2.0 * row[DEFECT] + spread + noise.white * phi[BIAS] * phi[BIAS] + untold;
        for j in 1..STATES {
            p[DEFECT][j] += row[j];
            p[j][DEFECT] = p[DEFECT][j];
        }
        let decay = noise.correlation;
        self.x[GUST] *= decay;
        for j in 0..STATES {
            if j != GUST {
                p[GUST][j] *= decay;
                p[j][GUST] = p[GUST][j];
            }
        }
        p[GUST][GUST] = decay * decay * p[GUST][GUST] + (1.0 - decay * decay) * noise.gust;

        self.x[DEFECT] += change;
        let innovation = defect - self.x[DEFECT];
        let column = p[DEFECT];
        let variance = column[DEFECT] + noise.measurement;
        for i in 0..STATES {
            self.x[i] += column[i] / variance * innovation;
            for j in 0..STATES {
                p[i][j] -= column[i] * column[j] / variance;
            }
        }
        // D counts from the measured one.
        self.x[DEFECT] -= defect;
        (innovation, variance)
    }
}

/// Lost wrench at one of the speeds.
#[derive(Clone, Copy, Debug)]
pub(super) struct AtSpeed {
    pub probability: f64,
    /// N at the levers, at hover; a loss has the opposite sign of the rotors' columns.
    pub value: [f64; AXES],
    /// N².
    pub variance: [f64; AXES],
}

/// See the module.
#[derive(Clone, Debug)]
pub(super) struct WrenchFilter {
    /// Thrust of a rotor in hover, N.
    hover: f64,
    rotor_count: f64,
    prior: [[f64; STATES]; AXES],
    centre_scale: [f64; AXES],
    pub(super) gust_time: f64,
    /// Of the calibration.
    blocks: Vec<Block>,
    noise: [Noise; AXES],
    /// Lower limits of gusts and white force, N².
    pub(super) least: [[f64; 2]; AXES],
    /// The momentum along z is an integral of the force itself.
    pub(super) by_force: bool,
    scale: [f64; AXES],
    modes: Vec<[Filter; AXES]>,
    probability: [f64; SPEEDS.len()],
    vertical: Vertical,
}

/// The vertical axis alone: at rest, or changing fast. Loads change nothing else, and the other axes, which are quiet
/// then, speak against a high speed of all.
#[derive(Clone, Debug, Default)]
struct Vertical {
    modes: Vec<Filter>,
    probability: [f64; 2],
}

impl Vertical {
    fn begin(start: Filter) -> Self {
        Self {
            modes: vec![start; 2],
            probability: [0.99, 0.01],
        }
    }

    fn step(&mut self, phi: &[f64; STATES], noise: &Noise, hover: f64, defect: [f64; 2]) {
        const CHANCE: [[f64; 2]; 2] = [[1.0 - AWAKES, AWAKES], [CALMS, 1.0 - CALMS]];
        let (next, share) = imm::predicted(&self.probability, |from, to| CHANCE[from][to]);
        self.modes = share.iter().map(|share| mix(self.modes.iter(), share)).collect();
        let mut log_likelihood = [0.0; 2];
        for (mode, speed) in [SPEEDS[0], VERTICAL_SPEED].into_iter().enumerate() {
            let (e, s) = self.modes[mode].step(phi, noise, (speed * hover).powi(2), defect);
            log_likelihood[mode] = log_density(e, s);
        }
        self.probability = imm::updated(&next, &log_likelihood);
    }
}

impl WrenchFilter {
    /// * `arm`: longest levers, m
    pub(super) fn new(config: &FdiConfig, arm: &[f64; AXES]) -> Self {
        let c = &config.sequential;
        let hover = f64::from(config.mass * config.gravity) / config.geometry.rotor_count() as f64;
        let square = |x: f32| f64::from(x).powi(2);
        let longest = arm[1].max(arm[2]);
        Self {
            hover,
            rotor_count: config.geometry.rotor_count() as f64,
            prior: std::array::from_fn(|axis| {
                let second = match axis {
                    0 => square(c.drag_spread * config.mass),
                    1 | 2 => square(c.centre_of_mass_spread),
                    _ => square(c.centre_of_mass_spread) * (arm[3] / longest).powi(2),
                };
                let gyroscopic = if axis == 0 { 0.0 } else { square(c.gain_spread) };
                let air = air_spread(axis).map(|spread| (spread * hover).powi(2));
                [
                    0.0,
                    0.0,
                    square(c.bias_spread) * hover * hover,
                    square(c.gain_spread),
                    second,
                    square(c.rotor_time_constant_spread),
                    gyroscopic,
                    air[0],
                    air[1],
                    air[2],
                    air[3],
                    0.0,
                ]
            }),
            centre_scale: std::array::from_fn(|axis| longest / arm[axis]),
            gust_time: f64::from(c.disturbance_correlation_time),
            blocks: Vec::new(),
            noise: [Noise::default(); AXES],
            least: [[0.0; 2]; AXES],
            by_force: false,
            scale: [1.0; AXES],
            modes: Vec::new(),
            probability: [0.0; SPEEDS.len()],
            vertical: Vertical::default(),
        }
    }

    pub(super) fn phi(&self, axis: usize, block: &Block, demand: f64) -> [f64; STATES] {
        let second = if axis == 0 {
            block.path
        } else {
            block.wrench[0] * self.centre_scale[axis]
        };
        let air = block.air_of(axis);
        [
            0.0,
            block.elapsed,
            block.elapsed,
            // The noise of an integrated force is all in its defect: as a regressor that would explain itself.
            if axis == 0 && self.by_force {
                block.wrench[axis]
            } else {
                block.wrench[axis] + block.defect[axis]
            },
            second,
            block.lag_slope[axis],
            if axis == 0 { 0.0 } else { block.gyroscopic[axis - 1] },
            air[0],
            air[1],
            air[2],
            air[3],
            demand,
        ]
    }

    /// φ of every axis; the last entry is that of the lost wrench.
    pub(super) fn phis(&self, block: &Block) -> [[f64; STATES]; AXES] {
        std::array::from_fn(|axis| self.phi(axis, block, 0.0))
    }

    /// Processes a block of the calibration.
    pub(super) fn calibrate(&mut self, block: Block) {
        self.blocks.push(block);
    }

    /// True once the calibration is over.
    pub(super) fn is_ready(&self) -> bool {
        !self.modes.is_empty()
    }

    /// Ends the calibration; returns the surprise of each of its blocks, mean of e²/s over the axes.
    pub(super) fn start(&mut self) -> Vec<f64> {
        let blocks = std::mem::take(&mut self.blocks);
        let mut surprise = vec![0.0; blocks.len()];
        if blocks.is_empty() {
            return surprise;
        }
        let count = blocks.len() as f64;
        let mut start = [Filter::new(&self.prior[0]); AXES];
        for axis in 0..AXES {
            let rough = blocks
                .iter()
                .map(|block| block.roughness[axis] / (2.0 * block.samples))
                .sum::<f64>();
            let correlation = (-blocks[0].elapsed / self.gust_time).exp();
            let mut best = f64::NEG_INFINITY;
            let mut least_surprise = Vec::new();
            for gust in 0..GUST_LEVELS {
                for white in 0..WHITE_LEVELS {
                    let level =
                        |least: f64, step: i32| (self.hover * least * 10f64.powf(0.5 * f64::from(step))).powi(2);
                    let noise = Noise {
                        correlation,
                        gust: level(LEAST_GUST, gust).max(self.least[axis][0]),
                        white: level(LEAST_WHITE, white).max(self.least[axis][1]),
                        measurement: rough / count,
                    };
                    let mut prior = self.prior[axis];
                    prior[DEFECT] = 2.0 * noise.measurement;
                    prior[GUST] = noise.gust;
                    let mut filter = Filter::new(&prior);
                    let mut log_likelihood = 0.0;
                    let mut squares = Vec::with_capacity(blocks.len());
                    for block in &blocks {
                        let (e, s) = filter.step(&self.phi(axis, block, 0.0), &noise, 0.0, block.measured(axis));
                        log_likelihood += log_density(e, s);
                        squares.push(e * e / s);
                    }
                    if log_likelihood > best {
                        best = log_likelihood;
                        least_surprise = squares;
                        (start[axis], self.noise[axis]) = (filter, noise);
                    }
                }
            }
            for (mean, square) in surprise.iter_mut().zip(&least_surprise) {
                *mean += square / AXES as f64;
            }
        }
        self.begin(start);
        surprise
    }

    /// Processes a block after the calibration; returns its surprise, mean of e²/s over speeds and axes.
    ///
    /// * `demand`: ∫ of the quantity to which the lost thrust is proportional, 1 in hover, s
    pub(super) fn step(&mut self, block: &Block, demand: f64) -> f64 {
        let phis: [_; AXES] = std::array::from_fn(|axis| self.phi(axis, block, demand));
        let count = SPEEDS.len();
        let (next, share) = imm::predicted(&self.probability, chance);
        let mixed = |share: &[f64; SPEEDS.len()]| {
            std::array::from_fn(|axis| mix(self.modes.iter().map(|mode| &mode[axis]), share))
        };
        self.modes = share.iter().map(mixed).collect();
        let mut nis = [0.0; AXES];
        let noise = self.noise();
        let mut log_likelihood = [0.0; SPEEDS.len()];
        let mut surprise = [[0.0; AXES]; SPEEDS.len()];
        for speed in 0..count {
            for axis in 0..AXES {
                let walk = (SPEEDS[speed] * self.hover).powi(2);
                let (e, s) = self.modes[speed][axis].step(&phis[axis], &noise[axis], walk, block.measured(axis));
                log_likelihood[speed] += log_density(e, s);
                surprise[speed][axis] = e * e / s;
            }
        }
        self.vertical.step(&phis[0], &noise[0], self.hover, block.measured(0));
        self.probability = imm::updated(&next, &log_likelihood);
        for speed in 0..count {
            for axis in 0..AXES {
                nis[axis] += self.probability[speed] * surprise[speed][axis];
            }
        }
        for axis in 0..AXES {
            self.scale[axis] *= 1.0 + SCALE_WEIGHT * (nis[axis].min(LIMIT) / 0.97 - 1.0);
            self.scale[axis] = self.scale[axis].clamp(0.5, 100.0);
        }
        nis.iter().sum::<f64>() / AXES as f64
    }

    /// At the present time.
    pub(super) fn noise(&self) -> [Noise; AXES] {
        std::array::from_fn(|axis| Noise {
            gust: self.noise[axis].gust * self.scale[axis],
            white: self.noise[axis].white * self.scale[axis],
            ..self.noise[axis]
        })
    }

    /// States of each axis except the lost wrench.
    ///
    /// * `nothing_lost`: the present lost wrench counts as bias; otherwise it is discarded
    pub(super) fn healthy(&self, nothing_lost: bool) -> [AxisState; AXES] {
        let likeliest = (0..SPEEDS.len()).fold(0, |best, speed| {
            if self.probability[speed] > self.probability[best] {
                speed
            } else {
                best
            }
        });
        std::array::from_fn(|axis| {
            let Filter { x, p } = &self.modes[likeliest][axis];
            // b ← b + u.
            let mut to = [[0.0; STATES]; OWN];
            for (i, row) in to.iter_mut().enumerate() {
                row[i] = 1.0;
            }
            to[BIAS][LOST] = f64::from(u8::from(nothing_lost));
            let state = std::array::from_fn(|i| (0..STATES).map(|k| to[i][k] * x[k]).sum());
            let covariance = std::array::from_fn(|i| {
                std::array::from_fn(|j| {
                    let inner = |k: usize| (0..STATES).map(|l| p[k][l] * to[j][l]).sum::<f64>();
                    (0..STATES).map(|k| to[i][k] * inner(k)).sum()
                })
            });
            (state, covariance)
        })
    }

    /// Runs the filter over blocks in the first of which a load has changed, and makes the load part of the vehicle;
    /// returns its downward force at rest and the variance, N and N².
    ///
    /// The load pulls with its mass times the specific force, and turns the vehicle with a constant moment; no rotor
    /// loses anything meanwhile.
    /// * `free`: blocks in which it may have changed   * `weight`: of the vehicle before, N   * `gravity`: m/s²
    pub(super) fn take_load(&mut self, blocks: &[Block], free: usize, weight: f64, gravity: f64) -> [f64; 2] {
        let noise = self.noise();
        let states = self.healthy(true);
        let mut force = [0.0; 2];
        let start = std::array::from_fn(|axis| {
            let mut filter = Filter::new(&[0.0; STATES]);
            let (state, covariance) = &states[axis];
            filter.x[..OWN].copy_from_slice(state);
            for i in 0..OWN {
                filter.p[i][..OWN].copy_from_slice(&covariance[i]);
            }
            let walk = ([FREE, FREE_MOMENT, FREE_MOMENT, 0.0][axis] * self.hover).powi(2);
            for (place, block) in blocks.iter().enumerate() {
                let pull = if axis == 0 {
                    -block.specific / gravity
                } else {
                    block.elapsed
                };
                let walk = if place < free { walk } else { 0.0 };
                filter.step(&self.phi(axis, block, pull), &noise[axis], walk, block.measured(axis));
            }
            let change = filter.x[LOST];
            if axis == 0 {
                filter.p[LOST][LOST] += (LOAD_ERROR * change).powi(2);
                force = [change, filter.p[LOST][LOST]];
            }
            // b ← b + u, except for what becomes mass from now on.
            let (x, p) = (&mut filter.x, &mut filter.p);
            x[BIAS] += if axis == 0 { 0.0 } else { change };
            x[LOST] = 0.0;
            for i in 0..STATES {
                p[BIAS][i] += p[LOST][i];
            }
            for i in 0..STATES {
                p[i][BIAS] += p[i][LOST];
            }
            for i in 0..STATES {
                (p[LOST][i], p[i][LOST]) = (0.0, 0.0);
            }
            // What the transient said of gains, drag and lag is not kept: a load has a shape and swings, and none of that is in the model.
            for i in BIAS + 1..OWN {
                x[i] = state[i];
                for j in 0..=BIAS {
                    (p[i][j], p[j][i]) = (0.0, 0.0);
                }
                for j in BIAS + 1..OWN {
                    p[i][j] = covariance[i][j];
                }
            }
            if axis > 0 {
                // The centre of mass has moved: thrust beyond the weight turns the vehicle, too. Half of it may be air.
                let shift = -change / ((weight + force[0]) * self.centre_scale[axis]);
                x[SECOND] += shift;
                p[SECOND][SECOND] += 0.25 * shift * shift;
            }
            filter
        });
        self.begin(start);
        force
    }

    fn begin(&mut self, start: [Filter; AXES]) {
        self.vertical = Vertical::begin(start[0]);
        self.modes = vec![start; SPEEDS.len()];
        self.probability = std::array::from_fn(|speed| if speed == 0 { 0.97 } else { 0.01 });
    }

    /// Bias of the vertical force over the weight: error of the thrust of all rotors, unless the mass is wrong.
    pub(super) fn thrust_error(&self) -> f64 {
        let weight = self.hover * self.rotor_count;
        let [(vertical, _), ..] = self.healthy(true);
        vertical[BIAS] / weight
    }

    /// Of the lost wrench at the highest speed: how well it would be known soon after a sudden loss, N².
    pub(super) fn variance_of_a_sudden_loss(&self) -> [f64; AXES] {
        std::array::from_fn(|axis| self.modes[SPEEDS.len() - 1][axis].p[LOST][LOST])
    }

    /// Downward force of a change of the vertical force alone, and its variance, N and N².
    pub(super) fn vertical(&self) -> [f64; 2] {
        let all = mix(self.vertical.modes.iter(), &self.vertical.probability);
        [all.x[LOST], all.p[LOST][LOST]]
    }

    /// The present loss.
    pub(super) fn lost(&self) -> [AtSpeed; SPEEDS.len()] {
        std::array::from_fn(|speed| AtSpeed {
            probability: self.probability[speed],
            value: std::array::from_fn(|axis| self.modes[speed][axis].x[LOST]),
            variance: std::array::from_fn(|axis| self.modes[speed][axis].p[LOST][LOST]),
        })
    }
}

/// Probability of changing from one speed to another in a block.
pub(super) fn chance(from: usize, to: usize) -> f64 {
    let others = SPEEDS.len() - 1;
    match (from, to) {
        (0, 0) => 1.0 - AWAKES * others as f64,
        (0, _) => AWAKES,
        _ if to + 1 == from => CALMS,
        _ if to == from + 1 => RISES,
        _ if to == from => 1.0 - CALMS - if from == others { 0.0 } else { RISES },
        _ => 0.0,
    }
}

fn mix<'a>(modes: impl Iterator<Item = &'a Filter> + Clone, share: &[f64]) -> Filter {
    let mut out = Filter {
        x: [0.0; STATES],
        p: [[0.0; STATES]; STATES],
    };
    for (mode, share) in modes.clone().zip(share) {
        for i in 0..STATES {
            out.x[i] += share * mode.x[i];
        }
    }
    for (filter, share) in modes.zip(share) {
        for i in 0..STATES {
            for j in 0..STATES {
                let spread = (filter.x[i] - out.x[i]) * (filter.x[j] - out.x[j]);
                out.p[i][j] += share * (filter.p[i][j] + spread);
            }
        }
    }
    out
}

/// Student's t, up to a constant.
pub(super) fn log_density(e: f64, variance: f64) -> f64 {
    -0.5 * variance.ln() - 0.5 * (FREEDOM + 1.0) * (1.0 + e * e / (variance * FREEDOM)).ln()
}
