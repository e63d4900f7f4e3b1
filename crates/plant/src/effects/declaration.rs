//! Declaration of an effect: equation, parameters with units and plausible sizes, channels, how to excite it.
//!
//! One declaration serves the simulator, the diagnosis, the command line and the documents.

use std::fmt;

use super::constants::Constants;
use super::hooks::ActiveEffect;
use super::search::Search;

/// Kinds of effects: physics is added to the model, a fault of sensor or timing is corrected in the log.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum EffectClass {
    /// Dynamics that the nominal model lacks.
    Physics,
    /// A sensor whose readings differ from the truth.
    SensorFault,
    /// A channel of the log that is late.
    TimingFault,
    /// Always present and fitted with every flight; never a finding.
    Nuisance,
    /// Random forcing: its draws cannot be predicted from a log, its covariance can be compared.
    Noise,
}

impl EffectClass {
    /// As written in documents.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Physics => "physics",
            Self::SensorFault => "sensor-fault",
            Self::TimingFault => "timing-fault",
            Self::Nuisance => "nuisance",
            Self::Noise => "noise",
        }
    }
}

/// Where in the chain from command to reading an effect acts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Place {
    /// Duty on its way to the rotor.
    Command,
    /// Static lift (Eq. 19), before the lag.
    StaticLift,
    /// The lag from static lift to thrust.
    RotorDynamics,
    /// Thrust that acts on the body.
    RotorThrust,
    /// Force on the body.
    Force,
    /// Torque on the body.
    Torque,
    /// Mass, inertia, centre of mass, geometry.
    MassProperties,
    /// The air around the vehicle.
    Wind,
    /// Battery.
    Battery,
    /// The value of a sensor.
    Reading,
    /// The timing of a sensor.
    Timing,
}

impl Place {
    /// As written in documents.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Command => "command",
            Self::StaticLift => "static-lift",
            Self::RotorDynamics => "rotor-dynamics",
            Self::RotorThrust => "rotor-thrust",
            Self::Force => "force",
            Self::Torque => "torque",
            Self::MassProperties => "mass-properties",
            Self::Wind => "wind",
            Self::Battery => "battery",
            Self::Reading => "reading",
            Self::Timing => "timing",
        }
    }
}

/// Groups of the residual channels in which an effect shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum ChannelGroup {
    /// F: accelerometer against the force of the model.
    Force,
    /// M: angular acceleration against the torque of the model.
    Moment,
    /// KV: derivative of the velocity against accelerometer and attitude.
    VelocityKinematics,
    /// KA: derivative of the attitude against the gyroscope.
    AttitudeKinematics,
    /// KP: derivative of the position against the velocity.
    PositionKinematics,
    /// V: battery voltage.
    Voltage,
}

impl ChannelGroup {
    /// Every group, in the order of the channels.
    pub const ALL: [Self; 6] = [
        Self::Force,
        Self::Moment,
        Self::VelocityKinematics,
        Self::AttitudeKinematics,
        Self::PositionKinematics,
        Self::Voltage,
    ];

    /// Short symbol: F, M, KV, KA, KP, V.
    pub fn symbol(self) -> &'static str {
        match self {
            Self::Force => "F",
            Self::Moment => "M",
            Self::VelocityKinematics => "KV",
            Self::AttitudeKinematics => "KA",
            Self::PositionKinematics => "KP",
            Self::Voltage => "V",
        }
    }
}

/// What a parameter does when it is 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum ParameterKind {
    /// How large the effect is: with every size at 0 there is no effect, bit for bit. Absent in a document: 0.
    Size,
    /// How the effect looks (a length, a time constant, a place): a flight does not determine it without a size. Absent in a
    /// document: its typical value.
    Shape,
}

/// One parameter of an effect. The neutral value of a size is always 0.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct ParameterDeclaration {
    /// Key in documents, with the unit: `drag_n_s_m`.
    pub name: &'static str,
    /// Letter in the equation.
    pub symbol: &'static str,
    /// Unit shown to people; empty for fractions.
    pub unit: &'static str,
    /// What it is.
    pub meaning: &'static str,
    /// Size or shape.
    pub kind: ParameterKind,
    /// Lowest value found on real vehicles.
    pub plausible_low: f64,
    /// Highest value found on real vehicles.
    pub plausible_high: f64,
    /// Plausible size: standard deviation of the slab of the prior.
    pub size: f64,
    /// Standard deviation of the spike of the prior: deviations that every real vehicle has.
    pub clutter: f64,
    /// Value of an ordinary case, for examples and tests.
    pub typical: f64,
    /// The constant of the vehicle document that this parameter is an error of, if it is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub corrects: Option<Correction>,
    /// How much parts that were bought as the same differ in it, if its sizes mean something to somebody who holds the part.
    #[serde(skip)]
    pub tolerance: Option<Tolerance>,
    /// A size without which the others are another effect: a load that does not swing is a mass.
    #[serde(skip)]
    pub is_essential: bool,
}

/// What a size says about a part: within the tolerance it was made with, below it, or above it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tolerance {
    /// Largest deviation among parts of one batch, either way, in the unit of the parameter.
    pub usual: f64,
    /// Said of a size that may be within.
    pub within: &'static str,
    /// Said of a size that is below for certain, or that sets in below 0: nothing changes its tolerance in flight.
    pub below: &'static str,
    /// Said of a size that is above for certain, or that sets in above 0.
    pub above: &'static str,
    /// Under which condition the interval of a size from the start holds.
    pub condition: &'static str,
}

impl Tolerance {
    /// What is said of a size with half of its 95 % interval.
    ///
    /// * `sets_in`: the size was 0 at the start of the flight
    pub fn words(&self, size: f64, half_width: f64, sets_in: bool) -> String {
        let meaning = if !sets_in && size.abs() - half_width <= self.usual {
            self.within
        } else if size < 0.0 {
            self.below
        } else {
            self.above
        };
        // What the others differ by cancels in a change.
        if sets_in {
            meaning.to_owned()
        } else {
            format!("{meaning}; {}", self.condition)
        }
    }
}

/// A parameter as the error of a constant of the vehicle document: how well the constant is known is how large the parameter may be
/// without anything being missing.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Correction {
    /// Key of the constant, as an identified vehicle lists its intervals: `body.mass_kg`.
    pub key: &'static str,
    /// How the parameter counts.
    pub scale: CorrectionScale,
    /// Vehicle files are often wrong about the constant by a factor, not by per cents: an inertia taken from another
    /// frame, a lag that was never measured, the thrust curve of another propeller. Such an error is not missing
    /// physics but a constant to calibrate.
    #[serde(skip)]
    pub by_factors: bool,
}

/// How a parameter counts the error of a constant.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum CorrectionScale {
    /// (true − written)/written.
    Share,
    /// true − written, in the unit of the constant.
    Difference,
    /// The constant itself: the vehicle document has no place for it and takes it as 0.
    Whole,
}

/// Share of the plausible size that counts as clutter.
const CLUTTER_SHARE: f64 = 0.02;

impl ParameterDeclaration {
    /// A size with the clutter of 2 %. `range` is the plausible range, `size` the slab.
    pub const fn size(
        name: &'static str,
        symbol: &'static str,
        unit: &'static str,
        meaning: &'static str,
        range: (f64, f64),
        size: f64,
        typical: f64,
    ) -> Self {
        Self {
            name,
            symbol,
            unit,
            meaning,
            kind: ParameterKind::Size,
            plausible_low: range.0,
            plausible_high: range.1,
            size,
            clutter: CLUTTER_SHARE * size,
            typical,
            corrects: None,
            tolerance: None,
            is_essential: false,
        }
    }

    /// A size that is an error of a constant of the vehicle document.
    pub const fn correcting(mut self, key: &'static str, scale: CorrectionScale) -> Self {
        self.corrects = Some(Correction {
            key,
            scale,
            by_factors: false,
        });
        self
    }

    /// The same for a share of a constant that files are wrong about by factors.
    pub const fn correcting_by_factors(mut self, key: &'static str) -> Self {
        self.corrects = Some(Correction {
            key,
            scale: CorrectionScale::Share,
            by_factors: true,
        });
        self
    }

    /// A size whose meaning depends on what parts differ by as they are sold.
    pub const fn with_tolerance(mut self, tolerance: Tolerance) -> Self {
        self.tolerance = Some(tolerance);
        self
    }

    /// A size without which the others are another effect.
    pub const fn essential(mut self) -> Self {
        self.is_essential = true;
        self
    }

    /// A size with another clutter: timing errors of 1 ms to 2 ms are in every log.
    pub const fn with_clutter(mut self, clutter: f64) -> Self {
        self.clutter = clutter;
        self
    }

    /// A shape; its slab is half its plausible range and it has no clutter of its own.
    pub const fn shape(
        name: &'static str,
        symbol: &'static str,
        unit: &'static str,
        meaning: &'static str,
        range: (f64, f64),
        typical: f64,
    ) -> Self {
        Self {
            name,
            symbol,
            unit,
            meaning,
            kind: ParameterKind::Shape,
            plausible_low: range.0,
            plausible_high: range.1,
            size: 0.5 * (range.1 - range.0),
            clutter: 0.0,
            typical,
            corrects: None,
            tolerance: None,
            is_essential: false,
        }
    }

    /// What an absent key means.
    pub fn default_value(&self) -> f64 {
        match self.kind {
            ParameterKind::Size => 0.0,
            ParameterKind::Shape => self.typical,
        }
    }
}

/// What an effect is built from.
#[derive(Debug, Clone, Copy)]
pub struct Setup<'a> {
    /// Parameters in the order of the declaration, defaults filled in.
    pub values: &'a [f64],
    /// Rotor from 0 of an effect of one rotor; 0 otherwise.
    pub rotor: usize,
    /// The nominal vehicle.
    pub nominal: &'a Constants,
    /// Seed of the run, for effects that draw.
    pub seed: u64,
    /// Place of the effect in its list, so that two of a kind draw different numbers.
    pub index: usize,
}

/// How the physics of a declaration is made.
#[derive(Clone, Copy)]
pub enum Build {
    /// In this crate.
    BuiltIn(fn(&Setup<'_>) -> Box<dyn ActiveEffect>),
    /// From an effect document.
    User(&'static (dyn Fn(&Setup<'_>) -> Box<dyn ActiveEffect> + Send + Sync)),
}

impl fmt::Debug for Build {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str(match self {
            Self::BuiltIn(_) => "BuiltIn",
            Self::User(_) => "User",
        })
    }
}

/// One entry of the catalogue.
#[derive(Debug, Clone, Copy, serde::Serialize)]
pub struct EffectDeclaration {
    /// Key in documents: `rotor-drag`.
    pub id: &'static str,
    /// Readable name.
    pub name: &'static str,
    /// Row of the catalogue of effects, from 1; absent for effects of users.
    pub catalogue_number: Option<u8>,
    /// Physics, or a fault of the log.
    pub class: EffectClass,
    /// Equation in the symbols of the parameters.
    pub equation: &'static str,
    /// Where it acts.
    pub places: &'static [Place],
    /// Where it shows.
    pub channels: &'static [ChannelGroup],
    /// Parameters; an effect with two sizes has both or neither.
    pub parameters: &'static [ParameterDeclaration],
    /// Each instance belongs to one rotor.
    pub per_rotor: bool,
    /// It can begin in mid-flight, as a broken blade or a wind does; a resistance, a density or an inertia is there from the start.
    pub may_set_in: bool,
    /// Effects of which one must be there for this one to act: wind acts through drag.
    pub needs: &'static [&'static str],
    /// How a diagnosis searches for it, and what that requires of a log.
    #[serde(skip)]
    pub search: Search,
    /// What a flight must contain for the effect to show.
    pub excited_by: &'static str,
    /// Ids of effects with a similar signature.
    pub confused_with: &'static [&'static str],
    /// Source of the equation and the sizes.
    pub source: &'static str,
    /// Makes the physics.
    #[serde(skip)]
    pub build: Build,
}

impl EffectDeclaration {
    /// Place of a parameter in [`EffectDeclaration::parameters`].
    pub fn parameter_index(&self, name: &str) -> Option<usize> {
        self.parameters.iter().position(|p| p.name == name)
    }

    /// The physics with these parameters.
    pub fn build(&self, setup: &Setup<'_>) -> Box<dyn ActiveEffect> {
        match self.build {
            Build::BuiltIn(build) => build(setup),
            Build::User(build) => build(setup),
        }
    }
}
