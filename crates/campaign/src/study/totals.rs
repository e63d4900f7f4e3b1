//! Totals of a campaign: sums over records in the order of the flights, in memory that does not grow with their number.
//!
//! All quantities are integers or histograms over steps, so totals do not depend on how the records were produced. Delays are
//! histograms over steps of 2.5 ms: quantiles are exact.

use super::cell::Cell;
use super::intervals::ClusterSums;
use super::own::OwnScores;
use super::plan::{Axis, Campaign};
use super::record::{DETECTORS, FlightRecord, FlightStatus, LossAtEnd};
use super::score::{DetectorScore, SEVERITY_BINS, Verdict, severity_bin};
use rotortwin_flight_core::fdi::verdict_code::NOT_READY;
use rotortwin_plant::STEP_S;
use std::collections::BTreeMap;
use xxhash_rust::xxh3::Xxh3;

/// Maximum number of distinct values of an axis; more are binned (numbers) or omitted (texts).
const MAX_GROUPS: usize = 24;
/// Number of bins of a numeric axis.
const BINS: usize = 6;
/// Number of flights listed as worst, and as failed.
pub const LISTED: usize = 15;

/// Histogram over numbers of steps.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Delays {
    counts: BTreeMap<u64, u64>,
    total: u64,
}

impl Delays {
    fn add(&mut self, steps: Option<u64>) {
        if let Some(steps) = steps {
            *self.counts.entry(steps).or_default() += 1;
            self.total += 1;
        }
    }

    /// Number of delays.
    pub fn total(&self) -> u64 {
        self.total
    }

    /// Nearest-rank quantile, s; `None` if empty.
    pub fn quantile_s(&self, q: f64) -> Option<f64> {
        let rank = ((q * self.total as f64).ceil() as u64).clamp(1, self.total.max(1));
        let mut seen = 0;
        for (steps, count) in &self.counts {
            seen += count;
            if seen >= rank {
                return Some(*steps as f64 * STEP_S);
            }
        }
        None
    }

    /// Number of delays of at most `seconds`.
    pub fn within(&self, seconds: f64) -> u64 {
        let limit = (seconds / STEP_S + 1e-9) as u64;
        self.counts.range(..=limit).map(|(_, count)| count).sum()
    }

    /// Delay in s and the cumulative count, in order.
    pub fn cumulative(&self) -> impl Iterator<Item = (f64, u64)> + '_ {
        self.counts.iter().scan(0, |seen, (steps, count)| {
            *seen += count;
            Some((*steps as f64 * STEP_S, *seen))
        })
    }
}

/// One detector over any set of flights.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DetectorTotals {
    /// Correct windows of all, flight by flight.
    pub windows: ClusterSums,
    /// Correct windows of the fault-free ones.
    pub healthy: ClusterSums,
    /// Correct windows of the faulty ones.
    pub faulty: ClusterSums,
    /// Truth, verdict, windows.
    pub confusion: BTreeMap<(i32, i32), u64>,
    /// Faulty windows with the verdict healthy.
    pub missed: u64,
    /// Faulty windows that name a healthy rotor.
    pub wrong_rotor: u64,
    /// Faulty windows neither correct nor missed, naming no healthy rotor.
    pub unclear: u64,
    /// False alarm events.
    pub false_alarm_events: u64,
    /// Flights with a false alarm.
    pub false_alarm_flights: u64,
    /// Fault-free time in which it was ready, steps.
    pub healthy_steps: u64,
    /// Flights with a fault in which it was ready.
    pub fault_flights: u64,
    /// Delay from the onset to the first verdict other than healthy.
    pub detected: Delays,
    /// Delay to the first correct verdict.
    pub isolated: Delays,
    /// Delay to the first of the correct verdicts that last to the end.
    pub settled: Delays,
    /// Flights with any verdict after the onset that named a healthy rotor.
    pub wrong_rotor_flights: u64,
    /// Faulty windows by their loss.
    pub by_severity: BTreeMap<usize, ClusterSums>,
    /// Flights and isolation delays by the loss of the first fault.
    pub delay_by_severity: BTreeMap<usize, (u64, Delays)>,
}

impl DetectorTotals {
    fn add(&mut self, record: &FlightRecord, score: &DetectorScore) {
        if !score.is_ready() {
            return;
        }
        self.windows.add(score.right, score.windows);
        let healthy_right = score
            .confusion
            .iter()
            .find(|entry| entry.0 == 0 && entry.1 == 0)
            .map_or(0, |entry| entry.2);
        self.healthy.add(healthy_right, score.healthy_windows);
        self.faulty
            .add(score.right - healthy_right, score.windows - score.healthy_windows);
        for (truth, verdict, count) in &score.confusion {
            *self.confusion.entry((*truth, *verdict)).or_default() += count;
        }
        self.missed += score.missed;
        self.wrong_rotor += score.wrong_rotor;
        self.unclear += score.unclear;
        self.false_alarm_events += score.false_alarm_events;
        self.false_alarm_flights += u64::from(score.false_alarm_events > 0);
        self.healthy_steps += score.healthy_windows * score.window_steps;
        for (bin, windows, right) in &score.by_severity {
            self.by_severity.entry(*bin).or_default().add(*right, *windows);
        }
        if let Some(loss) = record.onset_loss_share {
            self.fault_flights += 1;
            self.wrong_rotor_flights += u64::from(score.wrong_rotor > 0);
            self.detected.add(score.detected_after_steps);
            self.isolated.add(score.isolated_after_steps);
            self.settled.add(score.settled_after_steps);
            let (flights, delays) = self.delay_by_severity.entry(severity_bin(loss)).or_default();
            *flights += 1;
            delays.add(score.isolated_after_steps);
        }
    }

    /// Fault-free time in which it was ready, h.
    pub fn healthy_h(&self) -> f64 {
        self.healthy_steps as f64 * STEP_S / 3600.0
    }

    /// False alarms per fault-free hour.
    pub fn false_alarms_per_h(&self) -> Option<f64> {
        (self.healthy_steps > 0).then(|| self.false_alarm_events as f64 / self.healthy_h())
    }
}

/// Sums of an integer and its square, in units of 0.1 mN.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LossError {
    count: u64,
    sum: i64,
    squares: u128,
    /// Flights whose interval contains the truth.
    covered: u64,
}

impl LossError {
    fn add(&mut self, error_n: f64, covered: bool) {
        self.covered += u64::from(covered);
        let units = libm::round(error_n * 1e4) as i64;
        self.count += 1;
        self.sum += units;
        self.squares += u128::from(units.unsigned_abs()) * u128::from(units.unsigned_abs());
    }

    /// Adds a flight at whose end a detector names the faulty rotors, no other, and a size.
    fn add_if_right(&mut self, record: &FlightRecord, score: Option<&DetectorScore>, loss: Option<LossAtEnd>) {
        let verdict = score.map_or(NOT_READY, |score| score.final_verdict);
        let right = verdict > 0 && Verdict::of_code(verdict).named_rotors() == record.faulty_rotors;
        if let (Some(loss), Some(truth), true) = (loss, record.true_thrust_loss_n, right) {
            let [low, high] = loss.interval_n;
            self.add(loss.loss_n - truth, low <= truth && truth <= high);
        }
    }

    /// Flights whose 95 % interval contains the truth.
    pub fn covered(&self) -> u64 {
        self.covered
    }

    /// Flights, mean error and root mean square error, N.
    pub fn summary(&self) -> Option<(u64, f64, f64)> {
        (self.count > 0).then(|| {
            let n = self.count as f64;
            (
                self.count,
                1e-4 * self.sum as f64 / n,
                1e-4 * (self.squares as f64 / n).sqrt(),
            )
        })
    }
}

/// How the values of an axis are grouped.
#[derive(Clone, Debug, PartialEq)]
enum Grouping {
    /// By the value itself, until there are too many.
    Values,
    /// By equal parts of a range, optionally of its logarithm.
    Bins { range: [f64; 2], logarithmic: bool },
}

/// Flights by the value of one axis.
#[derive(Clone, Debug, PartialEq)]
pub struct AxisTotals {
    /// Name of the axis.
    pub axis: String,
    grouping: Grouping,
    /// Too many distinct values.
    pub overflown: bool,
    /// In the order of appearance, or of the bins.
    pub groups: Vec<GroupTotals>,
}

/// Flights with one value of one axis.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GroupTotals {
    /// The value, or the ends of the bin.
    pub name: String,
    /// Number of flights.
    pub flights: u64,
    /// Flights that did not reach their end.
    pub failed: u64,
    /// In the order of [`DETECTORS`].
    pub detectors: [DetectorTotals; DETECTORS.len()],
    /// In the order of [`Totals::own`].
    pub own: Vec<DetectorTotals>,
}

impl AxisTotals {
    fn new(axis: &Axis) -> Self {
        let grouping = match axis.drawn_range() {
            Some((range, logarithmic)) if range[0] < range[1] => Grouping::Bins { range, logarithmic },
            _ => Grouping::Values,
        };
        let groups = match &grouping {
            Grouping::Values => Vec::new(),
            Grouping::Bins { range, logarithmic } => (0..BINS)
                .map(|bin| {
                    let edge = |i: usize| bin_edge(*range, *logarithmic, i);
                    GroupTotals {
                        name: format!("{} – {}", short(edge(bin)), short(edge(bin + 1))),
                        ..GroupTotals::default()
                    }
                })
                .collect(),
        };
        Self {
            axis: axis.name.clone(),
            grouping,
            overflown: false,
            groups,
        }
    }

    fn add(&mut self, cell: &Cell, record: &FlightRecord, own: &[OwnScores]) {
        let place = match &self.grouping {
            Grouping::Bins { range, logarithmic } => {
                let x = cell.number().unwrap_or(range[0]);
                (1..BINS)
                    .take_while(|i| x >= bin_edge(*range, *logarithmic, *i))
                    .count()
            }
            Grouping::Values => {
                let name = cell.to_string();
                match self.groups.iter().position(|group| group.name == name) {
                    Some(place) => place,
                    None if self.groups.len() >= MAX_GROUPS => {
                        self.overflown = true;
                        return;
                    }
                    None => {
                        self.groups.push(GroupTotals {
                            name,
                            ..GroupTotals::default()
                        });
                        self.groups.len() - 1
                    }
                }
            }
        };
        let group = &mut self.groups[place];
        group.flights += 1;
        group.failed += u64::from(record.status != FlightStatus::Done);
        for (totals, score) in group.detectors.iter_mut().zip(&record.detectors) {
            totals.add(record, score);
        }
        group.own.resize_with(own.len(), DetectorTotals::default);
        for (totals, scores) in group.own.iter_mut().zip(own) {
            if let Some(score) = scores.of(record) {
                totals.add(record, score);
            }
        }
    }
}

fn bin_edge(range: [f64; 2], logarithmic: bool, i: usize) -> f64 {
    let part = i as f64 / BINS as f64;
    if logarithmic {
        let (a, b) = (libm::log(range[0]), libm::log(range[1]));
        libm::exp(a + (b - a) * part)
    } else {
        range[0] + (range[1] - range[0]) * part
    }
}

/// Rounds to three significant digits.
fn short(x: f64) -> String {
    if x == 0.0 {
        return "0".to_owned();
    }
    let decimals = (2 - libm::floor(libm::log10(x.abs())) as i32).clamp(0, 9);
    let text = format!("{x:.*}", usize::try_from(decimals).unwrap_or(0));
    if text.contains('.') {
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    } else {
        text
    }
}

/// A flight worth looking at.
#[derive(Clone, Debug, PartialEq)]
pub struct Listed {
    /// Number of the flight.
    pub flight: u64,
    /// Axis and value.
    pub parameters: Vec<(String, Cell)>,
    /// Why it did not reach its end; empty if it did.
    pub reason: String,
    /// Score of the sequential detector.
    pub score: DetectorScore,
    /// Whether it has a fault.
    pub faulty: bool,
}

impl Listed {
    fn of(record: &FlightRecord) -> Self {
        Self {
            flight: record.flight,
            parameters: record.parameters.clone(),
            reason: record.reason.clone(),
            score: record.detectors.first().cloned().unwrap_or_default(),
            faulty: record.onset_loss_share.is_some(),
        }
    }

    /// Larger is worse: false alarms first, then faults that were never isolated, then incorrect windows.
    fn badness(&self) -> (u64, bool, u64) {
        let score = &self.score;
        let never = self.faulty && score.is_ready() && score.isolated_after_steps.is_none();
        (score.false_alarm_events, never, score.windows - score.right)
    }
}

/// A detector of the user's own.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OwnTotals {
    /// Its name in tables.
    pub name: String,
    /// The same as the beginning of its columns: `own_…`.
    pub column: String,
    /// Flights that it has not judged, although they were flown.
    pub not_judged: u64,
    /// Over those that it has.
    pub totals: DetectorTotals,
    /// Estimated minus true loss of thrust at the end, where it names the correct rotor and a size.
    pub loss_error: LossError,
}

/// Totals of a campaign.
#[derive(Clone)]
pub struct Totals {
    /// Number of flights.
    pub flights: u64,
    /// Flown to their end.
    pub done: u64,
    /// Ended early.
    pub failed: u64,
    /// Not flown.
    pub refused: u64,
    /// Steps flown.
    pub steps: u64,
    /// Largest rotor count of a vehicle.
    pub rotor_count: u32,
    /// In the order of [`DETECTORS`].
    pub detectors: [DetectorTotals; DETECTORS.len()],
    /// Detectors of the user's own.
    pub own: Vec<OwnTotals>,
    /// Evidence, nats, and the sequential detector's results with it.
    pub curve: Vec<(f32, DetectorTotals)>,
    /// Axis by axis.
    pub axes: Vec<AxisTotals>,
    /// Estimated minus true loss of thrust at the end, where the correct rotor is named.
    pub loss_error: LossError,
    /// The worst flights, worst first.
    pub worst: Vec<Listed>,
    /// The first that did not reach their end.
    pub unfinished: Vec<Listed>,
    hash: Xxh3,
}

impl Totals {
    /// Empty totals.
    pub fn new(campaign: &Campaign) -> Self {
        Self::with_own(campaign, &[])
    }

    /// The same, with detectors of the user's own.
    pub fn with_own(campaign: &Campaign, own: &[OwnScores]) -> Self {
        let own = own.iter().map(|scores| OwnTotals {
            name: scores.name.clone(),
            column: scores.column(),
            ..OwnTotals::default()
        });
        Self {
            flights: 0,
            done: 0,
            failed: 0,
            refused: 0,
            steps: 0,
            rotor_count: 0,
            detectors: Default::default(),
            own: own.collect(),
            curve: campaign
                .levels()
                .iter()
                .map(|level| (*level, DetectorTotals::default()))
                .collect(),
            axes: campaign.axes().iter().map(AxisTotals::new).collect(),
            loss_error: LossError::default(),
            worst: Vec::new(),
            unfinished: Vec::new(),
            hash: Xxh3::new(),
        }
    }

    /// Adds the next flight; records must come in the order of their numbers.
    pub fn add(&mut self, record: &FlightRecord) {
        self.add_judged(record, &[]);
    }

    /// The same, with what the detectors of [`Self::with_own`] scored in it.
    pub fn add_judged(&mut self, record: &FlightRecord, own: &[OwnScores]) {
        self.hash.update(record.to_json().as_bytes());
        self.flights += 1;
        match record.status {
            FlightStatus::Done => self.done += 1,
            FlightStatus::Failed => self.failed += 1,
            FlightStatus::Refused => self.refused += 1,
        }
        self.steps += record.steps;
        self.rotor_count = self.rotor_count.max(record.rotor_count);
        for (totals, score) in self.detectors.iter_mut().zip(&record.detectors) {
            totals.add(record, score);
        }
        for ((_, totals), score) in self.curve.iter_mut().zip(&record.curve) {
            totals.add(record, score);
        }
        for (detector, scores) in self.own.iter_mut().zip(own) {
            match scores.of(record) {
                Some(score) => {
                    detector.totals.add(record, score);
                    let loss = scores.loss_of(record);
                    detector.loss_error.add_if_right(record, Some(score), loss);
                }
                None => detector.not_judged += u64::from(record.status != FlightStatus::Refused),
            }
        }
        for (axis, (_, cell)) in self.axes.iter_mut().zip(&record.parameters) {
            axis.add(cell, record, own);
        }
        self.loss_error
            .add_if_right(record, record.detectors.first(), record.loss_at_end());
        let listed = Listed::of(record);
        if record.status != FlightStatus::Done {
            if self.unfinished.len() < LISTED {
                self.unfinished.push(listed);
            }
        } else if listed.badness() > (0, false, 0) {
            let place = self.worst.partition_point(|other| other.badness() >= listed.badness());
            if place < LISTED {
                self.worst.insert(place, listed);
                self.worst.truncate(LISTED);
            }
        }
    }

    /// Hash over all records in order: the same flights give the same hash, however they were flown.
    pub fn hash(&self) -> String {
        format!("{:032x}", self.hash.digest128())
    }

    /// Time flown, h.
    pub fn flown_h(&self) -> f64 {
        self.steps as f64 * STEP_S / 3600.0
    }

    /// Progress for a number of planned flights, in one line.
    pub fn in_words(&self, flights: u64) -> String {
        format!(
            "{} of {flights} flights, {:.2} h flown; {} failed, {} could not be flown; hash {}",
            self.flights,
            self.flown_h(),
            self.failed,
            self.refused,
            self.hash()
        )
    }

    /// Severity bins in which there is a window or an onset, for one detector.
    pub fn severities(&self) -> Vec<usize> {
        (0..SEVERITY_BINS.len())
            .filter(|bin| {
                self.detectors
                    .iter()
                    .any(|d| d.by_severity.contains_key(bin) || d.delay_by_severity.contains_key(bin))
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_quantiles_of_delays_are_nearest_rank() {
        let mut delays = Delays::default();
        (1..=100).for_each(|steps| delays.add(Some(steps)));
        delays.add(None);
        assert_eq!(delays.total(), 100);
        assert_eq!(delays.quantile_s(0.5), Some(50.0 * STEP_S));
        assert_eq!(delays.quantile_s(1.0), Some(100.0 * STEP_S));
        assert_eq!(delays.quantile_s(0.0), Some(STEP_S));
        assert_eq!(
            (delays.within(0.025), delays.within(0.0), delays.within(9.0)),
            (10, 0, 100)
        );
        assert_eq!(Delays::default().quantile_s(0.5), None);
    }

    #[test]
    fn val_bins_cover_their_range() {
        assert_eq!(bin_edge([1.0, 64.0], true, 0), 1.0);
        assert!((bin_edge([1.0, 64.0], true, 1) - 2.0).abs() < 1e-12);
        assert!((bin_edge([1.0, 64.0], true, BINS) - 64.0).abs() < 1e-9);
        assert_eq!(bin_edge([0.0, 6.0], false, 5), 5.0);
        assert_eq!(
            (short(0.012345), short(1234.0), short(2.0), short(0.0)),
            ("0.0123".into(), "1234".into(), "2".into(), "0".into())
        );
    }

    #[test]
    fn val_loss_errors() {
        let mut errors = LossError::default();
        assert_eq!(errors.summary(), None);
        errors.add(0.01, true);
        errors.add(-0.02, false);
        assert_eq!(errors.covered(), 1);
        let (count, mean, rms) = errors.summary().expect("two");
        assert!(count == 2 && (mean + 0.005).abs() < 1e-12 && (rms - 0.015_811_4).abs() < 1e-6);
    }
}
