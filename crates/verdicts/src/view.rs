//! Detector results as JSON. Codes and names of verdicts: `docs/conventions.md`.

use rotortwin_fdi_session::validity::{CANNOT_JUDGE, Obstacle};
use rotortwin_fdi_session::words::{self, rotors_of};
use rotortwin_fdi_session::{
    Answer, Calibration, Details, Explained, ExplanationKind, Interval, LoadChange, Motion, Window,
};
use rotortwin_flight_core::fdi::FaultVerdict;
use rotortwin_flight_core::fdi::verdict_code::named_rotors;
use rotortwin_scenario::Detectors;
use rotortwin_wire::frames::{FdiReport, LossEstimate, MAX_HYPOTHESES};
use serde::Serialize;
use utoipa::ToSchema;

/// How far the calibration of the detectors has progressed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum CalibrationState {
    /// The sensors' noise is measured; no verdicts.
    Noise,
    /// Levels of gusts and means of residuals are learnt; no verdicts, but of a classifier that calibrates nothing.
    Disturbances,
    /// Verdicts come.
    Done,
}

impl From<Calibration> for CalibrationState {
    fn from(calibration: Calibration) -> Self {
        match calibration {
            Calibration::Noise => Self::Noise,
            Calibration::Disturbances => Self::Disturbances,
            Calibration::Done => Self::Done,
        }
    }
}

/// Kinds of verdicts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum VerdictKind {
    /// Still calibrating, or not there (no classifier).
    NotReady,
    /// No fault.
    Healthy,
    /// One rotor has lost thrust.
    Faulty,
    /// Two rotors have.
    FaultyPair,
    /// Several sets of rotors explain it.
    Ambiguous,
    /// Something is wrong, and it fits no rotor and no pair.
    Unknown,
    /// A verdict would mean nothing here; the reason stands beside it.
    CannotJudge,
}

/// Why there is no verdict.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Obstruction {
    /// On the ground.
    OnGround,
    /// From the first lift to clear of the ground, and two seconds after it.
    TakeOff,
    /// From near the ground to motors off.
    Landing,
    /// Beyond 70° of tilt.
    Upset,
    /// From the loss of attitude to the end of the flight.
    Crash,
    /// The log has no rows, or not every value that the detectors need.
    Gap,
    /// The detectors calibrate themselves.
    Calibration,
    /// No loss of one or two rotors explains the motion.
    Unexplained,
    /// The vertical force alone has changed, as a load does that was dropped or taken up.
    LoadChanged,
    /// No loss of one to three rotors explains what was found, or too many do.
    Unclear,
    /// The loss that would explain the motion is more than all of a rotor's thrust.
    ImpossibleLoss,
}

/// Why there is no verdict, in words and as a code.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, ToSchema)]
pub struct ObstacleView {
    /// Reason code.
    pub reason: Obstruction,
    /// One clause with figures.
    pub why: String,
}

impl From<&Obstacle> for ObstacleView {
    fn from(obstacle: &Obstacle) -> Self {
        let reason = match obstacle {
            Obstacle::Ground { .. } => Obstruction::OnGround,
            Obstacle::TakeOff => Obstruction::TakeOff,
            Obstacle::Upset { .. } => Obstruction::Upset,
            Obstacle::Unexplained { .. } => Obstruction::Unexplained,
            Obstacle::Load { .. } => Obstruction::LoadChanged,
            Obstacle::Unclear => Obstruction::Unclear,
            Obstacle::ImpossibleLoss { .. } => Obstruction::ImpossibleLoss,
        };
        Self {
            reason,
            why: obstacle.to_string(),
        }
    }
}

/// A verdict.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, ToSchema)]
pub struct VerdictView {
    /// In words.
    pub verdict: VerdictKind,
    /// −4 cannot judge, −3 ambiguous, −2 not ready, −1 unknown fault, 0 healthy, i rotor i, 100 i + j rotors i and j.
    pub code: i32,
    /// Rotors that it names, from 1.
    pub rotors: Vec<u32>,
}

impl VerdictView {
    /// From a verdict code.
    pub fn of(code: i32) -> Self {
        let verdict = match FaultVerdict::of_code(code) {
            Some(FaultVerdict::Healthy) => VerdictKind::Healthy,
            Some(FaultVerdict::Unknown) => VerdictKind::Unknown,
            Some(FaultVerdict::Ambiguous) => VerdictKind::Ambiguous,
            Some(FaultVerdict::Faulty { .. }) => VerdictKind::Faulty,
            Some(FaultVerdict::FaultyPair { .. }) => VerdictKind::FaultyPair,
            None if code == CANNOT_JUDGE => VerdictKind::CannotJudge,
            Some(FaultVerdict::NotReady) | None => VerdictKind::NotReady,
        };
        Self {
            verdict,
            code,
            rotors: named_rotors(code).collect(),
        }
    }
}

/// The network's verdict.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct NetworkView {
    /// Verdict.
    #[serde(flatten)]
    pub verdict: VerdictView,
    /// Probabilities of healthy, rotor 1, rotor 2, …; empty while there is no verdict.
    pub class_probability: Vec<f32>,
}

/// Verdict of the network over time.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct NetworkOverTimeView {
    /// Verdict: healthy or one rotor.
    #[serde(flatten)]
    pub verdict: VerdictView,
    /// Probabilities of healthy, rotor 1, rotor 2, …, calibrated; empty while there is no verdict.
    pub class_probability: Vec<f32>,
}

impl NetworkOverTimeView {
    fn in_window(window: &Window) -> Self {
        let said = &window.network_over_time;
        Self {
            verdict: VerdictView::of(code_in(window, said.code)),
            class_probability: said.probability.clone(),
        }
    }
}

/// Lost thrust of a rotor at hover, with its 95 % interval; shares are of the rotor's nominal thrust.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct LossView {
    /// From 1.
    pub rotor: u32,
    /// N.
    pub loss_n: f32,
    /// Lower end, N.
    pub low_n: f32,
    /// Upper end, N.
    pub high_n: f32,
    /// Fraction.
    pub share: f32,
    /// Lower end, fraction.
    pub share_low: f32,
    /// Upper end, fraction.
    pub share_high: f32,
    /// Rate of change; absent in the first half second after a rotor is named, and if only the engine ran.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub motion: Option<MotionView>,
}

/// A quantity with its 95 % interval.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, ToSchema)]
pub struct IntervalView {
    /// Estimate.
    pub value: f32,
    /// Lower end.
    pub low: f32,
    /// Upper end.
    pub high: f32,
}

impl From<Interval> for IntervalView {
    fn from(Interval { value, low, high }: Interval) -> Self {
        Self { value, low, high }
    }
}

/// Rate of change of a loss.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, ToSchema)]
pub struct MotionView {
    /// True if the loss changes; otherwise the interval of the rate is that of a constant loss.
    pub moves: bool,
    /// Fraction of the rotor's nominal thrust per second; positive while the loss grows.
    pub rate_1_s: IntervalView,
}

impl From<Motion> for MotionView {
    fn from(motion: Motion) -> Self {
        Self {
            moves: motion.moves,
            rate_1_s: motion.rate_1_s.into(),
        }
    }
}

/// Kind of explanation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum ExplanationWord {
    /// These rotors lost thrust.
    Loss,
    /// One rotor lost thrust, and its blade drags more.
    LossWithDrag,
    /// One rotor gives more thrust than the model says.
    Gain,
    /// A load was dropped or taken up.
    Load,
}

/// One of the remaining explanations.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct ExplanationView {
    /// What.
    pub kind: ExplanationWord,
    /// Rotors, from 1; empty for a load.
    pub rotors: Vec<u32>,
    /// Probability of this explanation, whatever the verdict is.
    pub probability: f32,
    /// One entry per rotor: fraction of its nominal thrust that it lost; for a gain, that it gained.
    pub shares: Vec<IntervalView>,
    /// For a loss with drag: increase of the blade's drag relative to its lift, as a fraction.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub drag: Option<IntervalView>,
    /// For a load: picked up, or dropped (negative), kg.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mass_kg: Option<IntervalView>,
}

impl From<&Explained> for ExplanationView {
    fn from(explained: &Explained) -> Self {
        Self {
            kind: match explained.kind {
                ExplanationKind::Loss => ExplanationWord::Loss,
                ExplanationKind::LossWithDrag => ExplanationWord::LossWithDrag,
                ExplanationKind::Gain => ExplanationWord::Gain,
                ExplanationKind::Load => ExplanationWord::Load,
            },
            rotors: rotors_of(explained.rotors),
            probability: explained.probability,
            shares: explained.shares.iter().copied().map(IntervalView::from).collect(),
            drag: explained.drag.map(IntervalView::from),
            mass_kg: explained.mass_kg.map(IntervalView::from),
        }
    }
}

impl LossView {
    fn of(rotor: u32, loss: &LossEstimate) -> Self {
        let [loss_n, low_n, high_n, share, share_low, share_high] = loss.values();
        Self {
            rotor,
            loss_n,
            low_n,
            high_n,
            share,
            share_low,
            share_high,
            motion: None,
        }
    }
}

/// The sequential detector's verdict.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct SequentialView {
    /// Verdict.
    #[serde(flatten)]
    pub verdict: VerdictView,
    /// The verdict in words, with sizes and 95 % intervals, as commands print it: `rotor 3 lost 10.0 % [9.8, 10.2]`.
    pub sentence: String,
    /// Probability of its verdict; 0 while it is not ready.
    pub probability: f32,
    /// Severity: one entry per named rotor.
    pub thrust_loss: Vec<LossView>,
    /// Rotors, from 1, that are or may be faulty.
    pub suspect_rotors: Vec<u32>,
    /// Sets of rotors between which an ambiguous verdict cannot decide.
    pub hypothesis_count: u32,
    /// Most probable sets of rotors, best first; rotors from 1.
    pub hypotheses: Vec<Vec<u32>>,
    /// Explanations of a verdict other than healthy, most probable first, each with its sizes; different kinds on the
    /// same rotors are listed separately. Empty if only the engine ran.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub explanations: Vec<ExplanationView>,
}

/// Probability of health below which it is not said.
const LEAST_CLEAR: f32 = 0.5;

impl SequentialView {
    /// No verdict, for the reason given next to it.
    pub fn cannot_judge() -> Self {
        Self {
            verdict: VerdictView::of(CANNOT_JUDGE),
            sentence: String::new(),
            probability: 0.0,
            thrust_loss: Vec::new(),
            suspect_rotors: Vec::new(),
            hypothesis_count: 0,
            hypotheses: Vec::new(),
            explanations: Vec::new(),
        }
        .said()
    }

    /// From a window.
    pub fn in_window(window: &Window) -> Self {
        if window.obstacle.is_some() {
            Self::cannot_judge()
        } else {
            Self::unsaid(&window.report).with(&window.details)
        }
    }

    /// No alarm, although health is the less likely explanation: the evidence for a rotor has not lasted, or is that of
    /// none.
    pub fn is_unclear(&self) -> bool {
        self.verdict.verdict == VerdictKind::Healthy && self.probability < LEAST_CLEAR
    }

    fn with(mut self, details: &Details) -> Self {
        for (loss, motion) in self.thrust_loss.iter_mut().zip(&details.motion) {
            loss.motion = Some((*motion).into());
        }
        self.explanations = details.explanations.iter().map(ExplanationView::from).collect();
        self.said()
    }

    /// The same without what only the second look knows.
    fn bare(mut self) -> Self {
        self.explanations.clear();
        self.thrust_loss.iter_mut().for_each(|loss| loss.motion = None);
        self.said()
    }

    /// From a report.
    pub fn of(report: &FdiReport) -> Self {
        Self::unsaid(report).said()
    }

    /// The same without its sentence.
    fn unsaid(report: &FdiReport) -> Self {
        let verdict = VerdictView::of(report.sequential);
        let losses = [&report.thrust_loss, &report.second_thrust_loss];
        let listed = (report.hypothesis_count as usize).min(MAX_HYPOTHESES);
        Self {
            thrust_loss: verdict
                .rotors
                .iter()
                .zip(losses)
                .map(|(rotor, loss)| LossView::of(*rotor, loss))
                .collect(),
            verdict,
            sentence: String::new(),
            probability: report.sequential_probability,
            suspect_rotors: rotors_of(report.suspect_rotors),
            hypothesis_count: report.hypothesis_count,
            hypotheses: report.hypothesis_rotors[..listed]
                .iter()
                .map(|mask| rotors_of(*mask))
                .collect(),
            explanations: Vec::new(),
        }
    }

    /// With its sentence.
    fn said(mut self) -> Self {
        self.sentence = words_of(&self);
        self
    }
}

/// A verdict as one line, with sizes and 95 % intervals: the same for commands, the API, the page and Python.
fn words_of(view: &SequentialView) -> String {
    match view.verdict.verdict {
        VerdictKind::NotReady => "calibrating".to_owned(),
        VerdictKind::Healthy if view.is_unclear() => {
            "unclear: more than health explains, and no rotor stands out".to_owned()
        }
        VerdictKind::Healthy => "healthy".to_owned(),
        VerdictKind::Unknown => "unknown fault".to_owned(),
        VerdictKind::CannotJudge => "cannot judge".to_owned(),
        VerdictKind::Ambiguous if view.explanations.is_empty() => {
            let sets: Vec<String> = view
                .hypotheses
                .iter()
                .map(|set| set.iter().map(u32::to_string).collect::<Vec<_>>().join("+"))
                .collect();
            format!("ambiguous: rotors {}", sets.join(" or "))
        }
        VerdictKind::Ambiguous => {
            let explanations: Vec<String> = view.explanations.iter().map(explanation).collect();
            match explanations.as_slice() {
                // No code is of a gain, or of three rotors.
                [only] => only.clone(),
                several => format!("ambiguous: {}", several.join(" or ")),
            }
        }
        VerdictKind::Faulty | VerdictKind::FaultyPair => {
            let losses: Vec<String> = view
                .thrust_loss
                .iter()
                .map(|one| loss(one, &view.explanations))
                .collect();
            losses.join(", ")
        }
    }
}

/// `rotor 3 lost 10.0 % [9.8, 10.2]`, with what else is known of it.
fn loss(loss: &LossView, explanations: &[ExplanationView]) -> String {
    let share = Interval {
        value: loss.share,
        low: loss.share_low,
        high: loss.share_high,
    };
    let motion = loss.motion.map(|motion| Motion {
        moves: motion.moves,
        rate_1_s: interval(&motion.rate_1_s),
    });
    // Likelier than not: the blade drags.
    let first = explanations.iter().find(|one| one.rotors == [loss.rotor]);
    let drag = first.and_then(|one| one.drag.as_ref()).map(interval);
    words::loss(loss.rotor, &share, motion.as_ref(), drag.as_ref())
}

/// One of several explanations.
fn explanation(one: &ExplanationView) -> String {
    let kind = match one.kind {
        ExplanationWord::Loss => ExplanationKind::Loss,
        ExplanationWord::LossWithDrag => ExplanationKind::LossWithDrag,
        ExplanationWord::Gain => ExplanationKind::Gain,
        ExplanationWord::Load => ExplanationKind::Load,
    };
    let shares: Vec<Interval> = one.shares.iter().map(interval).collect();
    let sizes = (one.drag.as_ref().map(interval), one.mass_kg.as_ref().map(interval));
    words::explanation(kind, &one.rotors, &shares, sizes, one.probability)
}

fn interval(view: &IntervalView) -> Interval {
    let IntervalView { value, low, high } = *view;
    Interval { value, low, high }
}

/// Verdicts at the end of a window.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct WindowView {
    /// Its last step.
    pub step: u64,
    /// Since the session's first step, s.
    pub time_s: f64,
    /// Valid at this step.
    pub calibration: CalibrationState,
    /// The statistical test of the paper.
    pub t_test: VerdictView,
    /// The classifier.
    pub network: NetworkView,
    /// The same over time, for a classifier that calibrates itself: accumulated evidence of its windows; not ready
    /// for other classifiers.
    pub network_over_time: NetworkOverTimeView,
    /// The verdict to act on: that of the detector that decides over time, after a second look at alternative
    /// explanations and at the current size.
    pub sequential: SequentialView,
    /// The same before the second look, as a run would record it; only if different.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub engine: Option<SequentialView>,
    /// Why the verdicts are `cannot_judge`.
    pub cannot_judge: Option<ObstacleView>,
    /// Smallest loss of each rotor, as a fraction of its thrust, that would now be detected within 10 s; empty
    /// without a verdict and while a fault or an obstacle is reported.
    pub smallest_loss: Vec<f32>,
    /// The last load that was dropped or picked up since the calibration began, from the window that named it on;
    /// rotors are judged with it. Absent without one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub load: Option<LoadView>,
}

/// A load that was dropped or picked up.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct LoadView {
    /// When the load changed, s on the clock of the windows.
    pub time_s: f64,
    /// When it was reported, s on the same clock.
    pub named_s: f64,
    /// Picked up, or dropped (negative), kg.
    pub mass_kg: IntervalView,
    /// Probability of a load among all causes of such a force.
    pub probability: f32,
}

impl LoadView {
    /// As of a window that ends at a time, s.
    fn of(load: &LoadChange, time_s: f64) -> Self {
        let changed_s = time_s - load.since_s;
        Self {
            time_s: changed_s,
            named_s: changed_s + load.named_after_s,
            mass_kg: load.mass_kg.into(),
            probability: load.probability,
        }
    }

    /// On a clock that began earlier, s.
    pub(crate) fn later(mut self, by_s: f64) -> Self {
        self.time_s += by_s;
        self.named_s += by_s;
        self
    }
}

impl WindowView {
    /// The window on a clock that began earlier, s.
    pub(crate) fn later(mut self, by_s: f64) -> Self {
        self.time_s += by_s;
        self.load = self.load.map(|load| load.later(by_s));
        self
    }
}

/// The code of a detector, as in JSON.
pub(crate) fn code_in(window: &Window, code: i32) -> i32 {
    if window.obstacle.is_some() { CANNOT_JUDGE } else { code }
}

impl From<&Window> for WindowView {
    fn from(window: &Window) -> Self {
        let report = &window.report;
        Self {
            step: report.stamp.step,
            time_s: report.stamp.sim_time_ns as f64 * 1e-9,
            calibration: window.calibration.into(),
            t_test: VerdictView::of(code_in(window, report.t_test)),
            network: NetworkView {
                verdict: VerdictView::of(code_in(window, report.network)),
                class_probability: window.class_probability.clone(),
            },
            network_over_time: NetworkOverTimeView::in_window(window),
            sequential: SequentialView::in_window(window),
            engine: Some(SequentialView::of(&window.engine))
                .filter(|engine| *engine != SequentialView::in_window(window).bare()),
            cannot_judge: window.obstacle.as_ref().map(ObstacleView::from),
            smallest_loss: window.smallest_loss.clone(),
            load: window
                .load
                .as_ref()
                .map(|load| LoadView::of(load, report.stamp.sim_time_ns as f64 * 1e-9)),
        }
    }
}

/// Result of a chunk of measurements.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct ChunkAnswer {
    /// First step of the chunk.
    pub first_step: u64,
    /// Step at which the next chunk must begin.
    pub next_step: u64,
    /// The chunk had already been accepted; this is the original response.
    pub repeated: bool,
    /// Windows that ended in the chunk, in order.
    pub windows: Vec<WindowView>,
    /// Other events, one sentence each: steps bridged, a pause on the ground, a restarted calibration.
    pub notes: Vec<String>,
}

impl From<&Answer> for ChunkAnswer {
    fn from(answer: &Answer) -> Self {
        Self {
            first_step: answer.first_step,
            next_step: answer.next_step,
            repeated: answer.repeated,
            windows: answer.windows.iter().map(WindowView::from).collect(),
            notes: answer.notes.clone(),
        }
    }
}

/// A change of the sequential detector's verdict.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct ChangeView {
    /// Last step of the window.
    pub step: u64,
    /// Since the first step, s.
    pub time_s: f64,
    /// The new verdict.
    pub sequential: SequentialView,
    /// Why it is `cannot_judge`.
    pub cannot_judge: Option<ObstacleView>,
}

impl ChangeView {
    /// From a window.
    pub fn of(window: &Window) -> Self {
        Self {
            step: window.report.stamp.step,
            time_s: window.report.stamp.sim_time_ns as f64 * 1e-9,
            sequential: SequentialView::in_window(window),
            cannot_judge: window.obstacle.as_ref().map(ObstacleView::from),
        }
    }
}

/// The detectors in effect.
#[derive(Debug, Clone, PartialEq, Serialize, ToSchema)]
pub struct DetectorsView {
    /// Name of the vehicle.
    pub vehicle: String,
    /// Number of rotors.
    pub rotor_count: usize,
    /// Name of the classifier; without one the network gives no verdict.
    pub classifier: Option<String>,
    /// Samples of 2.5 ms per decision.
    pub window_samples: u16,
    /// Gain of the residual generators, 1/s.
    pub observer_gain_1_s: f64,
    /// Rotor model of the residual generators: `static`, `lagged` or `linear`.
    pub nominal_thrust: String,
    /// Significance of the T-test's detection.
    pub alpha_detect: f64,
    /// Significance of the T-test's isolation.
    pub alpha_isolate: f64,
    /// Start of the calibration, s.
    pub calibration_start_s: f64,
    /// End of the calibration, s; the vehicle is assumed healthy until then.
    pub calibration_end_s: f64,
}

impl From<&Detectors> for DetectorsView {
    fn from(detectors: &Detectors) -> Self {
        let settings = detectors.settings();
        Self {
            vehicle: detectors.vehicle().vehicle.name.clone(),
            rotor_count: detectors.vehicle().rotor_count(),
            classifier: detectors.classifier().map(|classifier| classifier.name.clone()),
            window_samples: settings.window_samples,
            observer_gain_1_s: settings.observer_gain_1_s,
            nominal_thrust: settings.nominal_thrust.as_str().to_owned(),
            alpha_detect: settings.alpha_detect,
            alpha_isolate: settings.alpha_isolate,
            calibration_start_s: settings.calibration_start_s,
            calibration_end_s: settings.calibration_end_s,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The page said "ambiguous; rotors in question: 2" of a rotor that gives more.
    #[test]
    fn regress_a_single_explanation_is_said_though_no_code_is_of_its_kind() {
        let size = IntervalView {
            value: 0.081,
            low: 0.076,
            high: 0.086,
        };
        let gain = ExplanationView {
            kind: ExplanationWord::Gain,
            rotors: vec![2],
            probability: 0.999,
            shares: vec![size],
            drag: None,
            mass_kg: None,
        };
        let mut view = SequentialView::cannot_judge();
        view.verdict.verdict = VerdictKind::Ambiguous;
        view.explanations = vec![gain.clone()];
        assert_eq!(words_of(&view), "rotor 2 gives 8.1 % [7.6, 8.6] more (1.00)");
        view.explanations.push(ExplanationView {
            kind: ExplanationWord::Loss,
            rotors: vec![5],
            probability: 0.4,
            ..gain
        });
        let said = words_of(&view);
        assert!(
            said.starts_with("ambiguous: rotor 2 gives") && said.contains(" or rotor 5 lost "),
            "{said}"
        );
    }

    #[test]
    fn val_verdict_codes_name_their_rotors() {
        for (code, kind, rotors) in [
            (-4, VerdictKind::CannotJudge, vec![]),
            (-3, VerdictKind::Ambiguous, vec![]),
            (-2, VerdictKind::NotReady, vec![]),
            (-1, VerdictKind::Unknown, vec![]),
            (0, VerdictKind::Healthy, vec![]),
            (6, VerdictKind::Faulty, vec![6]),
            (206, VerdictKind::FaultyPair, vec![2, 6]),
            (1112, VerdictKind::FaultyPair, vec![11, 12]),
        ] {
            let view = VerdictView::of(code);
            assert_eq!((view.verdict, view.rotors), (kind, rotors), "{code}");
        }
    }
}
