//! The paper's data set (§5.2): four trajectories × two charges × each rotor faulty, 90 s each.
//!
//! A base scenario provides vehicle, controller, sensors, mismatch and detector settings; the protocol replaces trajectory, charge
//! and faults. From 45 s on the rotor carries blade b, from 60 s c, from 75 s d: half of the flight is healthy. Noise and lift
//! biases of every flight come from its own seed.
//!
//! The paper says "two smooth helicoid trajectories, one hovering and one waypoint navigation" without numbers; those used here are
//! this project's choice. Almost all errors of the paper's network occur in the waypoint flight, whose reference velocity jumps at
//! the corners, so its results are reported separately.

use rotortwin_plant::powertrain::faults::FaultEntry;
use rotortwin_plant::random::RandomStream;
use rotortwin_plant::trajectory::Trajectory;
use rotortwin_scenario::scenario_document::Start;
use rotortwin_scenario::settings::ThrustToDutyMap;
use rotortwin_scenario::{ConfigError, Scenario};

/// Length of every flight, s.
pub const DURATION_S: f64 = 90.0;

/// Initial charges, fraction.
pub const CHARGES: [f64; 2] = [0.4, 1.0];

/// Onset in s and blade of the three successive faults.
pub const FAULTS: [(f64, &str); 3] = [(45.0, "b"), (60.0, "c"), (75.0, "d")];

/// The four trajectories; the cross-validation holds out each in turn.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Course {
    /// Helicoid of 2 m with 15 s per turn, oscillating yaw: the reference flight.
    Helix1,
    /// Helicoid of 4 m with 12 s per turn.
    Helix2,
    /// Hover.
    Hover,
    /// A new point every 9 s, 2.5 m/s between them.
    Waypoints,
}

impl Course {
    /// In the order of the tables.
    pub const ALL: [Self; 4] = [Self::Helix1, Self::Helix2, Self::Hover, Self::Waypoints];

    /// Name for display and files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Helix1 => "helix 1",
            Self::Helix2 => "helix 2",
            Self::Hover => "hover",
            Self::Waypoints => "waypoints",
        }
    }

    /// Index in [`Course::ALL`].
    pub fn index(self) -> usize {
        self as usize
    }

    /// The reference to follow.
    pub fn trajectory(self) -> Trajectory {
        let helix = |radius_m, turn_s, climb_amplitude_m, climb_period_s, yaw_amplitude_rad| Trajectory::Helix {
            radius_m,
            turn_s,
            start_height_m: 5.0,
            climb_amplitude_m,
            climb_period_s,
            yaw_amplitude_rad,
            yaw_period_s: 30.0,
        };
        match self {
            Self::Helix1 => helix(2.0, 15.0, 1.5, 45.0, 0.3),
            Self::Helix2 => helix(4.0, 12.0, 2.0, 30.0, 0.0),
            Self::Hover => Trajectory::Hover {
                position_ned_m: [0.0, 0.0, -5.0],
                yaw_rad: 0.0,
            },
            Self::Waypoints => Trajectory::Waypoints {
                points_ned_m: vec![
                    [0.0, 0.0, -5.0],
                    [5.0, 0.0, -5.0],
                    [5.0, 5.0, -7.0],
                    [0.0, 5.0, -7.0],
                    [-3.0, 2.0, -4.0],
                    [0.0, 0.0, -5.0],
                    [4.0, -4.0, -6.0],
                    [-4.0, -4.0, -6.0],
                    [-4.0, 4.0, -8.0],
                    [0.0, 0.0, -5.0],
                ],
                interval_s: 9.0,
                speed_m_s: 2.5,
                yaw_rad: 0.0,
            },
        }
    }
}

/// One flight of the data set.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FlightPlan {
    /// Trajectory.
    pub course: Course,
    /// Initial SoC, fraction.
    pub charge: f64,
    /// Faulty rotor, from 0.
    pub rotor: usize,
    /// Seed of its noise and biases.
    pub seed: u64,
}

/// Common properties of the flights of a data set beyond the base scenario; the paper specifies neither.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Conduct {
    /// How the controller converts thrust to duty.
    pub thrust_to_duty: ThrustToDutyMap,
    /// Initial state of the rotors.
    pub start: Start,
}

impl Conduct {
    /// As in the reference flight: u = f/full thrust, from trimmed hover.
    pub const STANDARD: Self = Self {
        thrust_to_duty: ThrustToDutyMap::Linear,
        start: Start::Trimmed,
    };
}

/// The 8 n_a flights of `seed` for a vehicle with `rotor_count` rotors: trajectory by trajectory, charge by charge, rotor by rotor.
pub fn flight_plans(rotor_count: usize, seed: u64) -> Vec<FlightPlan> {
    let mut random = RandomStream::new(seed, "protocol/flight-seeds");
    let mut plans = Vec::with_capacity(Course::ALL.len() * CHARGES.len() * rotor_count);
    for course in Course::ALL {
        for charge in CHARGES {
            for rotor in 0..rotor_count {
                plans.push(FlightPlan {
                    course,
                    charge,
                    rotor,
                    // 53 random bits: exact in every format that stores a seed.
                    seed: (random.unit() * (1u64 << 53) as f64) as u64,
                });
            }
        }
    }
    plans
}

/// The scenario of one flight, without a classifier.
pub fn flight_scenario(base: &Scenario, conduct: Conduct, plan: &FlightPlan) -> Result<Scenario, ConfigError> {
    let mut documents = base.documents().clone();
    documents.classifier = None;
    let scenario = &mut documents.scenario;
    scenario.fdi.network = None;
    scenario.name = format!(
        "{}_charge-{}_rotor-{}",
        plan.course.name().replace(' ', "-"),
        plan.charge,
        plan.rotor + 1
    );
    scenario.duration_s = DURATION_S;
    scenario.seed = plan.seed;
    scenario.trajectory = plan.course.trajectory();
    scenario.initial.state_of_charge = plan.charge;
    scenario.initial.start = conduct.start;
    scenario.controller.thrust_to_duty = conduct.thrust_to_duty;
    scenario.sensor_fault.clear();
    scenario.load_drop.clear();
    scenario.fault = FAULTS
        .iter()
        .map(|(time_s, blade)| FaultEntry {
            time_s: *time_s,
            rotor: u32::try_from(plan.rotor + 1).expect("at most 16 rotors"),
            blade: Some((*blade).to_owned()),
            ..FaultEntry::default()
        })
        .collect();
    Scenario::from_documents(&documents)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_plans_are_the_grid_with_seeds_of_their_own() {
        let plans = flight_plans(6, 1);
        assert_eq!(plans.len(), 48);
        let mut seeds: Vec<u64> = plans.iter().map(|plan| plan.seed).collect();
        seeds.sort_unstable();
        seeds.dedup();
        assert_eq!(seeds.len(), 48);
        assert_eq!(flight_plans(6, 1), plans);
        assert_ne!(flight_plans(6, 2)[0].seed, plans[0].seed);
        let last = plans.last().expect("48 plans");
        assert_eq!((last.course, last.rotor), (Course::Waypoints, 5));
    }
}
