//! Surroundings of the vehicle: constant wind, gusts, and the disturbance wrench of the `realistic` preset.
//!
//! Gusts and disturbances are Gauss–Markov processes, one independent component per axis, discretised exactly at 400 Hz and held
//! over each step: x_{k+1} = a x_k + σ √(1 − a²) n_k, a = exp(−h/T); x_0 is drawn from the stationary distribution.
//! Wind acts through the linear drag of Eq. 1 only.

use serde::{Deserialize, Serialize};

use crate::STEP_S;
use crate::body::rigid_body::Surroundings;
use crate::error::{Refusal, all_in_range, in_range};
use crate::random::NormalStream;
use crate::vector::Vector3;

/// `[wind]` of a scenario.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WindModel {
    /// Constant part, m/s, NED: the direction in which the air moves.
    #[serde(default)]
    pub mean_ned_m_s: [f64; 3],
    /// Standard deviation of the gusts per axis, m/s.
    #[serde(default)]
    pub gust_rms_m_s: f64,
    /// Correlation time of the gusts, s.
    #[serde(default = "two_seconds")]
    pub gust_correlation_s: f64,
}

fn two_seconds() -> f64 {
    2.0
}

impl WindModel {
    /// Rejects invalid wind, or wind that cannot have an effect; `linear_drag` of the vehicle, kg/s.
    pub fn check(&self, linear_drag: f64) -> Result<(), Refusal> {
        all_in_range("mean_ned_m_s", &self.mean_ned_m_s, -60.0, 60.0, "m/s")?;
        in_range("gust_rms_m_s", self.gust_rms_m_s, 0.0, 30.0, "m/s")?;
        in_range("gust_correlation_s", self.gust_correlation_s, 0.01, 1000.0, "s")?;
        if self.mean_ned_m_s == [0.0; 3] && self.gust_rms_m_s == 0.0 {
            return Err(Refusal::new(
                "",
                "expected some wind, mean and gusts are both 0: leave the section out",
            ));
        }
        if linear_drag == 0.0 {
            let reason = "wind cannot have an effect on this vehicle: its linear drag is 0, so no air force acts on it; give \
                          `body.linear_drag_kg_s` of the vehicle or `mismatch.linear_drag_kg_s` of the scenario";
            return Err(Refusal::new("", reason));
        }
        Ok(())
    }
}

/// A Gauss–Markov process in three independent components.
#[derive(Debug, Clone)]
struct GaussMarkov {
    value: Vector3,
    decay: f64,
    kick: f64,
    noise: NormalStream,
}

impl GaussMarkov {
    /// `None` for an rms of 0.
    fn new(rms: f64, correlation_s: f64, seed: u64, stream: &str) -> Option<Self> {
        if rms == 0.0 {
            return None;
        }
        let mut noise = NormalStream::new(seed, stream);
        let decay = libm::exp(-STEP_S / correlation_s);
        let value = noise.sample3().map(|n| rms * n);
        Some(Self {
            value,
            decay,
            kick: rms * (1.0 - decay * decay).sqrt(),
            noise,
        })
    }

    fn advance(&mut self) {
        let noise = self.noise.sample3();
        for (value, n) in self.value.iter_mut().zip(noise) {
            *value = self.decay * *value + self.kick * n;
        }
    }
}

/// Rms and correlation time of the disturbance wrench.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Disturbance {
    pub(crate) force_rms: f64,
    pub(crate) torque_rms: f64,
    pub(crate) correlation_s: f64,
}

/// Wind and disturbances of one flight.
#[derive(Debug, Clone)]
pub(crate) struct Environment {
    mean_wind: Vector3,
    gust: Option<GaussMarkov>,
    force: Option<GaussMarkov>,
    torque: Option<GaussMarkov>,
    now: Surroundings,
}

impl Environment {
    pub(crate) fn new(wind: Option<&WindModel>, disturbance: Disturbance, seed: u64) -> Self {
        let Disturbance {
            force_rms,
            torque_rms,
            correlation_s,
        } = disturbance;
        let mut environment = Self {
            mean_wind: wind.map_or([0.0; 3], |w| w.mean_ned_m_s),
            gust: wind.and_then(|w| GaussMarkov::new(w.gust_rms_m_s, w.gust_correlation_s, seed, "wind/gust")),
            force: GaussMarkov::new(force_rms, correlation_s, seed, "disturbance/force"),
            torque: GaussMarkov::new(torque_rms, correlation_s, seed, "disturbance/torque"),
            now: Surroundings::default(),
        };
        environment.collect();
        environment
    }

    /// What acts over the current step.
    pub(crate) fn now(&self) -> &Surroundings {
        &self.now
    }

    /// False if it never changes.
    pub(crate) fn moves(&self) -> bool {
        self.gust.is_some() || self.force.is_some() || self.torque.is_some()
    }

    /// Moves to the next step.
    #[inline]
    pub(crate) fn advance(&mut self) {
        let mut moving = false;
        for process in [&mut self.gust, &mut self.force, &mut self.torque]
            .into_iter()
            .flatten()
        {
            process.advance();
            moving = true;
        }
        if moving {
            self.collect();
        }
    }

    fn collect(&mut self) {
        let value = |process: &Option<GaussMarkov>| process.as_ref().map_or([0.0; 3], |p| p.value);
        let gust = value(&self.gust);
        self.now = Surroundings {
            wind_ned: [0, 1, 2].map(|i| self.mean_wind[i] + gust[i]),
            force_ned: value(&self.force),
            torque_body: value(&self.torque),
        };
    }
}
