//! Optimisers.
//!
//! L2 regularisation acts on weights, not on biases: g = ∂loss/∂w + λ w.

use super::network::{Parameters, Shape};

/// An update rule and its settings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Optimiser {
    /// Stochastic gradient descent with momentum (§5.2): v ← µ v − ε g, w ← w + v.
    Sgdm {
        /// ε.
        learning_rate: f64,
        /// µ.
        momentum: f64,
        /// λ.
        l2: f64,
    },
    /// Adam (Kingma and Ba 2015), β₁ = 0.9, β₂ = 0.999, ε̂ = 1e-8. The learning rate decays to 0 over the training as a half
    /// cosine.
    Adam {
        /// Initial learning rate.
        learning_rate: f64,
        /// λ.
        l2: f64,
    },
}

impl Optimiser {
    /// Table 5; the paper gives no momentum, 0.9 is the usual value.
    pub const PAPER: Self = Self::Sgdm {
        learning_rate: 1e-3,
        momentum: 0.9,
        l2: 1e-4,
    };

    /// Human-readable description.
    pub fn words(&self) -> String {
        match self {
            Self::Sgdm {
                learning_rate,
                momentum,
                l2,
            } => format!("SGDM, learning rate {learning_rate}, momentum {momentum}, L2 {l2} on weights"),
            Self::Adam { learning_rate, l2 } => {
                format!("Adam, learning rate {learning_rate} falling to 0 as a half cosine, L2 {l2} on weights")
            }
        }
    }
}

const BETA_1: f64 = 0.9;
const BETA_2: f64 = 0.999;
const EPSILON: f64 = 1e-8;

/// An optimiser with its state.
#[derive(Clone, Debug)]
pub struct OptimiserState {
    optimiser: Optimiser,
    /// Velocity, or first moment.
    first: Parameters,
    /// Second moment.
    second: Parameters,
    steps: u64,
    total_steps: u64,
    power_1: f64,
    power_2: f64,
}

impl OptimiserState {
    /// Initial state, for `total_steps` steps.
    pub fn new(optimiser: Optimiser, shape: Shape, total_steps: u64) -> Self {
        Self {
            optimiser,
            first: Parameters::zero(shape),
            second: Parameters::zero(shape),
            steps: 0,
            total_steps,
            power_1: 1.0,
            power_2: 1.0,
        }
    }

    /// Updates `network` by one step.
    pub fn step(&mut self, network: &mut Parameters, gradient: &Parameters) {
        let progress = self.steps as f64 / self.total_steps.max(1) as f64;
        self.steps += 1;
        self.power_1 *= BETA_1;
        self.power_2 *= BETA_2;
        let (correct_1, correct_2) = (1.0 / (1.0 - self.power_1), 1.0 / (1.0 - self.power_2));
        let blocks = network.blocks_mut().into_iter().zip(gradient.blocks());
        let moments = self.first.blocks_mut().into_iter().zip(self.second.blocks_mut());
        for (((weights, regularised), gradient), ((first, _), (second, _))) in blocks.zip(moments) {
            let weights = weights.padded_mut().iter_mut().zip(gradient.padded());
            let first = first.padded_mut().iter_mut();
            match self.optimiser {
                Optimiser::Sgdm {
                    learning_rate,
                    momentum,
                    l2,
                } => {
                    let l2 = if regularised { l2 } else { 0.0 };
                    for ((w, g), v) in weights.zip(first) {
                        *v = momentum * *v - learning_rate * (g + l2 * *w);
                        *w += *v;
                    }
                }
                Optimiser::Adam { learning_rate, l2 } => {
                    let l2 = if regularised { l2 } else { 0.0 };
                    let rate = learning_rate * 0.5 * (1.0 + libm::cos(std::f64::consts::PI * progress));
                    for (((w, g), m), s) in weights.zip(first).zip(second.padded_mut()) {
                        let g = g + l2 * *w;
                        *m = BETA_1 * *m + (1.0 - BETA_1) * g;
                        *s = BETA_2 * *s + (1.0 - BETA_2) * g * g;
                        *w -= rate * (*m * correct_1) / ((*s * correct_2).sqrt() + EPSILON);
                    }
                }
            }
        }
    }
}
