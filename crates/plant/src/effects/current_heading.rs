//! Heading that errs with the current: the field of the power leads at the magnetometer, which turns with the vehicle.
//!
//! The field adds to the horizontal one of the earth, so that the error grows with the current and goes round with the heading:
//! about −(b_y cos ψ + b_x sin ψ) I/I_h. A heading offset is the same at every current and heading.

use super::prelude::*;

/// The twin takes the current from a smoothed specific force, as the thrusts are not known yet where it corrects the
/// heading: on flights of the independent simulator with fast changes of thrust the field was up to 5 % off.
const BLUR: f64 = 0.08;

/// Row 58 of the catalogue.
pub(super) static DECLARATION: EffectDeclaration = EffectDeclaration {
    id: "current-heading",
    name: "Heading error of the current",
    catalogue_number: Some(58),
    class: EffectClass::SensorFault,
    equation: "ψ_m = atan2(sin ψ − b_y I/I_h, cos ψ + b_x I/I_h),   I/I_h = (V₀/V) Σ (f_i/f_h)^1.5/n",
    places: &[Place::Reading],
    channels: &[VELOCITY, ATTITUDE],
    parameters: &[
        ParameterDeclaration::size(
            "forward_share",
            "b_x",
            "",
            "field of the current of hover along body x, over the earth's horizontal field",
            (-0.4, 0.4),
            0.12,
            0.12,
        ),
        ParameterDeclaration::size(
            "right_share",
            "b_y",
            "",
            "the same along body y",
            (-0.4, 0.4),
            0.12,
            -0.1,
        ),
    ],
    per_rotor: false,
    may_set_in: false,
    needs: &[],
    search: Search::LINEAR.blurred(BLUR),
    excited_by: "turns of the heading and changes of thrust, with horizontal acceleration",
    confused_with: &["heading-offset", "gyro-bias", "gyro-scale", "attitude-latency"],
    source: "ArduPilot compassmot: 10 to 60 % of the earth's field at full throttle",
    build: Build::BuiltIn(|setup| {
        let hover = setup.nominal.hover_thrust_n;
        Box::new(CurrentHeading {
            field: [setup.values[0], setup.values[1]],
            per_power: setup.nominal.reference_voltage_v / (setup.nominal.rotor_count as f64 * hover * hover.sqrt()),
        })
    }),
};

#[derive(Debug, Clone)]
struct CurrentHeading {
    /// Along body x and y at the current of hover, over the earth's horizontal field.
    field: [f64; 2],
    /// V₀/Σ f_h^1.5, V/N^1.5.
    per_power: f64,
}

impl ActiveEffect for CurrentHeading {
    fn hooks(&self) -> Hooks {
        Hooks::READINGS
    }

    fn boxed_clone(&self) -> Box<dyn ActiveEffect> {
        Box::new(self.clone())
    }

    fn readings(&mut self, at: &Moment<'_>, readings: &mut Readings) {
        let power: f64 = at.rotor_thrust.iter().map(|f| f.max(0.0) * f.max(0.0).sqrt()).sum();
        // Without a voltage that of half charge.
        let voltage = if at.battery_voltage > 0.0 {
            at.battery_voltage
        } else {
            at.constants.reference_voltage_v
        };
        let current = self.per_power * power / voltage;
        let [forward, right] = self.field.map(|share| share * current);
        let (sin, cos) = libm::sincos(readings.attitude[2]);
        // The angle between the field with and without the current, so that a heading beyond π stays there.
        let (across, along) = (right * cos + forward * sin, 1.0 + forward * cos - right * sin);
        if across != 0.0 {
            readings.attitude[2] -= libm::atan2(across, along);
        }
    }
}
