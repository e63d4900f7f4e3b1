//! Accuracy of the detectors on logs with known truth, by the definitions of campaigns ([`rotortwin_campaign::study::score`]).
//!
//! The truth of a window is that at its middle. *Judged*: the share of all windows of a log that have a verdict; *correct* counts only those, so both belong
//! together: a detector that judges little can be correct in all of it. *Inside*: of the windows in which the
//! sequential detector names the correct rotors while the loss is constant and of known size, those in which every loss is inside its 95 %
//! interval.

use super::truth::Truth;
use rotortwin_campaign::study::log_score::{LogScore, NamedScore};
use rotortwin_campaign::study::score::{DetectorScorer, Verdict, WindowTruth};
use rotortwin_fdi_session::validity::CANNOT_JUDGE;
use rotortwin_plant::STEP_S;
use rotortwin_verdicts::log::{LogReport, NETWORK_OVER_TIME};
use rotortwin_verdicts::view::WindowView;

/// Detectors, in the order of a report.
pub const DETECTORS: [&str; 4] = ["t_test", "network", "sequential", NETWORK_OVER_TIME];
/// Place of the sequential detector.
pub const SEQUENTIAL: usize = 2;

/// From a report with all its windows.
pub(super) fn score_of(report: &LogReport, truth: &Truth) -> LogScore {
    let window_s = f64::from(report.detectors.window_samples) / report.judged_rate_hz;
    let window_steps = (window_s / STEP_S).round() as u64;
    let mut scorers = DETECTORS.map(|_| DetectorScorer::new(window_steps));
    let (mut inside, mut inside_of) = (0, 0);
    let mut sizes_are_known = true;
    for window in &report.windows {
        let end_s = report.log.start_s + window.time_s + 1.0 / report.judged_rate_hz;
        let begin_s = end_s - window_s;
        let damage = truth.at(end_s - 0.5 * window_s);
        sizes_are_known &= damage.worst().is_finite();
        let known = WindowTruth {
            label: damage.label(),
            faulty_rotors: damage.rotors,
            touched: truth.touches(begin_s, end_s),
            loss_share: Some(damage.worst()).filter(|share| share.is_finite()).unwrap_or(0.0),
            after_onset_steps: truth.onset_s().and_then(|onset_s| after_onset_steps(onset_s, end_s)),
        };
        for (scorer, verdict) in scorers.iter_mut().zip(verdicts(window)) {
            if verdict.code != CANNOT_JUDGE {
                scorer.window(&known, verdict);
            }
        }
        let rightly = !window.sequential.thrust_loss.is_empty() && known.is_right(verdicts(window)[SEQUENTIAL]);
        if rightly && truth.stands_still(begin_s, end_s) && damage.worst().is_finite() {
            inside_of += 1;
            inside += u64::from(window.sequential.thrust_loss.iter().all(|loss| {
                let share = damage.loss[loss.rotor as usize - 1];
                (f64::from(loss.share_low)..=f64::from(loss.share_high)).contains(&share)
            }));
        }
    }
    let named: Vec<NamedScore> = DETECTORS
        .into_iter()
        .zip(scorers)
        .map(|(detector, scorer)| {
            let mut score = scorer.finish();
            if !sizes_are_known {
                score.by_severity.clear();
            }
            NamedScore {
                detector: detector.to_owned(),
                score,
            }
        })
        .collect();
    LogScore {
        onset_s: truth.onset_s(),
        windows: windows_in(report, window_s).max(judged_by_most(&named)),
        detectors: named,
        inside,
        inside_of,
    }
}

/// Whole windows between the first row of a log and the end of its last one, whose row is one more step.
fn windows_in(report: &LogReport, window_s: f64) -> u64 {
    ((report.log.duration_s + 1.0 / report.judged_rate_hz) / window_s + 1e-6).floor() as u64
}

/// Windows of the detector that judged most of them: where several stretches begin within a window, there are more than fit side by side.
fn judged_by_most(scores: &[NamedScore]) -> u64 {
    scores.iter().map(|named| named.score.windows).max().unwrap_or(0)
}

/// Steps from the onset to the end of a window; `None` if no step of the window is after it: an alarm in such a window
/// is not caused by the damage, and is not a detection after 0 s.
fn after_onset_steps(onset_s: f64, end_s: f64) -> Option<u64> {
    let steps = ((end_s - onset_s) / STEP_S).round();
    (steps >= 1.0).then_some(steps as u64)
}

fn verdicts(window: &WindowView) -> [Verdict; 4] {
    let suspects = window
        .sequential
        .suspect_rotors
        .iter()
        .fold(0, |mask: u32, rotor| mask | 1 << (rotor - 1));
    [
        Verdict::of_code(window.t_test.code),
        Verdict::of_code(window.network.verdict.code),
        Verdict {
            code: window.sequential.verdict.code,
            suspect_rotors: suspects,
        },
        Verdict::of_code(window.network_over_time.verdict.code),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regress_a_window_that_ends_with_the_onset_has_not_seen_it() {
        // 38 s is the end of a window of 62.5 ms; sums of steps are not exact.
        let window_s = 25.0 * STEP_S;
        let end_s = 0.1 + 0.2 + 37.7;
        assert_eq!(after_onset_steps(38.0, end_s), None);
        assert_eq!(after_onset_steps(38.0, end_s + window_s), Some(25));
        assert_eq!(after_onset_steps(38.0, end_s + STEP_S), Some(1));
        assert_eq!(after_onset_steps(38.0, 20.0), None);
    }
}
