//! Force and torque on the body, as effects add to them.

use crate::vector::Vector3;

/// Force and torque on the body about its centre of mass.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Wrench {
    /// N, body; without gravity.
    pub force_body: Vector3,
    /// N·m, body.
    pub torque_body: Vector3,
    /// Air drag, N, body: kept apart because it acts at the drag centre. [`Constants::closed`](super::Constants::closed) adds it to the others.
    pub drag_body: Vector3,
}
