//! Distinguishes a fault from a disturbance by how the findings develop from window to window.
//!
//! A gust that the calibration did not have makes a wrench that some loss explains for a window or two, another one in
//! the next, and in the end none. An *episode* begins when something is found and ends when it is over. Where the model
//! has explained the flight so far ([`super::trust`]), a name with which it begins is reported immediately if the
//! evidence is strong; other names, and sets, once they have persisted for [`LASTING`]. Where it has not, names are
//! reported after [`LONG`] and sets after
//! [`LONGEST`]: what the model lacks imitates a loss for as long as a manoeuvre lasts, whereas a loss stays.
//!
//! An episode that ends without having had one name for [`LASTING`] was a disturbance; for [`REMEMBERED_S`] after it
//! the model counts as failing, and the apparent losses of its rotors count as undetectable ([`Settling::size`]).

use super::meter::AXES;
use rotortwin_flight_core::MAX_ROTORS;

/// Consecutive windows with one name, or with sets of rotors: a disturbance seldom leaves the same kind of answer for
/// longer.
const LASTING: u32 = 6;
/// The same where the model fails, 2 s and 6 s: a name, sets.
const LONG: u32 = 32;
const LONGEST: u32 = 96;
/// An episode begins with this many windows: the engine may be a window ahead.
const FIRST: u32 = 3;
/// A disturbance is followed by others of the same weather for this long, s.
const REMEMBERED_S: f64 = 60.0;

/// The second look's answer for a window in which something is wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Answer {
    /// These rotors lost thrust.
    Name(u32),
    /// One of several sets.
    Sets,
    /// A load, something unknown, too many sets, or too little evidence.
    Neither,
}

/// See the module.
#[derive(Clone, Debug, Default)]
pub(super) struct Settling {
    /// Since the last disturbance, s.
    since_disturbance: Option<f64>,
    episode: Option<Episode>,
    /// In the disturbances that are remembered: largest apparent loss of each rotor, N.
    size: [f64; MAX_ROTORS],
}

#[derive(Clone, Debug)]
struct Episode {
    /// The model had failed before it.
    is_careful: bool,
    windows: u32,
    last: Option<Answer>,
    /// Consecutive windows with the same kind of answer, of names with the same name.
    run: u32,
    /// Longest run of a name.
    longest: u32,
    is_told: bool,
    size: [f64; MAX_ROTORS],
}

impl Settling {
    /// Elapsed time, s.
    pub(super) fn pass(&mut self, elapsed: f64) {
        if let Some(since) = &mut self.since_disturbance {
            *since += elapsed;
            if *since > REMEMBERED_S {
                self.since_disturbance = None;
                self.size = [0.0; MAX_ROTORS];
            }
        }
    }

    /// An episode is in progress.
    pub(super) fn is_open(&self) -> bool {
        self.episode.is_some()
    }

    /// An episode begins.
    ///
    /// * `is_trusted`: the model has explained the flight so far
    pub(super) fn begin(&mut self, is_trusted: bool) {
        self.episode = Some(Episode {
            is_careful: !is_trusted || self.since_disturbance.is_some(),
            windows: 0,
            last: None,
            run: 0,
            longest: 0,
            is_told: false,
            size: [0.0; MAX_ROTORS],
        });
    }

    /// The episode was reported.
    pub(super) fn is_told(&self) -> bool {
        self.episode.as_ref().is_some_and(|episode| episode.is_told)
    }

    /// The episode needs more than usual to be reported.
    pub(super) fn is_careful(&self) -> bool {
        self.episode.as_ref().is_some_and(|episode| episode.is_careful)
    }

    /// Processes the answer of a window in an episode; returns whether it may be reported.
    ///
    /// * `is_strong`: so much evidence that a name need not persist first   * `column`: of each rotor, levers taken out
    /// * `lost`: wrench, levers taken out, N
    pub(super) fn take(
        &mut self,
        answer: Answer,
        is_strong: bool,
        column: &[[f64; AXES]; MAX_ROTORS],
        lost: &[f64; AXES],
    ) -> bool {
        let Some(episode) = &mut self.episode else {
            return false;
        };
        episode.windows += 1;
        episode.run = if episode.last == Some(answer) {
            episode.run + 1
        } else {
            1
        };
        episode.last = Some(answer);
        for (size, column) in episode.size.iter_mut().zip(column) {
            let square: f64 = column.iter().map(|x| x * x).sum();
            let along: f64 = column.iter().zip(lost).map(|(x, lost)| -x * lost).sum();
            if square > 0.0 {
                *size = size.max(along / square);
            }
        }
        if let Answer::Name(_) = answer {
            episode.longest = episode.longest.max(episode.run);
        }
        episode.is_told |= match (answer, episode.is_careful) {
            (Answer::Name(_), false) => episode.run >= LASTING || is_strong && episode.windows <= FIRST,
            (Answer::Name(_), true) => episode.run >= LONG,
            (Answer::Sets, false) => episode.run >= LASTING,
            (Answer::Sets, true) => episode.run >= LONGEST,
            (Answer::Neither, _) => false,
        };
        episode.is_told
    }

    /// Nothing is wrong any more; returns whether it was a loss.
    pub(super) fn over(&mut self) -> bool {
        let Some(episode) = self.episode.take() else {
            return false;
        };
        let was_loss = episode.longest >= LASTING;
        if !was_loss {
            self.since_disturbance = Some(0.0);
            for (size, seen) in self.size.iter_mut().zip(episode.size) {
                *size = size.max(seen);
            }
        }
        was_loss
    }

    /// The cause is known by now to be something else: neither a loss nor a disturbance.
    pub(super) fn dismiss(&mut self) {
        self.episode = None;
    }

    /// Apparent loss of each rotor in the disturbances that are remembered, N: a loss of that size would be mistaken
    /// for one.
    pub(super) fn size(&self) -> &[f64; MAX_ROTORS] {
        &self.size
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const COLUMN: [[f64; AXES]; MAX_ROTORS] = [[-1.0, 0.5, 0.0, 0.0]; MAX_ROTORS];
    const LOST: [f64; AXES] = [0.2, -0.1, 0.0, 0.0];

    /// What is reported in an episode.
    fn told(settling: &mut Settling, is_trusted: bool, is_strong: bool, answers: &[Answer]) -> Vec<bool> {
        settling.begin(is_trusted);
        answers
            .iter()
            .map(|answer| settling.take(*answer, is_strong, &COLUMN, &LOST))
            .collect()
    }

    fn from(first: u32, windows: u32) -> Vec<bool> {
        (1..=windows).map(|window| window >= first).collect()
    }

    #[test]
    fn val_what_changes_from_window_to_window_is_not_told() {
        use Answer::{Name, Neither, Sets};
        let gust = [Sets, Sets, Neither, Sets, Name(4), Name(2), Neither];
        let mut settling = Settling::default();
        assert_eq!(told(&mut settling, true, true, &gust), [false; 7]);
        assert!(!settling.over());
        assert_eq!(told(&mut settling, true, true, &gust), [false; 7]);
        // An error along the column is what a loss of it would be.
        assert!((settling.size()[0] - 0.2).abs() < 1e-9, "{:?}", settling.size());
    }

    #[test]
    fn val_a_loss_is_named_at_once_and_after_a_gust_when_it_lasts() {
        let name = [Answer::Name(1); 40];
        let mut settling = Settling::default();
        // Named for longer than any gust is, gone, and back.
        assert_eq!(told(&mut settling, true, true, &name), from(1, 40));
        assert!(settling.over());
        assert_eq!(told(&mut settling, true, true, &name[..1]), [true]);
        // That one was too short to decide.
        assert!(!settling.over());
        assert_eq!(told(&mut settling, true, true, &name), from(LONG, 40));
        assert!(settling.over());
        settling.pass(REMEMBERED_S + 1.0);
        assert_eq!(told(&mut settling, true, true, &name[..1]), [true]);
        assert_eq!(settling.size(), &[0.0; MAX_ROTORS]);
    }

    #[test]
    fn val_weak_evidence_and_a_model_that_fails_need_time() {
        let mut settling = Settling::default();
        let (name, sets) = ([Answer::Name(1); 100], [Answer::Sets; 100]);
        assert_eq!(told(&mut settling, true, false, &name), from(LASTING, 100));
        assert_eq!(told(&mut settling, false, true, &name), from(LONG, 100));
        assert_eq!(told(&mut settling, true, true, &sets), from(LASTING, 100));
        assert_eq!(told(&mut settling, false, true, &sets), from(LONGEST, 100));
    }
}
