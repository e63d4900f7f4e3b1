//! The network's verdicts weighed over time: a Bayes filter over windows, in place of one verdict a window.
//!
//! The paper's network (§5.2) says something new every 62.5 ms, so that an error in a hundred windows is an alarm every six seconds. Here
//! the state is healthy or a fault of rotor i; a window is evidence only for or against rotor i being named *more often than before*:
//!
//! ```text
//! P'(i) ∝ Σ_j P(j) T(j→i),   P(i) ∝ P'(i) · [ b_i q/p_i + (1 − b_i)(1 − q)/(1 − p_i) ]^λ,   b_i = 1 if the network names rotor i
//! ```
//! * p_i: how often the network names rotor i in a healthy vehicle: a Beta posterior from its windows in the calibration, and from all later
//!   ones as far as the vehicle is healthy by this filter. What the network always says is no news.
//! * q: how often it names rotor i once that has lost thrust.
//! * λ below 1: the errors of windows in a row are alike (gusts last for seconds), so that they count as fewer.
//! * T: a fault sets in once in an hour and ends once in a minute.
//!
//! The verdict is the rotor whose probability passes [`WeighedConfig::sure`]; once named it stays until it falls below one half.
//!
//! Limits: needs single verdicts of a classifier that works at all; a rotor that it names for seconds in a gust is a fault here, too. One rotor at a
//! time. It is not part of a run's hash, and does not run on boards: it reads what they report.
//!
//! Source: the forward algorithm of hidden Markov models (Rabiner, Proc. IEEE 77 (1989), §III.A), tempered.

use rotortwin_flight_core::MAX_ROTORS;
use rotortwin_flight_core::fdi::FaultVerdict;
use rotortwin_flight_core::fdi::verdict_code::NOT_READY;

/// The vehicle is taken to be healthy for so long, as by the other detectors, ns.
pub const CALIBRATION_NS: u64 = 10_000_000_000;

/// Parameters of [`WeighedNetwork`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WeighedConfig {
    /// q, share of windows that name the rotor that has lost thrust.
    pub hit: f64,
    /// Prior mean of p_i.
    pub false_share: f64,
    /// Windows that this prior counts for.
    pub prior_windows: f64,
    /// Least p_i: no gust was seen in the calibration, and one may come.
    pub least_false_share: f64,
    /// λ.
    pub temper: f64,
    /// Windows that p_i remembers.
    pub memory_windows: f64,
    /// Mean number of windows until a fault.
    pub mean_windows_to_fault: f64,
    /// Mean number of windows until it ends.
    pub mean_windows_to_end: f64,
    /// Probability from which on a rotor is named.
    pub sure: f64,
}

impl WeighedConfig {
    /// For windows of 62.5 ms: one tuning for all vehicles and worlds.
    pub const STANDARD: Self = Self {
        hit: 0.85,
        false_share: 0.02,
        prior_windows: 40.0,
        least_false_share: 0.02,
        temper: 0.1,
        memory_windows: 960.0,
        mean_windows_to_fault: 57_600.0,
        mean_windows_to_end: 960.0,
        sure: 0.95,
    };
}

/// What it says at the end of a window.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Weighed {
    /// Not ready as long as the network was.
    pub verdict: FaultVerdict,
    /// Probability of the verdict, fraction; 0 while not ready.
    pub probability: f64,
}

/// Weighs the verdicts of a network.
#[derive(Clone, Debug)]
pub struct WeighedNetwork {
    config: WeighedConfig,
    rotor_count: usize,
    /// Windows that p_i is known from, discounted.
    windows: f64,
    /// Of these, those that named rotor i.
    named: [f64; MAX_ROTORS],
    /// P(i).
    faulty: [f64; MAX_ROTORS],
    said: Weighed,
}

impl WeighedNetwork {
    /// For a vehicle with so many rotors, at most [`MAX_ROTORS`].
    pub fn new(rotor_count: usize, config: WeighedConfig) -> Self {
        Self {
            config,
            rotor_count: rotor_count.min(MAX_ROTORS),
            windows: 0.0,
            named: [0.0; MAX_ROTORS],
            faulty: [0.0; MAX_ROTORS],
            said: Weighed::default(),
        }
    }

    /// What it said last.
    pub fn said(&self) -> Weighed {
        self.said
    }

    /// Takes the code of the network's verdict at the end of a window. `calibrating`: the vehicle is taken to be healthy.
    pub fn window(&mut self, code: i32, calibrating: bool) -> Weighed {
        if code == NOT_READY {
            return self.said;
        }
        let rotors = self.rotor_count;
        let named = usize::try_from(code).ok().and_then(|code| code.checked_sub(1)).filter(|rotor| *rotor < rotors);
        if !calibrating {
            self.weigh(named);
        }
        let healthy = self.healthy();
        self.learn(named, healthy);
        self.said = self.decide(healthy);
        self.said
    }

    fn healthy(&self) -> f64 {
        (1.0 - self.faulty.iter().take(self.rotor_count).sum::<f64>()).max(0.0)
    }

    fn weigh(&mut self, named: Option<usize>) {
        let config = self.config;
        let (begin, end) = (config.mean_windows_to_fault.recip(), config.mean_windows_to_end.recip());
        let healthy = self.healthy();
        let share = begin / self.rotor_count.max(1) as f64;
        let ended: f64 = end * (1.0 - healthy);
        let mut total = healthy * (1.0 - begin) + ended;
        for rotor in 0..self.rotor_count {
            let before = self.faulty[rotor] * (1.0 - end) + healthy * share;
            let false_share = self.false_share(rotor);
            // What it names as often without a fault says nothing.
            let ratio = if false_share >= config.hit {
                1.0
            } else if named == Some(rotor) {
                config.hit / false_share
            } else {
                (1.0 - config.hit) / (1.0 - false_share)
            };
            self.faulty[rotor] = before * libm::pow(ratio, config.temper);
            total += self.faulty[rotor];
        }
        for probability in self.faulty.iter_mut().take(self.rotor_count) {
            *probability /= total;
        }
    }

    /// p_i.
    fn false_share(&self, rotor: usize) -> f64 {
        let config = self.config;
        let prior = config.false_share * config.prior_windows;
        ((self.named[rotor] + prior) / (self.windows + config.prior_windows)).max(config.least_false_share)
    }

    fn learn(&mut self, named: Option<usize>, weight: f64) {
        let kept = 1.0 - weight / self.config.memory_windows;
        self.windows = self.windows * kept + weight;
        for (rotor, count) in self.named.iter_mut().enumerate().take(self.rotor_count) {
            *count = *count * kept + if named == Some(rotor) { weight } else { 0.0 };
        }
    }

    fn decide(&self, healthy: f64) -> Weighed {
        let mut best = 0;
        for rotor in 1..self.rotor_count {
            if self.faulty[rotor] > self.faulty[best] {
                best = rotor;
            }
        }
        let probability = self.faulty[best];
        let held = matches!(self.said.verdict, FaultVerdict::Faulty { rotor } if usize::from(rotor) == best);
        if probability >= self.config.sure || (held && probability >= 0.5) {
            return Weighed {
                verdict: FaultVerdict::Faulty { rotor: u8::try_from(best).expect("at most 16 rotors") },
                probability,
            };
        }
        Weighed {
            verdict: FaultVerdict::Healthy,
            probability: healthy,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn weighed() -> WeighedNetwork {
        let mut weighed = WeighedNetwork::new(6, WeighedConfig::STANDARD);
        for _ in 0..150 {
            assert_eq!(weighed.window(0, true).verdict, FaultVerdict::Healthy);
        }
        weighed
    }

    #[test]
    fn scenario_one_wrong_window_is_no_alarm_and_many_right_ones_are_a_name() {
        let mut weighed = weighed();
        for window in 0..1000 {
            let code = if window % 50 == 0 { 3 } else { 0 };
            assert_eq!(weighed.window(code, false).verdict, FaultVerdict::Healthy, "window {window}");
        }
        let delay = (1..2000)
            .find(|_| weighed.window(5, false).verdict == FaultVerdict::Faulty { rotor: 4 })
            .expect("it is named at last");
        assert!((5..200).contains(&delay), "{delay} windows");
        assert!(weighed.said().probability >= 0.95);
        let release = (1..2000)
            .find(|_| weighed.window(0, false).verdict == FaultVerdict::Healthy)
            .expect("it is released");
        assert!(release < 200, "{release} windows");
    }

    /// What the network says of a healthy vehicle in the calibration is no evidence later.
    #[test]
    fn scenario_what_was_always_said_is_no_news() {
        let mut weighed = WeighedNetwork::new(6, WeighedConfig::STANDARD);
        (0..150).for_each(|_| {
            weighed.window(2, true);
        });
        for window in 0..3000 {
            assert_eq!(weighed.window(2, false).verdict, FaultVerdict::Healthy, "window {window}");
        }
        assert!((0..3000).any(|_| weighed.window(4, false).verdict == FaultVerdict::Faulty { rotor: 3 }));
    }

    /// Two steps by hand: two rotors, q = 0.8, p = 0.1, λ = 1, a fault once in 100 windows, which lasts.
    #[test]
    fn val_two_windows_by_hand() {
        let config = WeighedConfig {
            hit: 0.8,
            false_share: 0.1,
            prior_windows: 1e9,
            least_false_share: 0.0,
            temper: 1.0,
            memory_windows: 1e9,
            mean_windows_to_fault: 100.0,
            mean_windows_to_end: f64::INFINITY,
            sure: 0.95,
        };
        let mut weighed = WeighedNetwork::new(2, config);
        weighed.window(1, false);
        // Healthy 0.99, rotor 1: 0.005 · 8 = 0.04, rotor 2: 0.005 · 0.2/0.9 = 1/900; sum 1.031111.
        let sum = 0.99 + 0.04 + 1.0 / 900.0;
        assert!((weighed.healthy() - 0.99 / sum).abs() < 1e-5);
        assert!((weighed.faulty[0] - 0.04 / sum).abs() < 1e-5);
        weighed.window(1, false);
        let (h, a, b) = (0.99 / sum, 0.04 / sum, 1.0 / 900.0 / sum);
        let terms = [h * 0.99, (a + h * 0.005) * 8.0, (b + h * 0.005) * 0.2 / 0.9];
        let total: f64 = terms.iter().sum();
        assert!((weighed.faulty[0] - terms[1] / total).abs() < 1e-5);
        assert!((weighed.faulty[1] - terms[2] / total).abs() < 1e-5);
    }

    #[test]
    fn val_without_a_network_there_is_nothing_to_weigh() {
        let mut weighed = WeighedNetwork::new(4, WeighedConfig::STANDARD);
        assert_eq!(weighed.window(-2, false), Weighed::default());
        assert_eq!(weighed.said().verdict, FaultVerdict::NotReady);
    }
}
