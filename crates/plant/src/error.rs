//! Errors: a bad value before the flight ([`Refusal`]), an impossible number during it ([`SimulationError`]).
//!
//! Both say everything in one sentence; neither is ever recovered from inside this crate.

/// A flight that cannot continue. The simulation stays at the step named and must not be advanced further.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum SimulationError {
    /// The vehicle's state is no longer a number, for example after a controller drove it to absurd rates.
    #[error("step {step}: {quantity} of the plant is not finite")]
    NonFiniteState {
        /// Step that the plant was to reach.
        step: u64,
        /// First quantity that is NaN or infinite.
        quantity: &'static str,
    },
    /// The controller sent NaN or an infinite duty.
    #[error("step {step}: the duty commanded to rotor {rotor} is not finite")]
    NonFiniteDuty {
        /// Step at whose start the command was to be held.
        step: u64,
        /// Rotor, from 1.
        rotor: usize,
    },
    /// The flight has reached its planned duration.
    #[error("step {step}: the flight is over, no further command is taken")]
    FlightOver {
        /// Last step of the flight.
        step: u64,
    },
}

/// A value that a configuration must not hold: its key relative to the document or table, and the sentence about it.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("`{key}`: {reason}")]
pub struct Refusal {
    /// Dotted path of the key, relative to the document or table that was checked.
    pub key: String,
    /// What was expected and what was found.
    pub reason: String,
}

impl Refusal {
    /// A refused value.
    pub fn new(key: impl Into<String>, reason: impl Into<String>) -> Self {
        Self {
            key: key.into(),
            reason: reason.into(),
        }
    }

    /// The same refusal, seen from the table `prefix` that holds the key.
    #[must_use]
    pub fn under(mut self, prefix: &str) -> Self {
        self.key = if self.key.is_empty() {
            prefix.to_owned()
        } else {
            format!("{prefix}.{}", self.key)
        };
        self
    }
}

/// Refuses a number that is NaN, infinite or outside `[min, max]`.
pub fn in_range(key: &str, value: f64, min: f64, max: f64, unit: &str) -> Result<(), Refusal> {
    if value >= min && value <= max {
        return Ok(());
    }
    let unit = if unit.is_empty() {
        String::new()
    } else {
        format!(" {unit}")
    };
    Err(Refusal::new(
        key,
        format!(
            "expected a number from {} to {}{unit}, got {}",
            plain(min),
            plain(max),
            plain(value)
        ),
    ))
}

/// A number as people write it: 1e-300 rather than 300 zeros.
fn plain(value: f64) -> String {
    let size = value.abs();
    if size != 0.0 && size.is_finite() && !(1e-4..1e7).contains(&size) {
        format!("{value:e}")
    } else {
        value.to_string()
    }
}

/// [`in_range`] for every entry of a list.
pub fn all_in_range(key: &str, values: &[f64], min: f64, max: f64, unit: &str) -> Result<(), Refusal> {
    values
        .iter()
        .enumerate()
        .try_for_each(|(i, &value)| in_range(&format!("{key}[{i}]"), value, min, max, unit))
}
