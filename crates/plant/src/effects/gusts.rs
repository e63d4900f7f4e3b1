//! Gusts: a noise class. Wind that changes at random and acts through drag, in two forms.
//!
//! Gauss–Markov: one first-order process per axis, discretised exactly at the step. Dryden: the length scale passes at the air
//! speed, T = L/max(|v_a|, 1 m/s); the longitudinal form (first order) on the horizontal axes, the transverse form (second order)
//! on the vertical one. Values start at 0. The draws of a log cannot be predicted: a diagnosis compares covariances.

use super::prelude::*;

/// Row 5 of the catalogue.
pub(super) static GAUSS_MARKOV: EffectDeclaration = EffectDeclaration {
    id: "gusts",
    name: "Gusts (Gauss–Markov)",
    catalogue_number: Some(5),
    class: EffectClass::Noise,
    equation: "w' = −w/T + σ √(2/T) n,   n white",
    places: &[Place::Wind],
    channels: &[FORCE],
    parameters: &[
        ParameterDeclaration::size(
            "rms_m_s",
            "σ",
            "m/s",
            "standard deviation per axis",
            (0.0, 4.0),
            1.5,
            1.5,
        ),
        ParameterDeclaration::shape("correlation_s", "T", "s", "correlation time L/V", (0.5, 10.0), 1.5),
    ],
    per_rotor: false,
    may_set_in: true,
    needs: &["rotor-drag", "quadratic-drag", "linear-friction"],
    search: Search::by(Strategy::Covariance).requiring(&[Requirement::AirVelocity]),
    excited_by: "open air",
    confused_with: &["slung-load", "rotor-drag", "wind"],
    source: "MIL-F-8785C, first-order form",
    build: Build::BuiltIn(|setup| Box::new(Gusts::new(setup, Form::GaussMarkov))),
};

/// Row 5 of the catalogue.
pub(super) static DRYDEN: EffectDeclaration = EffectDeclaration {
    id: "dryden-gusts",
    name: "Gusts (Dryden)",
    catalogue_number: Some(5),
    class: EffectClass::Noise,
    equation: "longitudinal σ √(2L/V)/(1 + sL/V), transverse σ √(L/V) (1 + √3 sL/V)/(1 + sL/V)²",
    places: &[Place::Wind],
    channels: &[FORCE],
    parameters: &[
        ParameterDeclaration::size(
            "rms_m_s",
            "σ",
            "m/s",
            "standard deviation per axis",
            (0.0, 4.0),
            1.5,
            1.5,
        ),
        ParameterDeclaration::shape(
            "length_m",
            "L",
            "m",
            "length scale of the turbulence",
            (5.0, 200.0),
            10.0,
        ),
    ],
    per_rotor: false,
    may_set_in: true,
    needs: &["rotor-drag", "quadratic-drag", "linear-friction"],
    search: Search::by(Strategy::CovarianceOf("gusts")).requiring(&[Requirement::AirVelocity]),
    excited_by: "open air, flight at speed",
    confused_with: &["gusts", "slung-load"],
    source: "MIL-F-8785C, low altitude",
    build: Build::BuiltIn(|setup| Box::new(Gusts::new(setup, Form::Dryden))),
};

/// Below this air speed the turbulence passes at it: it changes in time, too, m/s.
const SLOWEST_M_S: f64 = 1.0;

#[derive(Debug, Clone, Copy, PartialEq)]
enum Form {
    GaussMarkov,
    Dryden,
}

#[derive(Debug, Clone)]
struct Gusts {
    form: Form,
    rms: f64,
    /// Correlation time s, or length scale m.
    scale: f64,
    wind: Vector3,
    /// States of the vertical Dryden filter.
    inner: [f64; 2],
    noise: NormalStream,
}

impl Gusts {
    fn new(setup: &Setup<'_>, form: Form) -> Self {
        Self {
            form,
            rms: setup.values[0],
            scale: setup.values[1],
            wind: [0.0; 3],
            inner: [0.0; 2],
            noise: NormalStream::new(setup.seed, &format!("effect/gusts/{}", setup.index)),
        }
    }
}

impl ActiveEffect for Gusts {
    fn hooks(&self) -> Hooks {
        Hooks::WIND.and(Hooks::ADVANCE)
    }

    fn boxed_clone(&self) -> Box<dyn ActiveEffect> {
        Box::new(self.clone())
    }

    fn wind(&mut self, _at: &Moment<'_>, wind_ned: &mut Vector3) {
        for i in 0..3 {
            wind_ned[i] += self.wind[i];
        }
    }

    fn advance(&mut self, at: &Moment<'_>, step_s: f64) {
        let noise = self.noise.sample3();
        let time = match self.form {
            Form::GaussMarkov => self.scale,
            Form::Dryden => self.scale / length(at.air_velocity_body).max(SLOWEST_M_S),
        };
        let decay = libm::exp(-step_s / time);
        let kick = self.rms * (1.0 - decay * decay).sqrt();
        if self.form == Form::GaussMarkov {
            for i in 0..3 {
                self.wind[i] = decay * self.wind[i] + kick * noise[i];
            }
            return;
        }
        for i in 0..2 {
            self.wind[i] = decay * self.wind[i] + kick * noise[i];
        }
        // Partial fractions of the transverse form: y = σ/√2 (√3 x₁ + (1 − √3) x₂), x₁ of variance 1, x₂ its first-order lag.
        let before = self.inner[0];
        self.inner[0] = decay * before + (1.0 - decay * decay).sqrt() * noise[2];
        self.inner[1] = decay * self.inner[1] + (1.0 - decay) * 0.5 * (before + self.inner[0]);
        let root = 3.0_f64.sqrt();
        self.wind[2] =
            self.rms * std::f64::consts::FRAC_1_SQRT_2 * (root * self.inner[0] + (1.0 - root) * self.inner[1]);
    }
}
