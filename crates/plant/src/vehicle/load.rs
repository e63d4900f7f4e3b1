//! Loads that are dropped in flight, and the mass properties that remain.
//!
//! A load of mass Δ hangs fixed at p on a vehicle of mass m, centre of mass c and inertia J, which include it. Released without a push,
//! it leaves
//!
//! m' = m − Δ,   c' = c − Δ/m' (p − c),   J' = J − (m Δ/m') S(p − c),   S(d) = |d|² I − d dᵀ
//!
//! about c' (parallel axes, the load a point). The body keeps its attitude and its rates; c' moves with v + ω × (c' − c). With the load,
//! which moves with v + ω × (p − c), momentum, angular momentum and energy are those of before.
//!
//! Limits: the load is a point, it is gone at once, and it takes no air force with it.

use serde::{Deserialize, Serialize};

use crate::error::{Refusal, all_in_range, in_range};
use crate::vector::Vector3;
use crate::vehicle::model::VehicleModel;
use crate::{STEP_RATE_HZ, STEP_S, nearest_step};

/// A vehicle does not drop more than this share of itself.
const MOST: f64 = 0.5;

/// One `[[load_drop]]` of a scenario. The vehicle's document includes the load in its mass and its inertia.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LoadDrop {
    /// s; the load is gone from the step nearest to it.
    pub time_s: f64,
    /// kg.
    pub mass_kg: f64,
    /// Where it hangs, m, body, from the centre of mass of the vehicle's document.
    #[serde(default, skip_serializing_if = "is_centre")]
    pub position_body_m: [f64; 3],
}

fn is_centre(position: &[f64; 3]) -> bool {
    *position == [0.0; 3]
}

/// One load: when it goes, and what goes with it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct PlannedDrop {
    /// Place of its entry in the scenario.
    pub(crate) index: usize,
    pub(crate) step: u64,
    /// kg.
    pub(crate) mass: f64,
    /// m, body, from the nominal centre of mass.
    pub(crate) position: Vector3,
}

/// The checked loads of a scenario in the order in which they go.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct LoadPlan(Vec<PlannedDrop>);

impl LoadPlan {
    /// Checks all entries against the vehicle; `duration_steps` is the length of the flight.
    pub fn new(entries: &[LoadDrop], vehicle: &VehicleModel, duration_steps: u64) -> Result<Self, Refusal> {
        let under = |index: usize| move |refusal: Refusal| refusal.under(&format!("load_drop[{index}]"));
        let mut drops = Vec::with_capacity(entries.len());
        for (index, entry) in entries.iter().enumerate() {
            drops.push(entry.plan(index, duration_steps).map_err(under(index))?);
        }
        drops.sort_by_key(|drop| drop.step);
        let whole = vehicle.body.mass_kg;
        let mut remaining = MassProperties::of(vehicle);
        for drop in &drops {
            let refuse = |key: &str, reason: String| Err(under(drop.index)(Refusal::new(key, reason)));
            let after = remaining.without(drop.mass, drop.position);
            if after.mass < (1.0 - MOST) * whole {
                return refuse(
                    "mass_kg",
                    format!(
                        "expected loads of at most {} kg together, {} % of the vehicle's mass, which includes them; got {} kg",
                        MOST * whole,
                        100.0 * MOST,
                        whole - after.mass,
                    ),
                );
            }
            if !after.has_real_inertia() {
                return refuse(
                    "position_body_m",
                    format!(
                        "expected a place nearer to the centre of mass: the vehicle's inertia includes the load, and {} kg there have \
                         more of it than the vehicle",
                        drop.mass
                    ),
                );
            }
            remaining = after;
        }
        Ok(Self(drops))
    }

    /// True if nothing is dropped.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    pub(crate) fn drops(&self) -> &[PlannedDrop] {
        &self.0
    }
}

impl LoadDrop {
    fn plan(&self, index: usize, duration_steps: u64) -> Result<PlannedDrop, Refusal> {
        in_range("time_s", self.time_s, STEP_S, 1e6, "s")?;
        let step = nearest_step(self.time_s);
        if step >= duration_steps {
            let reason = format!(
                "this load cannot have an effect: it is dropped at {} s, the flight ends at {} s",
                self.time_s,
                duration_steps as f64 / STEP_RATE_HZ
            );
            return Err(Refusal::new("time_s", reason));
        }
        in_range("mass_kg", self.mass_kg, 1e-4, 100.0, "kg")?;
        all_in_range("position_body_m", &self.position_body_m, -5.0, 5.0, "m")?;
        Ok(PlannedDrop {
            index,
            step,
            mass: self.mass_kg,
            position: self.position_body_m,
        })
    }
}

/// Mass, centre and inertia of a body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct MassProperties {
    /// m, kg.
    pub(crate) mass: f64,
    /// c, m, body.
    pub(crate) centre: Vector3,
    /// J about c, kg·m², body.
    pub(crate) inertia: [Vector3; 3],
}

impl MassProperties {
    /// Of the vehicle's document.
    fn of(vehicle: &VehicleModel) -> Self {
        let mut inertia = [[0.0; 3]; 3];
        for (axis, &j) in vehicle.body.inertia_body_kg_m2.iter().enumerate() {
            inertia[axis][axis] = j;
        }
        Self {
            mass: vehicle.body.mass_kg,
            centre: [0.0; 3],
            inertia,
        }
    }

    /// What remains without a point of `load` kg at `position`, m, body.
    pub(crate) fn without(&self, load: f64, position: Vector3) -> Self {
        let remaining = self.mass - load;
        let d = [0, 1, 2].map(|i| position[i] - self.centre[i]);
        let reduced = self.mass * load / remaining;
        let square = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
        let mut inertia = self.inertia;
        for (row, entries) in inertia.iter_mut().enumerate() {
            for (column, entry) in entries.iter_mut().enumerate() {
                let diagonal = if row == column { square } else { 0.0 };
                *entry -= reduced * (diagonal - d[row] * d[column]);
            }
        }
        Self {
            mass: remaining,
            centre: [0, 1, 2].map(|i| self.centre[i] - load / remaining * d[i]),
            inertia,
        }
    }

    /// Whether masses exist that have this inertia: ∫ r rᵀ dm = ½ tr(J) I − J has no negative eigenvalue.
    fn has_real_inertia(&self) -> bool {
        let j = nalgebra::Matrix3::from_fn(|row, column| self.inertia[row][column]);
        let second = nalgebra::Matrix3::identity() * (0.5 * j.trace()) - j;
        // Rounding of a flat body, one eigenvalue of which is 0.
        let least = second.symmetric_eigenvalues().min();
        least >= -1e-9 * j.trace()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vector::cross;
    use proptest::prelude::*;

    /// Relative rounding of sums of a few products.
    const TOLERANCE: f64 = 1e-12;

    fn dot(a: Vector3, b: Vector3) -> f64 {
        a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    }

    fn small(size: f64) -> impl Strategy<Value = Vector3> {
        [-size..size, -size..size, -size..size]
    }

    proptest! {
        /// Momentum, angular momentum about the old centre, and energy of both parts together are those of the whole.
        #[test]
        fn prop_a_released_load_conserves_momentum_and_energy(
            load in 0.01..0.7f64, centre in small(0.01), position in small(0.1), velocity in small(10.0), rates in small(5.0)
        ) {
            let whole = MassProperties {
                mass: 1.55,
                centre,
                inertia: [[0.0266, 1e-3, -2e-3], [1e-3, 0.0266, 5e-4], [-2e-3, 5e-4, 0.0498]],
            };
            let rest = whole.without(load, position);
            let moved = |place: Vector3| {
                let turning = cross(rates, [0, 1, 2].map(|i| place[i] - centre[i]));
                [0, 1, 2].map(|i| velocity[i] + turning[i])
            };
            let spin = |body: &MassProperties| [0, 1, 2].map(|row| dot(body.inertia[row], rates));
            let (of_rest, of_load) = (moved(rest.centre), moved(position));
            let energy = |body: &MassProperties, v: Vector3| 0.5 * (body.mass * dot(v, v) + dot(rates, spin(body)));
            let before = energy(&whole, velocity);
            let after = energy(&rest, of_rest) + 0.5 * load * dot(of_load, of_load);
            prop_assert!((before - after).abs() <= TOLERANCE * before.max(1.0), "{before} J, {after} J");
            let about = |place: Vector3, momentum: Vector3| cross([0, 1, 2].map(|i| place[i] - centre[i]), momentum);
            let turned = about(rest.centre, of_rest.map(|v| rest.mass * v));
            let taken = about(position, of_load.map(|v| load * v));
            for i in 0..3 {
                let momentum = rest.mass * of_rest[i] + load * of_load[i];
                prop_assert!((momentum - whole.mass * velocity[i]).abs() <= 10.0 * TOLERANCE);
                let angular = spin(&rest)[i] + turned[i] + taken[i];
                prop_assert!((angular - spin(&whole)[i]).abs() <= 10.0 * TOLERANCE, "{angular}");
            }
        }
    }

    #[test]
    fn val_what_a_load_below_leaves() {
        // By hand: 0.3 kg 0.1 m below 1.5 kg leave 1.2 kg with its centre 0.025 m higher; m Δ/m' = 0.375 kg.
        let whole = MassProperties {
            mass: 1.5,
            centre: [0.0; 3],
            inertia: [[0.03, 0.0, 0.0], [0.0, 0.03, 0.0], [0.0, 0.0, 0.05]],
        };
        let rest = whole.without(0.3, [0.0, 0.0, 0.1]);
        assert!((rest.mass - 1.2).abs() < TOLERANCE);
        assert!((rest.centre[2] + 0.025).abs() < TOLERANCE);
        for (axis, expected) in [0.03 - 0.00375, 0.03 - 0.00375, 0.05].into_iter().enumerate() {
            assert!((rest.inertia[axis][axis] - expected).abs() < TOLERANCE);
        }
    }

    #[test]
    fn val_no_load_has_more_inertia_than_the_vehicle() {
        let vehicle = crate::testing::vehicle("f550");
        let load = |position_body_m| LoadDrop {
            time_s: 1.0,
            mass_kg: 0.15,
            position_body_m,
        };
        assert!(LoadPlan::new(&[load([0.0, 0.0, 0.09])], &vehicle, 4000).is_ok());
        let refusal = LoadPlan::new(&[load([0.0, 0.0, 0.2])], &vehicle, 4000).unwrap_err();
        assert_eq!(refusal.key, "load_drop[0].position_body_m");
        let heavy = LoadDrop {
            mass_kg: 0.4,
            ..load([0.0; 3])
        };
        let refusal = LoadPlan::new(&[heavy.clone(), heavy], &vehicle, 4000).unwrap_err();
        assert_eq!(refusal.key, "load_drop[1].mass_kg");
    }
}
