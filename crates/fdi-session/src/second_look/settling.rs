//! Tells a fault from a disturbance by what is said of it from window to window.
//!
//! A gust that the calibration did not have makes a wrench that some loss explains for a window or two, another one in the next, and at last none.
//! An *episode* begins when something is found and ends when it is over. A name with which it begins is told at once; other names, and sets, once
//! they have stood for [`LASTING`]. An episode that ends and never had one name for so long was a disturbance; for [`REMEMBERED_S`] after it only
//! a name that lasts is told, and what a rotor seemed to have lost in it is no loss that would be seen ([`Settling::size`]).

use super::meter::AXES;
use rotortwin_flight_core::MAX_ROTORS;

/// Windows in a row with one name, or with sets of rotors: a disturbance seldom leaves the same kind of answer for longer.
const LASTING: u32 = 6;
/// An episode begins with so many windows: the engine may be a window ahead.
const FIRST: u32 = 3;
/// A disturbance is followed by others of the same weather for so long, s.
const REMEMBERED_S: f64 = 60.0;

/// What the second look would say of a window in which something is wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Answer {
    /// These rotors lost thrust.
    Name(u32),
    /// One of several sets.
    Sets,
    /// A load, something unknown, or too many sets.
    Neither,
}

/// See the module.
#[derive(Clone, Debug, Default)]
pub(super) struct Settling {
    /// Since the last disturbance, s.
    since_disturbance: Option<f64>,
    episode: Option<Episode>,
    /// Of the disturbances that are remembered: largest loss that each rotor seemed to have, N.
    size: [f64; MAX_ROTORS],
}

#[derive(Clone, Debug, Default)]
struct Episode {
    windows: u32,
    last: Option<Answer>,
    /// Windows in a row with the same kind of answer, of names with the same name.
    run: u32,
    /// Longest run of a name.
    longest: u32,
    is_told: bool,
    size: [f64; MAX_ROTORS],
}

impl Settling {
    /// Time that went by, s.
    pub(super) fn pass(&mut self, elapsed: f64) {
        if let Some(since) = &mut self.since_disturbance {
            *since += elapsed;
            if *since > REMEMBERED_S {
                self.since_disturbance = None;
                self.size = [0.0; MAX_ROTORS];
            }
        }
    }

    /// Takes in the answer of a window; whether it may be told.
    ///
    /// * `column`: of each rotor, levers taken out   * `lost`: wrench, levers taken out, N
    pub(super) fn take(&mut self, answer: Answer, column: &[[f64; AXES]; MAX_ROTORS], lost: &[f64; AXES]) -> bool {
        let disturbed = self.since_disturbance.is_some();
        let episode = self.episode.get_or_insert_default();
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
        episode.is_told |= match answer {
            Answer::Name(_) => episode.run >= LASTING || !disturbed && episode.windows <= FIRST,
            Answer::Sets => episode.run >= LASTING && !disturbed,
            Answer::Neither => false,
        };
        episode.is_told
    }

    /// Nothing is wrong any more.
    pub(super) fn over(&mut self) {
        let Some(episode) = self.episode.take() else {
            return;
        };
        if episode.longest < LASTING {
            self.since_disturbance = Some(0.0);
            for (size, seen) in self.size.iter_mut().zip(episode.size) {
                *size = size.max(seen);
            }
        }
    }

    /// What each rotor seemed to have lost in the disturbances that are remembered, N: a loss of that size would be taken for one.
    pub(super) fn size(&self) -> &[f64; MAX_ROTORS] {
        &self.size
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const COLUMN: [[f64; AXES]; MAX_ROTORS] = [[-1.0, 0.5, 0.0, 0.0]; MAX_ROTORS];
    const LOST: [f64; AXES] = [0.2, -0.1, 0.0, 0.0];

    fn told(settling: &mut Settling, answers: &[Answer]) -> Vec<bool> {
        answers
            .iter()
            .map(|answer| settling.take(*answer, &COLUMN, &LOST))
            .collect()
    }

    #[test]
    fn val_what_changes_from_window_to_window_is_not_told() {
        use Answer::{Name, Neither, Sets};
        let gust = [Sets, Sets, Neither, Sets, Name(4), Name(2), Neither];
        let mut settling = Settling::default();
        assert_eq!(told(&mut settling, &gust), [false; 7]);
        settling.over();
        assert_eq!(told(&mut settling, &gust), [false; 7]);
        // An error along the column is what a loss of it would be.
        assert!((settling.size()[0] - 0.2).abs() < 1e-9, "{:?}", settling.size());
    }

    #[test]
    fn val_a_loss_is_named_at_once_and_after_a_gust_when_it_lasts() {
        let mut settling = Settling::default();
        assert_eq!(told(&mut settling, &[Answer::Name(1)]), [true]);
        // Named for half a second, gone, and back: no gust.
        told(&mut settling, &[Answer::Name(1); 8]);
        settling.over();
        assert_eq!(told(&mut settling, &[Answer::Name(1)]), [true]);
        settling.over();
        // That one was too short to tell.
        let expected: Vec<bool> = (1..=8).map(|run| run >= LASTING).collect();
        assert_eq!(told(&mut settling, &[Answer::Name(1); 8]), expected);
        settling.over();
        settling.pass(REMEMBERED_S + 1.0);
        assert_eq!(told(&mut settling, &[Answer::Name(2)]), [true]);
        assert_eq!(settling.size(), &[0.0; MAX_ROTORS]);
    }

    #[test]
    fn val_sets_that_stand_are_told() {
        let mut settling = Settling::default();
        let expected: Vec<bool> = (1..=8).map(|run| run >= LASTING).collect();
        assert_eq!(told(&mut settling, &[Answer::Sets; 8]), expected);
    }
}
