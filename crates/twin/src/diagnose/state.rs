//! The state of a search, on which its passes work: the point of the fit, the named effects, and the diagnosis in
//! progress.

use super::Options;
use super::named::Named;
use super::result::Diagnosis;
use super::strategies::covariance::Gusts;
use crate::estimation::columns::LogState;
use crate::estimation::normal::Posterior;
use crate::estimation::posterior::posterior_of;
use crate::estimation::problem::Problem;
use crate::estimation::whiteness::ChannelFit;
use crate::predict::{CHANNELS, Nuisances, PredictError};

/// Fits of the channels, log by log.
pub(crate) type Fits = Vec<[Option<ChannelFit>; CHANNELS]>;

/// A search under way.
pub(crate) struct State<'a> {
    /// Logs, library, the effects at work and where they stand.
    pub(crate) problem: Problem,
    /// Named effects, with the evidence of their rounds.
    pub(crate) named: Vec<Named>,
    /// Evidence of the best candidate that was not named, nats.
    pub(crate) left: f64,
    /// ln of the likelihood ratio of what was found on the blocks that the fit did not see.
    pub(crate) unseen_gain: f64,
    /// Nuisances of the given model: those that a comparison shows.
    pub(crate) plain: Vec<Nuisances>,
    /// The logs as a comparison takes them, with these nuisances and the noise that was assumed.
    pub(crate) compared: Vec<LogState>,
    /// Fits of the given model.
    pub(crate) before: Fits,
    /// Gusts, if they explain the rest.
    pub(crate) weather: Option<Gusts>,
    /// Why the named effects must not be trusted.
    pub(crate) doubts: Vec<Doubt>,
    /// Constants of the vehicle have intervals: it is known no better than these.
    pub(crate) has_intervals: bool,
    /// Threshold on the ln Bayes factor.
    pub(crate) threshold: f64,
    pub(crate) options: &'a Options<'a>,
    /// When the diagnosis began, on the clock of the options, s.
    pub(crate) began_s: f64,
    /// When the clock was looked at last, and the longest step between two looks, s.
    pub(crate) looked_s: f64,
    pub(crate) longest_s: f64,
    /// True once something was left out because the time was up.
    pub(crate) stopped: bool,
    /// The answer so far.
    pub(crate) diagnosis: Diagnosis,
}

impl State<'_> {
    /// Reports what is being done, and what share of the search is complete.
    pub(crate) fn progress(&self, text: &str, share: f64) {
        (self.options.progress)(text, share);
    }

    /// True if the time is up, or would be before a step as long as the longest so far ended; the caller then leaves
    /// out the rest of its search.
    pub(crate) fn time_is_up(&mut self) -> bool {
        let now_s = (self.options.clock)();
        self.longest_s = self.longest_s.max(now_s - self.looked_s);
        self.looked_s = now_s;
        let up = self.options.is_over(self.began_s - self.longest_s);
        self.stopped |= up;
        up
    }

    /// Posterior of all linear parameters about the present point, with gusts in the noise if there are any.
    pub(crate) fn posterior(&self) -> Result<Posterior, PredictError> {
        match &self.weather {
            Some(gusts) => Ok(gusts.posterior.clone()),
            None => Ok(posterior_of(&self.problem)?.0),
        }
    }
}

/// Why the named effects must not be trusted.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Doubt {
    /// The clutter had to stretch far beyond its prior: white residuals then say nothing.
    StretchedClutter,
    /// The size of this effect cannot be.
    ImpossibleSize(String),
    /// No vehicle has such a value of this constant.
    ImpossibleConstant(String),
    /// Three effects that are easily confused with one another.
    LookAlikes,
    /// The error of this quantity on blocks that the fit did not see rises.
    HeldOutRises(String),
}
