//! Cold battery: its resistance grows exponentially below 25 °C and falls as it warms in flight.

use super::prelude::*;

/// Row 39 of the catalogue.
pub(super) static DECLARATION: EffectDeclaration = EffectDeclaration {
    id: "cold-battery",
    name: "Cold battery",
    catalogue_number: Some(39),
    class: EffectClass::Physics,
    equation: "R → R exp(k ΔT e^(−t/T_w)),   ΔT = 25 °C − T,   k = 0.037/K",
    places: &[Place::Battery],
    channels: &[VOLTAGE],
    parameters: &[
        ParameterDeclaration::size(
            "below_25_k",
            "ΔT",
            "K",
            "how far below 25 °C the flight begins",
            (0.0, 45.0),
            25.0,
            25.0,
        ),
        ParameterDeclaration::shape(
            "warming_s",
            "T_w",
            "s",
            "time constant of the warming",
            (30.0, 900.0),
            180.0,
        ),
    ],
    per_rotor: false,
    may_set_in: false,
    needs: &[],
    search: Search::by(Strategy::BatteryState(AtBattery::Inside)).requiring(&[Requirement::BatteryVoltage]),
    excited_by: "a cold start and a flight of minutes",
    confused_with: &["internal-resistance", "battery-rc"],
    source: "LiPo practice: 2 to 3 times the resistance at 0 °C",
    build: Build::BuiltIn(|setup| {
        Box::new(ColdBattery {
            below: setup.values[0],
            per_warming: 1.0 / setup.values[1],
        })
    }),
};

/// Growth of the resistance per kelvin: 2.5 times at 0 °C.
const GROWTH_PER_K: f64 = 0.037;

#[derive(Debug, Clone)]
struct ColdBattery {
    below: f64,
    per_warming: f64,
}

impl ActiveEffect for ColdBattery {
    fn hooks(&self) -> Hooks {
        Hooks::VARYING_CONSTANTS.and(Hooks::ADVANCE)
    }

    fn boxed_clone(&self) -> Box<dyn ActiveEffect> {
        Box::new(self.clone())
    }

    fn constants(&self, constants: &mut Constants) {
        constants.internal_resistance_ohm *= libm::exp(GROWTH_PER_K * self.below);
    }

    fn advance(&mut self, _at: &Moment<'_>, step_s: f64) {
        self.below *= libm::exp(-step_s * self.per_warming);
    }
}
