//! A part of a log: some seconds, or a named segment.
//!
//! Written `LOG@35:65` (seconds of the log's own time) or `LOG@climb` (a segment of its side file), so that the good
//! part of a flight with a launch by hand or a crash can be used. `LOG@order:2-5-6-3-1-4` reads the columns of its
//! rotors in another order: rotor 1 of the vehicle file is `duty_2`. Both kinds can be combined: `LOG@35:65@order:…`.
//! Errors state the log's own clock as well as ours, where it has one.

use std::path::Path;

use super::{FlightLog, ReadOptions, checks, rotor_order};
use crate::model::content_hash;

impl FlightLog {
    /// Reads `LOG`, `LOG@FROM:TO`, `LOG@SEGMENT` or `LOG@order:N-N-…`.
    ///
    /// # Errors
    /// The log is refused, or it has no such part: one sentence.
    pub fn read_part(text: &Path) -> Result<Self, String> {
        Self::read_part_with(text, &ReadOptions::default())
    }

    /// As [`FlightLog::read_part`], with options.
    ///
    /// # Errors
    /// The log is refused, or it has no such part: one sentence.
    pub fn read_part_with(text: &Path, options: &ReadOptions) -> Result<Self, String> {
        let whole = |path: &Path| Self::read_with(path, options).map_err(|error| error.to_string());
        let Some((path, part)) = text
            .to_str()
            .and_then(|text| text.rsplit_once('@'))
            .filter(|_| !text.exists())
        else {
            return whole(text);
        };
        // Several parts one after the other: `LOG@35:65@order:2-5-6-3-1-4`.
        let log = Self::read_part_with(Path::new(path), options)?;
        if let Some(list) = part.strip_prefix(rotor_order::PREFIX) {
            return log.in_stated_order(list);
        }
        if let Some(segment) = log.segments.iter().find(|segment| segment.name == part) {
            let (start_s, end_s) = (segment.start_s, segment.end_s);
            return log.part(start_s, end_s);
        }
        let bounds = part
            .split_once(':')
            .and_then(|(from, to)| Some((from.trim().parse().ok()?, to.trim().parse().ok()?)));
        let Some((start_s, end_s)) = bounds else {
            let names: Vec<&str> = log.segments.iter().map(|segment| segment.name.as_str()).collect();
            let known = if names.is_empty() {
                "this log has none".to_owned()
            } else {
                format!("its segments: {}", names.join(", "))
            };
            return Err(format!(
                "{}: expected FROM:TO in seconds or a segment after `@`, got `{part}`; {known}",
                text.display()
            ));
        };
        log.part(start_s, end_s)
    }

    /// The rows from `start_s` to `end_s`, s of the log's time, examined anew.
    ///
    /// # Errors
    /// Fewer than two rows are in it: one sentence.
    pub fn part(&self, start_s: f64, end_s: f64) -> Result<Self, String> {
        let first = self.time_s.partition_point(|t| *t < start_s);
        let last = self.time_s.partition_point(|t| *t <= end_s);
        if last < first + 2 {
            let (from, to) = (self.time_s[0], self.time_s[self.time_s.len() - 1]);
            let own = self.report.clock_start_s.map_or_else(String::new, |clock| {
                format!(
                    "; the log's own clock, {:.3} to {:.3} s, is ours plus {clock:.3} s",
                    clock + from,
                    clock + to
                )
            });
            return Err(format!(
                "{}: expected a part within its {from:.3} to {to:.3} s, got {start_s} to {end_s} s{own}",
                self.name,
            ));
        }
        let mut part = self.clone();
        part.time_s = self.time_s[first..last].to_vec();
        for values in part.columns.values_mut() {
            *values = values[first..last].to_vec();
        }
        part.name = format!("{} {start_s}–{end_s} s", self.name);
        part.source.content_hash = content_hash(format!("{}@{start_s}:{end_s}", self.source.content_hash).as_bytes());
        part.report.rows = last - first;
        checks::examine(&mut part);
        Ok(part)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ten_seconds() -> FlightLog {
        let time: Vec<f64> = (0..=100).map(|k| 0.1 * f64::from(k)).collect();
        let columns = [(
            "battery_voltage_v".to_owned(),
            time.iter().map(|t| 16.0 - 0.1 * t).collect(),
        )];
        FlightLog::from_columns("ten", time, columns).expect("a log")
    }

    #[test]
    fn val_a_part_has_the_rows_between_its_bounds_and_a_hash_of_its_own() {
        let whole = ten_seconds();
        let part = whole.part(2.0, 4.0).expect("inside");
        assert_eq!((part.time_s[0], part.time_s.len()), (whole.time_s[20], 21));
        assert_eq!(
            part.columns["battery_voltage_v"][0],
            whole.columns["battery_voltage_v"][20]
        );
        assert_ne!(part.source.content_hash, whole.source.content_hash);
        let refused = whole.part(20.0, 30.0).expect_err("outside");
        assert!(refused.contains("0.000 to 10.000 s, got 20 to 30 s"), "{refused}");
    }
}
