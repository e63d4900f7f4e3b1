//! An effect that was named, with what its round knew.

use super::result::Rival;

/// A named effect with what its round knew.
pub(crate) struct Named {
    pub(crate) candidate: usize,
    pub(crate) log_bayes_factor: f64,
    pub(crate) posterior: f64,
    pub(crate) minimum: f64,
    pub(crate) compatible: Vec<Rival>,
    pub(crate) lost: Vec<Rival>,
    /// Found together with the effect through which it acts: its rivals have not been tried beside that.
    pub(crate) together: bool,
}

/// Evidence gap below which the flight cannot tell.
pub(crate) const UNTOLD_GAP: f64 = 1.5;
