//! Columns of rotors put into another order.

use super::{FlightLog, names};
use crate::content_hash::content_hash;

/// How a part of a log begins that names the order of its rotors.
pub(crate) const PREFIX: &str = "order:";

/// Whose numbers the columns of the rotors have.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum RotorOrder {
    /// The file's: that of the autopilot's motors, or of the author of the columns.
    #[default]
    Logged,
    /// Stated by the user (`LOG@order:…`): the motion is not used.
    Stated,
    /// A vehicle's, by the log's own parameters: what was done, one sentence.
    Vehicle(String),
}

impl FlightLog {
    /// Rotor `r` (from 0) gets the columns that rotor `order[r]` had; `order` holds every rotor once.
    pub(crate) fn reorder_rotors(&mut self, order: &[usize]) {
        for name in [names::duty as fn(usize) -> String, names::rotor_speed] {
            let old: Vec<Option<Vec<f64>>> = (1..=order.len())
                .map(|rotor| self.columns.remove(&name(rotor)))
                .collect();
            for (rotor, from) in order.iter().enumerate() {
                if let Some(values) = &old[*from] {
                    self.columns.insert(name(rotor + 1), values.clone());
                }
            }
            let renamed = |column: &mut String| {
                let place = order.iter().position(|from| name(from + 1) == *column);
                if let Some(rotor) = place {
                    *column = name(rotor + 1);
                }
            };
            self.report
                .noise
                .iter_mut()
                .for_each(|noise| renamed(&mut noise.column));
            self.report
                .missing_cells
                .iter_mut()
                .for_each(|cells| renamed(&mut cells.column));
        }
    }

    /// The log with the order of rotors that the list of a part gives, as `2-5-6-3-1-4`.
    ///
    /// # Errors
    /// It is not an order of this log's rotors: one sentence.
    pub(crate) fn in_stated_order(mut self, list: &str) -> Result<Self, String> {
        let rotors = self.rotor_count();
        let order: Vec<usize> = list.split('-').map(|text| text.trim().parse().unwrap_or(0)).collect();
        let mut sorted = order.clone();
        sorted.sort_unstable();
        if rotors == 0 || !sorted.into_iter().eq(1..=rotors) {
            let own: Vec<usize> = (0..rotors).collect();
            return Err(format!(
                "{}: expected each of the log's {rotors} rotors once, such as `@{}` (the column of rotor 1, of rotor 2, …), got `@{PREFIX}{list}`",
                self.name,
                stated(&own)
            ));
        }
        let order: Vec<usize> = order.into_iter().map(|rotor| rotor - 1).collect();
        self.reorder_rotors(&order);
        self.source.content_hash = content_hash(format!("{}@{PREFIX}{list}", self.source.content_hash).as_bytes());
        self.report.rotor_outputs.clear();
        self.report.rotor_order = RotorOrder::Stated;
        Ok(self)
    }
}

/// `order:2-5-6-3-1-4`, which [`FlightLog::read_part`] takes behind an `@`; rotors from 0.
pub fn stated(order: &[usize]) -> String {
    let numbers: Vec<String> = order.iter().map(|rotor| (rotor + 1).to_string()).collect();
    format!("{PREFIX}{}", numbers.join("-"))
}
