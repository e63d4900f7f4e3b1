//! The improved network over time: evidence accumulated over windows, instead of a separate verdict for each window.
//!
//! ```text
//!  residual means of a window ─▶ network ─▶ log-odds of each rotor ─▶ less the flight's offset, over its spread ─▶ class probabilities ─▶ evidence ─▶ verdict
//! ```
//! The network was trained on losses of 5 % and more, so it gives a rotor even odds at a loss of about half a per cent:
//! on a healthy flight its output crosses that line in every twentieth window. Its *ranking* of the rotors is good,
//! however. So its log-odds are taken as a measurement, whose offset and spread are learnt in flight:
//!
//! ```text
//!  ℓ_i = log p_i/p_0                                    log-odds of rotor i against healthy
//!  u_i = (ℓ_i − µ_i)/σ_i                                µ, σ: calibration (2 s to 10 s), then followed with 60 s while nothing is suspected
//!  q   = softmax(0, δ(u_1 − δ/2), …, δ(u_n − δ/2))      log-likelihood ratio of a shift by δ standard deviations (Gaussian)
//!  w_i = log(((1 − ε) q_i + ε/(n+1)) / ((1 − ε) q_0 + ε/(n+1)))     one window in 1/ε says nothing
//!  S_i ← clamp(S_i + ρ w_i, 0, S_max)                   Page's cumulative sum (Biometrika 41, 1954)
//! ```
//! Dividing by σ and shifting by δ are temperature and bias of a calibrated softmax (Guo et al., ICML 2017), learnt for
//! each rotor and flight instead of once for all. ρ is the weight of a window relative to an independent observation:
//! windows pass through the same observer (gain h, window T), whose correlation limits it to tanh(hT/2), less where the
//! means of half-seconds scatter more in the calibration.
//!
//! A rotor is named when its evidence reaches a level, until it has fallen to half of that. Constants were chosen on
//! flights of other seeds than those of the figures in docs/detector.md.
//!
//! Limits: one rotor; two simultaneous faults are reported as one of them, or not at all. Damage present at the end of
//! the calibration counts as healthy. A loss that grows by less than a few tenths of a per cent per minute is absorbed
//! by the offset. The size of a loss is not estimated. A load or a gain that resembles a rotor's loss is named as one:
//! the network knows nothing else.

use rotortwin_flight_core::fdi::verdict_code::{HEALTHY, NOT_READY};
use rotortwin_flight_core::fdi::{FdiConfig, Network, Residuals};
use rotortwin_flight_core::geometry::Geometry;

/// δ: the shift tested for, standard deviations of the healthy output. A loss of 1 % shifts the output by six to twelve
/// in calm air.
const SHIFT: f64 = 8.0;
/// ε: share of windows that carry no information, whatever their output.
const LAPSE: f64 = 0.01;
/// Evidence at which a rotor is named, nats.
const NAMED: f64 = 10.0;
/// Evidence below which it is no longer named.
const RELEASED: f64 = 5.0;
/// Largest evidence: makes a healed rotor be released soon.
const MOST: f64 = 16.0;
/// Evidence up to which offset and spread keep following the flight.
const UNSUSPECTED: f64 = 3.0;
/// Time constant with which offset and spread follow, s.
const FOLLOWING_S: f64 = 60.0;
/// a and b of the reported probability, log p_i/p_0 = a S_i − b: maximum likelihood over 471,000 windows of the flights
/// that the other constants were chosen on, a fifth of them with a loss of 0.2 to 20 %.
const CALIBRATED: [f64; 2] = [2.0, 5.0];
/// Windows whose means are compared for correlation beyond the observer's: half a second.
const BLOCK: usize = 8;
/// Fewest windows of a calibration.
const FEWEST: usize = 4 * BLOCK;
/// Smallest spread of an output, nats: that of a flight without noise is 0.
const LEAST_SPREAD: f64 = 1.0;
/// Largest change of offset and spread by one window, standard deviations.
const FARTHEST: [f64; 2] = [2.0, 3.0];

/// Output of the network over time.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NetworkOverTime {
    /// 0 healthy, i rotor i, −2 not ready.
    pub code: i32,
    /// Of healthy, rotor 1, rotor 2, …; empty without a verdict.
    pub probability: Vec<f32>,
}

impl NetworkOverTime {
    /// No verdict.
    pub const NOT_READY: Self = Self {
        code: NOT_READY,
        probability: Vec::new(),
    };

    /// Probability that the verdict is correct; 0 without a verdict.
    pub fn of_verdict(&self) -> f32 {
        let class = usize::try_from(self.code).ok();
        class
            .and_then(|class| self.probability.get(class))
            .copied()
            .unwrap_or(0.0)
    }
}

/// See the module.
#[derive(Clone, Debug)]
pub struct Evidence {
    network: Network,
    geometry: Geometry,
    /// tanh(hT/2).
    most_share: f64,
    /// Windows to seconds, over [`FOLLOWING_S`].
    following: f64,
    calibration: Vec<[f32; 4]>,
    learnt: Option<Learnt>,
    /// Evidence of each rotor.
    sum: Vec<f64>,
    /// Rotor from 1; 0: none.
    named: usize,
}

/// The network's output on this flight while it is healthy.
#[derive(Clone, Debug)]
struct Learnt {
    /// Mean of the residual.
    baseline: [f32; 4],
    offset: Vec<f64>,
    variance: Vec<f64>,
    /// ρ.
    share: Vec<f64>,
}

impl Evidence {
    /// `None` without a network that calibrates itself: the paper's network is judged as in the paper.
    pub fn new(config: &FdiConfig) -> Option<Self> {
        let network = config.network.filter(Network::self_calibrated)?;
        let window_s = f64::from(config.window_len) * f64::from(config.period);
        Some(Self {
            geometry: config.geometry,
            most_share: (0.5 * f64::from(config.observer_gain) * window_s).tanh(),
            following: window_s / FOLLOWING_S,
            calibration: Vec::new(),
            learnt: None,
            sum: vec![0.0; network.rotor_count()],
            named: 0,
            network,
        })
    }

    /// A new calibration begins.
    pub fn restart(&mut self) {
        self.calibration.clear();
        self.learnt = None;
        self.hold();
    }

    /// A window of the calibration, in which the vehicle counts as healthy.
    ///
    /// * `residual_mean`: mean of the 4-axis residual over the window
    pub fn calibrate(&mut self, residual_mean: &[f32; 4]) {
        self.calibration.push(*residual_mean);
    }

    /// A window without a verdict: evidence gathered so far is discarded.
    pub fn hold(&mut self) {
        self.sum.fill(0.0);
        self.named = 0;
    }

    /// A window after the calibration.
    ///
    /// * `residual_mean`: mean of the 4-axis residual over the window
    pub fn window(&mut self, residual_mean: &[f32; 4]) -> NetworkOverTime {
        if self.learnt.is_none() {
            self.learnt = self.learn();
            self.calibration = Vec::new();
        }
        let Some(mut learnt) = self.learnt.take() else {
            return NetworkOverTime::NOT_READY;
        };
        let deviation = self.log_odds(&learnt.baseline, residual_mean);
        let deviation: Vec<f64> = deviation.iter().zip(&learnt.offset).map(|(l, mean)| l - mean).collect();
        if deviation.iter().all(|deviation| deviation.is_finite()) {
            self.add(&deviation, &learnt);
            if self.sum.iter().all(|sum| *sum <= UNSUSPECTED) {
                learnt.follow(&deviation, self.following);
            }
        }
        self.learnt = Some(learnt);
        self.decide()
    }

    /// Adds the evidence of one window.
    ///
    /// * `deviation`: ℓ − µ of each rotor
    fn add(&mut self, deviation: &[f64], learnt: &Learnt) {
        let spread = learnt.variance.iter().map(|variance| variance.sqrt());
        let z: Vec<f64> = std::iter::once(0.0)
            .chain(deviation.iter().zip(spread).map(|(x, s)| SHIFT * (x / s - 0.5 * SHIFT)))
            .collect();
        let q = softmax(&z);
        let lapse = LAPSE / q.len() as f64;
        let certain = |q: f64| ((1.0 - LAPSE) * q + lapse).ln();
        for ((sum, q_i), share) in self.sum.iter_mut().zip(&q[1..]).zip(&learnt.share) {
            *sum = (*sum + share * (certain(*q_i) - certain(q[0]))).clamp(0.0, MOST);
        }
    }

    fn decide(&mut self) -> NetworkOverTime {
        let (mut best, mut most) = (0, 0.0);
        for (rotor, sum) in self.sum.iter().enumerate() {
            if *sum > most {
                (best, most) = (rotor + 1, *sum);
            }
        }
        if most >= NAMED {
            self.named = best;
        } else if self.named > 0 && self.sum[self.named - 1] < RELEASED {
            self.named = 0;
        }
        let logit = |sum: &f64| CALIBRATED[0] * sum - CALIBRATED[1];
        let z: Vec<f64> = std::iter::once(0.0).chain(self.sum.iter().map(logit)).collect();
        NetworkOverTime {
            code: i32::try_from(self.named).unwrap_or(HEALTHY),
            probability: softmax(&z).iter().map(|p| *p as f32).collect(),
        }
    }

    /// log p_i/p_0 of each rotor.
    fn log_odds(&self, baseline: &[f32; 4], residual_mean: &[f32; 4]) -> Vec<f64> {
        let input: [f32; 4] = std::array::from_fn(|axis| residual_mean[axis] - baseline[axis]);
        let output = self.network.logits(&Residuals::from_wrench(&self.geometry, &input));
        let healthy = f64::from(output[0]);
        output[1..=self.sum.len()]
            .iter()
            .map(|o| f64::from(*o) - healthy)
            .collect()
    }

    /// Offset, spread and correlation of the output over the calibration; `None` if that was too short.
    fn learn(&self) -> Option<Learnt> {
        let windows = &self.calibration;
        if windows.len() < FEWEST {
            return None;
        }
        let mean = |axis: usize| windows.iter().map(|w| f64::from(w[axis])).sum::<f64>() / windows.len() as f64;
        let baseline: [f32; 4] = std::array::from_fn(|axis| mean(axis) as f32);
        let outputs: Vec<Vec<f64>> = windows.iter().map(|window| self.log_odds(&baseline, window)).collect();
        let mut learnt = Learnt {
            baseline,
            offset: Vec::new(),
            variance: Vec::new(),
            share: Vec::new(),
        };
        for rotor in 0..self.sum.len() {
            let output: Vec<f64> = outputs.iter().map(|output| output[rotor]).collect();
            let (offset, variance) = mean_and_variance(&output);
            let blocks: Vec<f64> = output
                .chunks_exact(BLOCK)
                .map(|block| block.iter().sum::<f64>() / BLOCK as f64)
                .collect();
            // Of independent windows: 1.
            let scatter = BLOCK as f64 * mean_and_variance(&blocks).1 / variance.max(f64::MIN_POSITIVE);
            learnt.offset.push(offset);
            learnt.variance.push(variance.max(LEAST_SPREAD * LEAST_SPREAD));
            learnt.share.push(self.most_share.min(1.0 / scatter.max(1.0)));
        }
        learnt.offset.iter().all(|offset| offset.is_finite()).then_some(learnt)
    }
}

impl Learnt {
    /// Lets offset and spread follow a window in which nothing is suspected.
    ///
    /// * `deviation`: ℓ − µ of each rotor   * `weight`: of the window
    fn follow(&mut self, deviation: &[f64], weight: f64) {
        for ((x, offset), variance) in deviation.iter().zip(&mut self.offset).zip(&mut self.variance) {
            let [far, farther] = FARTHEST.map(|far| far * variance.sqrt());
            *offset += weight * x.clamp(-far, far);
            let square = (x * x).min(farther * farther);
            *variance = (*variance + weight * (square - *variance)).max(LEAST_SPREAD * LEAST_SPREAD);
        }
    }
}

/// Mean and variance (over n).
fn mean_and_variance(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    (mean, values.iter().map(|x| (x - mean) * (x - mean)).sum::<f64>() / n)
}

/// Shifted by the largest, so that nothing overflows.
fn softmax(z: &[f64]) -> Vec<f64> {
    let largest = z.iter().fold(f64::NEG_INFINITY, |a, b| a.max(*b));
    let exponentials: Vec<f64> = z.iter().map(|z| (z - largest).exp()).collect();
    let sum: f64 = exponentials.iter().sum();
    exponentials.iter().map(|e| e / sum).collect()
}
