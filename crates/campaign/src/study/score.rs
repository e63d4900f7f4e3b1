//! Score of a detector in one flight: counts over its windows, and its delays.
//!
//! * **Window**: a verdict counts where `window_end` is 1, once the detector is ready. The truth of a window is the median of the fault
//!   labels of its samples, as in the 48-flight protocol: 0 healthy, the rotor from 1, −1 if several rotors are faulty.
//! * **Right**: the verdict equals the truth. With several faulty rotors, as in the summary of a run: "unknown fault", exactly these two
//!   named, or an ambiguous verdict whose suspects include them all.
//! * **Wrong rotor**: a healthy rotor is named, alone or in a pair. *Unclear*: unknown or ambiguous with one faulty rotor, or only some
//!   of several faulty rotors named.
//! * **False alarm**: a verdict other than healthy at the end of a window without any faulty sample. Consecutive windows are one event.
//! * **Delay**: from the first step with a fault to the end of a window. *Detected*: any verdict other than healthy. *Isolated*: the first
//!   correct one. *Settled*: correct from then on to the end of the flight; absent if the last window is not correct.
//!
//! Delays are stored in steps of 2.5 ms: integers, so that totals do not depend on the order of addition.

use rotortwin_flight_core::fdi::verdict_code::{AMBIGUOUS, NOT_READY, UNKNOWN, named_rotors};
use rotortwin_plant::STEP_S;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use utoipa::ToSchema;

/// Upper ends of the severity bins, fraction of the hover thrust lost by the worst rotor. Blades b and d lose 3.1 to 3.7 %, c 7.6 to 8 %.
pub const SEVERITY_BINS: [f64; 11] = [0.005, 0.01, 0.02, 0.03, 0.04, 0.05, 0.075, 0.1, 0.2, 0.5, 1.0];

/// Index of a fraction in [`SEVERITY_BINS`], by its size: a gain counts as a loss of the same size.
pub fn severity_bin(share: f64) -> usize {
    SEVERITY_BINS
        .iter()
        .position(|upper| share.abs() <= *upper)
        .unwrap_or(SEVERITY_BINS.len() - 1)
}

/// Lower and upper end of a bin in percent, as text.
pub fn severity_name(bin: usize) -> String {
    let lower = if bin == 0 { 0.0 } else { SEVERITY_BINS[bin - 1] };
    format!("{} – {} %", 100.0 * lower, 100.0 * SEVERITY_BINS[bin])
}

/// Counts of one detector over one flight.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[schema(as = DetectorCounts)]
pub struct DetectorScore {
    /// Steps per window.
    pub window_steps: u64,
    /// Windows with a verdict.
    pub windows: u64,
    /// Correct windows.
    pub right: u64,
    /// Faulty windows with the verdict healthy.
    pub missed: u64,
    /// Faulty windows that name a healthy rotor.
    pub wrong_rotor: u64,
    /// Faulty windows that are neither correct nor missed, and name no healthy rotor.
    pub unclear: u64,
    /// Windows without a fault.
    pub healthy_windows: u64,
    /// Of these, with a verdict other than healthy.
    pub false_alarm_windows: u64,
    /// Uninterrupted sequences of such windows.
    pub false_alarm_events: u64,
    /// Steps from the onset to the end of the first window with any verdict other than healthy.
    pub detected_after_steps: Option<u64>,
    /// To the end of the first correct window.
    pub isolated_after_steps: Option<u64>,
    /// To the end of the window from which on all are correct.
    pub settled_after_steps: Option<u64>,
    /// Verdict of the last window; −2 if the detector was never ready.
    pub final_verdict: i32,
    /// Truth, verdict, windows.
    pub confusion: Vec<(i32, i32, u64)>,
    /// Bin of severity, faulty windows, number of these that are correct.
    pub by_severity: Vec<(usize, u64, u64)>,
}

impl DetectorScore {
    /// Fault-free time in which the detector was ready, s.
    pub fn healthy_s(&self) -> f64 {
        (self.healthy_windows * self.window_steps) as f64 * STEP_S
    }

    /// See the module documentation, s.
    pub fn detected_after_s(&self) -> Option<f64> {
        self.detected_after_steps.map(|steps| steps as f64 * STEP_S)
    }

    /// See the module documentation, s.
    pub fn isolated_after_s(&self) -> Option<f64> {
        self.isolated_after_steps.map(|steps| steps as f64 * STEP_S)
    }

    /// See the module documentation, s.
    pub fn settled_after_s(&self) -> Option<f64> {
        self.settled_after_steps.map(|steps| steps as f64 * STEP_S)
    }

    /// True if it ever gave a verdict.
    pub fn is_ready(&self) -> bool {
        self.windows > 0
    }
}

/// The truth of one window.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct WindowTruth {
    /// 0 healthy, rotor from 1, −1 several.
    pub label: i32,
    /// Rotors that are faulty in most of the window: bit 0 is rotor 1.
    pub faulty_rotors: u32,
    /// Whether any of its samples is faulty.
    pub touched: bool,
    /// Fraction of its hover thrust that the worst rotor has lost at the end.
    pub loss_share: f64,
    /// Steps from the first onset to the end of the window, if there was one.
    pub after_onset_steps: Option<u64>,
}

/// A detector's verdict.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Verdict {
    /// −3 ambiguous, −2 not ready, −1 unknown, 0 healthy, i rotor i, 100 i + j rotors i and j.
    pub code: i32,
    /// Rotors that are or may be faulty: bit 0 is rotor 1.
    pub suspect_rotors: u32,
}

impl Verdict {
    /// Verdict of a detector that only provides codes.
    pub fn of_code(code: i32) -> Self {
        Self {
            code,
            suspect_rotors: 0,
        }
    }

    /// Rotors that it names: bit 0 is rotor 1.
    pub fn named_rotors(&self) -> u32 {
        named_rotors(self.code)
            .filter(|rotor| *rotor <= u32::BITS)
            .fold(0, |mask, rotor| mask | 1 << (rotor - 1))
    }
}

impl WindowTruth {
    /// Whether a verdict is correct.
    pub fn is_right(&self, verdict: Verdict) -> bool {
        match (self.label, verdict.code) {
            (label, code) if label == code => true,
            (UNKNOWN, AMBIGUOUS) => self.faulty_rotors & !verdict.suspect_rotors == 0,
            (UNKNOWN, _) => verdict.named_rotors() == self.faulty_rotors,
            _ => false,
        }
    }
}

/// Accumulates counts at window ends.
#[derive(Clone, Debug, Default)]
pub struct DetectorScorer {
    score: DetectorScore,
    confusion: BTreeMap<(i32, i32), u64>,
    by_severity: BTreeMap<usize, (u64, u64)>,
    in_alarm: bool,
}

impl DetectorScorer {
    /// For windows of `window_steps` steps.
    pub fn new(window_steps: u64) -> Self {
        let mut scorer = Self::default();
        scorer.score.window_steps = window_steps;
        scorer.score.final_verdict = NOT_READY;
        scorer
    }

    /// One window.
    pub fn window(&mut self, truth: &WindowTruth, said: Verdict) {
        let verdict = said.code;
        if verdict == NOT_READY {
            return;
        }
        let score = &mut self.score;
        score.windows += 1;
        score.final_verdict = verdict;
        *self.confusion.entry((truth.label, verdict)).or_default() += 1;
        let right = truth.is_right(said);
        score.right += u64::from(right);
        if truth.label == 0 {
            score.healthy_windows += 1;
            let alarm = verdict != 0 && !truth.touched;
            score.false_alarm_windows += u64::from(alarm);
            score.false_alarm_events += u64::from(alarm && !self.in_alarm);
            self.in_alarm = alarm;
        } else {
            match verdict {
                0 => score.missed += 1,
                _ if right => {}
                _ if said.named_rotors() & !truth.faulty_rotors != 0 => score.wrong_rotor += 1,
                _ => score.unclear += 1,
            }
            let bin = self.by_severity.entry(severity_bin(truth.loss_share)).or_default();
            bin.0 += 1;
            bin.1 += u64::from(right);
        }
        let Some(after) = truth.after_onset_steps else { return };
        if verdict != 0 && score.detected_after_steps.is_none() {
            score.detected_after_steps = Some(after);
        }
        if right && truth.label != 0 && score.isolated_after_steps.is_none() {
            score.isolated_after_steps = Some(after);
        }
        score.settled_after_steps = if right && truth.label != 0 {
            score.settled_after_steps.or(Some(after))
        } else if right {
            score.settled_after_steps
        } else {
            None
        };
    }

    /// The counts.
    pub fn finish(self) -> DetectorScore {
        let mut score = self.score;
        score.confusion = self
            .confusion
            .into_iter()
            .map(|((truth, verdict), count)| (truth, verdict, count))
            .collect();
        score.by_severity = self
            .by_severity
            .into_iter()
            .map(|(bin, (windows, right))| (bin, windows, right))
            .collect();
        score
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn healthy() -> WindowTruth {
        WindowTruth::default()
    }

    fn faulty(rotor: i32, after: u64) -> WindowTruth {
        WindowTruth {
            label: rotor,
            faulty_rotors: 1 << (rotor - 1),
            touched: true,
            loss_share: 0.035,
            after_onset_steps: Some(after),
        }
    }

    #[test]
    fn val_counts_and_delays_of_a_hand_made_flight() {
        let mut scorer = DetectorScorer::new(25);
        scorer.window(&healthy(), Verdict::of_code(NOT_READY));
        // Two events of false alarm, three windows.
        for verdict in [0, 2, 5, 0, UNKNOWN, 0] {
            scorer.window(&healthy(), Verdict::of_code(verdict));
        }
        // Missed, unknown, right, wrong, right, right.
        for (i, verdict) in [0, UNKNOWN, 3, 4, 3, 3].into_iter().enumerate() {
            scorer.window(&faulty(3, 25 * (i as u64 + 1)), Verdict::of_code(verdict));
        }
        let score = scorer.finish();
        assert_eq!((score.windows, score.right, score.healthy_windows), (12, 6, 6));
        assert_eq!((score.false_alarm_windows, score.false_alarm_events), (3, 2));
        assert_eq!((score.missed, score.unclear, score.wrong_rotor), (1, 1, 1));
        assert_eq!(score.detected_after_steps, Some(50));
        assert_eq!(score.isolated_after_steps, Some(75));
        assert_eq!(score.settled_after_steps, Some(125));
        assert_eq!(score.final_verdict, 3);
        assert_eq!(score.by_severity, [(severity_bin(0.035), 6, 3)]);
        assert_eq!(score.healthy_s(), 6.0 * 0.0625);
        assert_eq!(score.confusion.iter().map(|(_, _, count)| count).sum::<u64>(), 12);
    }

    #[test]
    fn val_two_faulty_rotors_are_unknown_both_or_among_the_suspects() {
        let truth = WindowTruth {
            label: UNKNOWN,
            faulty_rotors: 0b01001,
            touched: true,
            ..WindowTruth::default()
        };
        let ambiguous = |suspect_rotors| Verdict {
            code: AMBIGUOUS,
            suspect_rotors,
        };
        assert!(truth.is_right(Verdict::of_code(UNKNOWN)));
        assert!(truth.is_right(Verdict::of_code(104)));
        assert!(truth.is_right(ambiguous(0b11011)) && !truth.is_right(ambiguous(0b11010)));
        assert!(
            [0, 1, 2, 4, 102]
                .into_iter()
                .all(|code| !truth.is_right(Verdict::of_code(code)))
        );
        let mut scorer = DetectorScorer::new(25);
        // Only one of them; one of them and a healthy one; a healthy one.
        [1, 102, 3]
            .into_iter()
            .for_each(|code| scorer.window(&truth, Verdict::of_code(code)));
        let score = scorer.finish();
        assert_eq!((score.unclear, score.wrong_rotor, score.right), (1, 2, 0));
    }

    #[test]
    fn val_onset_within_a_window_is_no_false_alarm() {
        let mut scorer = DetectorScorer::new(25);
        let straddling = WindowTruth {
            touched: true,
            after_onset_steps: Some(5),
            ..WindowTruth::default()
        };
        scorer.window(&straddling, Verdict::of_code(3));
        let score = scorer.finish();
        assert_eq!((score.false_alarm_events, score.right), (0, 0));
        assert_eq!(score.detected_after_steps, Some(5));
    }

    #[test]
    fn val_bins_of_severity() {
        assert_eq!(severity_bin(0.0), 0);
        assert_eq!(severity_name(severity_bin(0.035)), "3 – 4 %");
        assert_eq!(severity_name(severity_bin(0.078)), "7.5 – 10 %");
        assert_eq!(severity_bin(1.0), SEVERITY_BINS.len() - 1);
    }
}
