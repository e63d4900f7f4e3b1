//! What the plant integrates.

use rotortwin_flight_core::MAX_ROTORS;

use crate::body::rigid_body::RigidBodyState;

/// Integrated state.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PlantState {
    pub(crate) body: RigidBodyState,
    pub(crate) thrust: [f64; MAX_ROTORS],
    pub(crate) state_of_charge: f64,
}
