//! An effect that was named, with what its round knew.

/// A named effect with the evidence of its round.
pub(crate) struct Named {
    pub(crate) candidate: usize,
    pub(crate) log_bayes_factor: f64,
    pub(crate) posterior: f64,
    pub(crate) minimum: f64,
    /// The others that were fitted in its round, best first.
    pub(crate) rivals: Vec<RivalFit>,
    /// Found together with the effect through which it acts: its rivals have not been tried with that.
    pub(crate) together: bool,
}

/// Another candidate that was fitted in the round of a named one.
pub(crate) struct RivalFit {
    pub(crate) candidate: usize,
    /// ln of the Bayes factor of the named effect against it.
    pub(crate) gap: f64,
    /// The size it would need, if that is outside what real vehicles have.
    pub(crate) implausible: Option<Quantity>,
}

/// A value of a parameter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Quantity {
    pub(crate) symbol: &'static str,
    pub(crate) value: f64,
    pub(crate) unit: &'static str,
}

/// Evidence gap below which the flight cannot decide.
pub(crate) const UNTOLD_GAP: f64 = 1.5;
