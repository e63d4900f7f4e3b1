//! Flex of arms or landing gear: part of the rotor torque reaches the body through a resonant mode.
//!
//! M_body = M + s (y − M), y the mode driven by M. The mode is discretised exactly for a torque held over the step; the body gets the
//! mean over the step. Acts on the torque of the rotors and of the effects before it in the list.

use super::prelude::*;

/// Row 22 of the catalogue.
pub(super) static DECLARATION: EffectDeclaration = EffectDeclaration {
    id: "frame-flex",
    name: "Flex of arms or gear",
    catalogue_number: Some(22),
    class: EffectClass::Physics,
    equation: "M_body = (1 − s) M + s y,   y'' = ω² (M − y) − 2ζω y'",
    places: &[Place::Torque],
    channels: &[MOMENT],
    parameters: &[
        ParameterDeclaration::size(
            "share",
            "s",
            "",
            "share of the torque that passes through the mode",
            (0.0, 1.0),
            0.5,
            0.5,
        ),
        ParameterDeclaration::shape("frequency_hz", "ω/2π", "Hz", "frequency of the mode", (8.0, 60.0), 25.0),
        ParameterDeclaration::shape("damping", "ζ", "", "damping ratio", (0.005, 0.5), 0.05),
    ],
    per_rotor: false,
    may_set_in: true,
    needs: &[],
    search: Search::by(Strategy::Shapes(Shapes::Range(&["frequency_hz"]))).requiring(&[Requirement::FrequentCommand]),
    excited_by: "steps of the torque",
    confused_with: &["command-delay", "motor-time-constant"],
    source: "second-order mode",
    build: Build::BuiltIn(|setup| Box::new(Flex::new(setup))),
};

#[derive(Debug, Clone)]
struct Flex {
    share: f64,
    frequency: f64,
    damping: f64,
    deflection: Vector3,
    rate: Vector3,
    torque: Vector3,
    step_s: f64,
    transition: [[f64; 2]; 2],
}

impl Flex {
    fn new(setup: &Setup<'_>) -> Self {
        Self {
            share: setup.values[0],
            frequency: 2.0 * std::f64::consts::PI * setup.values[1],
            damping: setup.values[2],
            deflection: [0.0; 3],
            rate: [0.0; 3],
            torque: [0.0; 3],
            step_s: 0.0,
            transition: [[1.0, 0.0], [0.0, 1.0]],
        }
    }

    /// Transition of (y − M, y') over one step of the underdamped mode.
    fn prepare(&mut self, step_s: f64) {
        let (w, z) = (self.frequency, self.damping.min(0.999));
        let damped = w * (1.0 - z * z).sqrt();
        let (sin, cos) = libm::sincos(damped * step_s);
        let decay = libm::exp(-z * w * step_s);
        let lean = z * w / damped * sin;
        self.transition = [
            [decay * (cos + lean), decay * sin / damped],
            [-decay * w * w / damped * sin, decay * (cos - lean)],
        ];
        self.step_s = step_s;
    }

    /// y − M and y' of an axis at the end of the step: free motion about the rest at y = M.
    fn at_end(&self, axis: usize) -> (f64, f64) {
        let [[a, b], [c, d]] = self.transition;
        let (away, rate) = (self.deflection[axis] - self.torque[axis], self.rate[axis]);
        (a * away + b * rate, c * away + d * rate)
    }

    /// Mean of y − M over the step, from the integral of the mode's equation: at 25 Hz the value at the start of a step of 2.5 ms is
    /// off by a fifth of the amplitude.
    fn mean_away(&self, axis: usize) -> f64 {
        let (away, rate) = (self.deflection[axis] - self.torque[axis], self.rate[axis]);
        let (end, end_rate) = self.at_end(axis);
        let (w, z) = (self.frequency, self.damping.min(0.999));
        -(end_rate - rate + 2.0 * z * w * (end - away)) / (w * w * self.step_s)
    }
}

impl ActiveEffect for Flex {
    fn hooks(&self) -> Hooks {
        Hooks::WRENCH.and(Hooks::ADVANCE)
    }

    fn boxed_clone(&self) -> Box<dyn ActiveEffect> {
        Box::new(self.clone())
    }

    fn wrench(&mut self, at: &Moment<'_>, wrench: &mut Wrench) {
        if at.step_s != self.step_s {
            self.prepare(at.step_s);
        }
        self.torque = wrench.torque_body;
        for i in 0..3 {
            wrench.torque_body[i] += self.share * self.mean_away(i);
        }
    }

    fn advance(&mut self, _at: &Moment<'_>, step_s: f64) {
        if step_s != self.step_s {
            self.prepare(step_s);
        }
        for i in 0..3 {
            let (away, rate) = self.at_end(i);
            self.deflection[i] = self.torque[i] + away;
            self.rate[i] = rate;
        }
    }
}
