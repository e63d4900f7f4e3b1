//! How a diagnosis searches for an effect, and what it needs of the logs for that: declared by each effect in its own file.
//!
//! The diagnosis knows these strategies and requirements, but no effect: an effect that needs another start declares it here.

/// What the fits of an effect start from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Strategy {
    /// The linear estimate about zero.
    Linear,
    /// The same, once an effect that it needs is at work, in the model or named before: a share of another effect is nothing without it.
    OfAnother,
    /// Secants over these multiples of the plausible size: an effect on whole samples, such as a delay of a noisy
    /// command, differs from its derivative.
    Secants(&'static [f64]),
    /// A grid over shapes that have no column while the effect has no size.
    Shapes(Shapes),
    /// Each charge of the battery at the start, because the open-circuit voltage has kinks that a fit does not cross.
    BatteryState(AtBattery),
    /// The likelihood of its covariance: random forcing has no column.
    Covariance,
    /// Not searched: the covariance of this other effect is nearly the same.
    CovarianceOf(&'static str),
    /// Each wiring at its whole size: a gross error is not a small deviation.
    Wiring(Wiring),
    /// Fitted with every flight; never a finding.
    Nuisance,
}

/// Shapes that a grid covers; parameters by name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shapes {
    /// The plausible range of each of these shapes, in geometric steps.
    Range(&'static [&'static str]),
    /// A horizontal surface over the highest point of the flights.
    Above {
        /// Height over the origin of NED, m.
        height: &'static str,
    },
    /// A vertical surface beyond the farthest point of the flights, in every direction.
    Beside {
        /// Distance from the origin of NED, m.
        distance: &'static str,
        /// Direction from north, clockwise, rad.
        azimuth: &'static str,
    },
}

impl Shapes {
    /// True for a surface, which a flight may never come near: then it can have any strength.
    pub fn is_surface(self) -> bool {
        matches!(self, Self::Above { .. } | Self::Beside { .. })
    }
}

/// Where at the battery an effect acts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AtBattery {
    /// Inside: the voltage is another one.
    Inside,
    /// At the sensor: the voltage reads as another one. Errors of a sensor differ by little from one another.
    Sensor,
}

/// A gross error of the build.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Wiring {
    /// Of one rotor.
    Single,
    /// Of two rotors.
    Pair {
        /// The parameter that holds the number of the other rotor.
        partner: &'static str,
    },
}

/// What a log must hold for an effect to be considered.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Requirement {
    /// Duty of every rotor: with measured rotor speeds or a commanded wrench nothing of Eq. 19 shows.
    Duty,
    /// Duty of every rotor or a commanded wrench: measured rotor speeds show neither delay nor lag nor wiring.
    Command,
    /// Samples of the command no further apart than the lag of the rotors, if a command drives them: from samples further apart, even at
    /// a faster rate of rows, no lag or age can be told.
    FrequentCommand,
    /// Height above ground.
    HeightAboveGround,
    /// Position.
    Position,
    /// Velocity and attitude, from which the air velocity in body axes follows.
    AirVelocity,
    /// Battery voltage.
    BatteryVoltage,
}

impl Requirement {
    /// In words.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Duty => "duty of every rotor",
            Self::Command => "duty of every rotor or commanded wrench",
            Self::FrequentCommand => "commands sampled at least once in each lag of the rotors",
            Self::HeightAboveGround => "height above ground",
            Self::Position => "position",
            Self::AirVelocity => "velocity and attitude",
            Self::BatteryVoltage => "battery voltage",
        }
    }
}

/// How an effect changes the rotors' mean commanded thrusts: the hypotheses of a comparison with healthy flights.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TrimChange {
    /// The thrust of one rotor at its command.
    RotorThrust,
    /// The weight.
    Weight,
    /// The place of the centre of mass.
    Balance,
}

/// What rows of a log leave open of an effect: what the command did between two of them is not in the log.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum BetweenRows {
    /// Nothing.
    Nothing,
    /// Of a relative error of a lag τ this share of τ, times (h/τ)² with rows h apart.
    OfLag(f64),
    /// Of a time this share of h.
    OfRow(f64),
}

impl BetweenRows {
    /// Half of a 95 % interval, at a value, with rows so far apart and a lag of the vehicle, s.
    pub fn half_width(self, value: f64, step_s: f64, lag_s: f64) -> f64 {
        match self {
            Self::Nothing => 0.0,
            Self::OfLag(share) => {
                let ratio = step_s / (lag_s * (1.0 + value));
                share * (1.0 + value) * ratio * ratio
            }
            Self::OfRow(share) => share * step_s,
        }
    }
}

/// How a diagnosis searches for an effect, and what it requires.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Search {
    /// What its fits start from.
    pub strategy: Strategy,
    /// What a log must hold, all of it.
    pub requires: &'static [Requirement],
    /// What it changes of the mean thrusts, if it is one of the hypotheses of a comparison with healthy flights.
    pub trim: Option<TrimChange>,
    /// Its influence grows in proportion to the time since its onset, as with a constant leak rate.
    pub grows: bool,
    /// Share of its size that no log determines, however long: an approximation error of the twin. Half of a 95 %
    /// interval.
    pub blur: f64,
    /// Effects that one mistake brings along with it: the first of them, the first two, … are tried at once with this one. One by one they
    /// may lose to an effect that resembles all of them.
    pub along: &'static [&'static str],
    /// Effects of constants against which alone a flight determines this one: it is not looked for where one of them is a guess.
    pub unless_guessed: &'static [&'static str],
    /// What the rows of a log leave open of its first parameter.
    pub between_rows: BetweenRows,
    /// It is the steady wind: where each flight has a wind of its own, fitted as a nuisance, that takes its place. One effect of the
    /// catalogue declares this.
    pub is_steady_wind: bool,
}

impl Search {
    /// From the linear estimate; requires nothing but a channel in which the effect shows.
    pub const LINEAR: Self = Self::by(Strategy::Linear);

    /// By a strategy; requires nothing but a channel in which the effect shows.
    pub const fn by(strategy: Strategy) -> Self {
        Self {
            strategy,
            requires: &[],
            trim: None,
            grows: false,
            blur: 0.0,
            along: &[],
            unless_guessed: &[],
            between_rows: BetweenRows::Nothing,
            is_steady_wind: false,
        }
    }

    /// The same where a log holds all of this.
    pub const fn requiring(mut self, requires: &'static [Requirement]) -> Self {
        self.requires = requires;
        self
    }

    /// The same for an effect that grows in proportion to the time since its onset.
    pub const fn growing(mut self) -> Self {
        self.grows = true;
        self
    }

    /// The same where a share of the size stays unknown in every log.
    pub const fn blurred(mut self, share: f64) -> Self {
        self.blur = share;
        self
    }

    /// The same, tried along with others as well.
    pub const fn along_with(mut self, others: &'static [&'static str]) -> Self {
        self.along = others;
        self
    }

    /// The same with a part of its interval that depends on how far apart rows are.
    pub const fn open_between_rows(mut self, open: BetweenRows) -> Self {
        self.between_rows = open;
        self
    }

    /// The same, unless a constant is a guess that one of these is the error of.
    pub const fn unless_guessed(mut self, others: &'static [&'static str]) -> Self {
        self.unless_guessed = others;
        self
    }

    /// The same for the steady wind.
    pub const fn of_the_steady_wind(mut self) -> Self {
        self.is_steady_wind = true;
        self
    }

    /// The same, and a hypothesis of a comparison with healthy flights.
    pub const fn in_trim(mut self, trim: TrimChange) -> Self {
        self.trim = Some(trim);
        self
    }
}
