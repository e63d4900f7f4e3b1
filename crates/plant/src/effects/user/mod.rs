//! Effects of users: a TOML document with parameters and expressions instead of code.
//!
//! ```toml
//! id = "fin-drag"
//! name = "Drag of a vertical fin"
//! excited_by = "sideways flight"
//! [[parameter]]
//! name = "drag_kg_m"
//! unit = "kg/m"
//! meaning = "drag per squared air speed"
//! low = 0.0
//! high = 0.1
//! size = 0.02
//! typical = 0.02
//! [[term]]
//! place = "force_y"
//! expression = "-drag_kg_m * air_velocity_y * abs(air_velocity_y)"
//! ```
//!
//! The unit of each expression must be that of its place. An effect read this way is an entry of a [`super::Catalogue`] like any
//! other. Limits: no states of its own, no random numbers.

mod expression;
mod units;
mod variables;

use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

use serde::{Deserialize, Serialize};

use self::expression::{Program, Symbol};
use self::units::Dimension;
use self::variables::Variable;
use super::catalogue::catalogue;
use super::declaration::{
    Build, ChannelGroup, EffectClass, EffectDeclaration, ParameterDeclaration, ParameterKind, Place, Setup,
};
use super::hooks::{ActiveEffect, Hooks, Moment};
use super::readings::Readings;
use super::search::{Requirement, Search, Shapes, Strategy};
use super::wrench::Wrench;
use crate::error::{Refusal, in_range};
use crate::vector::Vector3;

/// Parameters and terms of one effect at most.
const MOST: usize = 32;
/// Declarations live as long as the process: a server that is sent one after the other must not grow without bound.
const MOST_KNOWN: usize = 10_000;

/// An effect document.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EffectDocument {
    /// Key in scenarios and models: small letters, digits, hyphens.
    pub id: String,
    /// Readable name.
    pub name: String,
    /// What a flight must contain for the effect to show.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub excited_by: String,
    /// Ids of effects with a similar signature.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub confused_with: Vec<String>,
    /// Source of the equation and the sizes.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub source: String,
    /// True if one instance belongs to one rotor.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub per_rotor: bool,
    /// Parameters.
    pub parameter: Vec<ParameterEntry>,
    /// Where it acts, and how.
    pub term: Vec<TermEntry>,
}

/// `[[parameter]]` of an effect document.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ParameterEntry {
    /// Key in scenarios, and name in expressions.
    pub name: String,
    /// SI unit without prefix; absent or empty: none.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub unit: String,
    /// What it is.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub meaning: String,
    /// True for a shape: its typical value is the default; false for a size: neutral at 0.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub shape: bool,
    /// Lowest plausible value.
    pub low: f64,
    /// Highest plausible value.
    pub high: f64,
    /// Plausible size; half the range if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub size: Option<f64>,
    /// Typical value.
    pub typical: f64,
}

/// `[[term]]` of an effect document.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TermEntry {
    /// What the value is added to: `force_x`, `rotor_thrust`, `accelerometer_z`, …
    pub place: String,
    /// The value.
    pub expression: String,
}

/// What a term adds to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Target {
    Command,
    StaticLift,
    RotorThrust,
    Wind(usize),
    Force(usize),
    Torque(usize),
    Accelerometer(usize),
    Gyro(usize),
    Attitude(usize),
    Velocity(usize),
    Position(usize),
    Voltage,
}

const TARGETS: &[(&str, Target, Dimension)] = &[
    ("command", Target::Command, Dimension::NONE),
    ("static_lift", Target::StaticLift, Dimension::FORCE),
    ("rotor_thrust", Target::RotorThrust, Dimension::FORCE),
    ("wind_north", Target::Wind(0), Dimension::VELOCITY),
    ("wind_east", Target::Wind(1), Dimension::VELOCITY),
    ("wind_down", Target::Wind(2), Dimension::VELOCITY),
    ("force_x", Target::Force(0), Dimension::FORCE),
    ("force_y", Target::Force(1), Dimension::FORCE),
    ("force_z", Target::Force(2), Dimension::FORCE),
    ("torque_x", Target::Torque(0), Dimension::TORQUE),
    ("torque_y", Target::Torque(1), Dimension::TORQUE),
    ("torque_z", Target::Torque(2), Dimension::TORQUE),
    ("accelerometer_x", Target::Accelerometer(0), Dimension::ACCELERATION),
    ("accelerometer_y", Target::Accelerometer(1), Dimension::ACCELERATION),
    ("accelerometer_z", Target::Accelerometer(2), Dimension::ACCELERATION),
    ("gyro_x", Target::Gyro(0), Dimension::RATE),
    ("gyro_y", Target::Gyro(1), Dimension::RATE),
    ("gyro_z", Target::Gyro(2), Dimension::RATE),
    ("roll", Target::Attitude(0), Dimension::NONE),
    ("pitch", Target::Attitude(1), Dimension::NONE),
    ("yaw", Target::Attitude(2), Dimension::NONE),
    ("velocity_north", Target::Velocity(0), Dimension::VELOCITY),
    ("velocity_east", Target::Velocity(1), Dimension::VELOCITY),
    ("velocity_down", Target::Velocity(2), Dimension::VELOCITY),
    ("position_north", Target::Position(0), Dimension::LENGTH),
    ("position_east", Target::Position(1), Dimension::LENGTH),
    ("position_down", Target::Position(2), Dimension::LENGTH),
    ("voltage", Target::Voltage, Dimension::VOLTAGE),
];

impl Target {
    /// Hook, place and channels of the target.
    fn declared(self) -> (Hooks, Place, &'static [ChannelGroup]) {
        use ChannelGroup::{
            AttitudeKinematics as KA, Force as F, Moment as M, PositionKinematics as KP, VelocityKinematics as KV,
            Voltage as V,
        };
        match self {
            Self::Command => (Hooks::COMMAND, Place::Command, &[F, M, V]),
            Self::StaticLift => (Hooks::STATIC_LIFT, Place::StaticLift, &[F, M, V]),
            Self::RotorThrust => (Hooks::ROTOR_THRUST, Place::RotorThrust, &[F, M]),
            Self::Wind(_) => (Hooks::WIND, Place::Wind, &[F]),
            Self::Force(_) => (Hooks::WRENCH, Place::Force, &[F]),
            Self::Torque(_) => (Hooks::WRENCH, Place::Torque, &[M]),
            Self::Accelerometer(_) => (Hooks::READINGS, Place::Reading, &[F, KV]),
            Self::Gyro(_) => (Hooks::READINGS, Place::Reading, &[M, KA]),
            Self::Attitude(_) => (Hooks::READINGS, Place::Reading, &[KV, KA]),
            Self::Velocity(_) => (Hooks::READINGS, Place::Reading, &[KV, KP]),
            Self::Position(_) => (Hooks::READINGS, Place::Reading, &[KP]),
            Self::Voltage => (Hooks::READINGS, Place::Reading, &[F, M, V]),
        }
    }

    fn per_rotor(self) -> bool {
        matches!(self, Self::Command | Self::StaticLift | Self::RotorThrust)
    }
}

/// A checked and compiled effect of a user.
#[derive(Debug)]
struct UserEffect {
    terms: Vec<(Target, Program)>,
    hooks: Hooks,
    per_rotor: bool,
}

#[derive(Debug, Clone)]
struct Active {
    effect: &'static UserEffect,
    values: Vec<f64>,
    /// The rotor of an effect of one rotor.
    rotor: Option<usize>,
}

impl Active {
    /// The physics of `effect` with these parameters.
    fn boxed(effect: &'static UserEffect, setup: &Setup<'_>) -> Box<dyn ActiveEffect> {
        Box::new(Self {
            effect,
            values: setup.values.to_vec(),
            rotor: effect.per_rotor.then_some(setup.rotor),
        })
    }

    /// Calls `add` with target and value of every term that `wanted` takes and that is not of single rotors.
    #[inline]
    fn each(&self, at: &Moment<'_>, wanted: fn(Target) -> bool, mut add: impl FnMut(Target, f64)) {
        for (target, program) in &self.effect.terms {
            if wanted(*target) {
                let rotor = self.rotor.unwrap_or(0);
                add(*target, program.value(&self.values, |name| name.value(at, rotor)));
            }
        }
    }

    #[inline]
    fn each_rotor(&self, at: &Moment<'_>, wanted: Target, sum: &mut [f64]) {
        for (target, program) in &self.effect.terms {
            if *target != wanted {
                continue;
            }
            let rotors = match self.rotor {
                Some(rotor) => rotor..(rotor + 1).min(sum.len()),
                None => 0..sum.len(),
            };
            for rotor in rotors {
                sum[rotor] += program.value(&self.values, |name| name.value(at, rotor));
            }
        }
    }
}

impl ActiveEffect for Active {
    fn hooks(&self) -> Hooks {
        self.effect.hooks
    }

    fn boxed_clone(&self) -> Box<dyn ActiveEffect> {
        Box::new(self.clone())
    }

    fn wind(&mut self, at: &Moment<'_>, wind_ned: &mut Vector3) {
        let wanted = |target| matches!(target, Target::Wind(_));
        self.each(at, wanted, |target, value| {
            if let Target::Wind(axis) = target {
                wind_ned[axis] += value;
            }
        });
    }

    fn command(&mut self, at: &Moment<'_>, duty: &mut [f64]) {
        self.each_rotor(at, Target::Command, duty);
    }

    fn static_lift(&mut self, at: &Moment<'_>, lift: &mut [f64]) {
        self.each_rotor(at, Target::StaticLift, lift);
    }

    fn rotor_thrust(&mut self, at: &Moment<'_>, thrust: &mut [f64]) {
        self.each_rotor(at, Target::RotorThrust, thrust);
    }

    fn wrench(&mut self, at: &Moment<'_>, wrench: &mut Wrench) {
        let wanted = |target| matches!(target, Target::Force(_) | Target::Torque(_));
        self.each(at, wanted, |target, value| match target {
            Target::Force(axis) => wrench.force_body[axis] += value,
            Target::Torque(axis) => wrench.torque_body[axis] += value,
            _ => {}
        });
    }

    fn readings(&mut self, at: &Moment<'_>, readings: &mut Readings) {
        self.each(
            at,
            |_| true,
            |target, value| match target {
                Target::Accelerometer(axis) => readings.specific_force[axis] += value,
                Target::Gyro(axis) => readings.body_rates[axis] += value,
                Target::Attitude(axis) => readings.attitude[axis] += value,
                Target::Velocity(axis) => readings.velocity_ned[axis] += value,
                Target::Position(axis) => readings.position_ned[axis] += value,
                Target::Voltage => readings.battery_voltage += value,
                _ => {}
            },
        );
    }
}

impl EffectDocument {
    /// The declaration of this document. It lives as long as the process; the same document gives the same one.
    pub fn declaration(&self) -> Result<&'static EffectDeclaration, Refusal> {
        static KNOWN: Mutex<BTreeMap<String, &'static EffectDeclaration>> = Mutex::new(BTreeMap::new());
        // Debug writes numbers so that different ones have different texts.
        let text = format!("{self:?}");
        let mut known = KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(declaration) = known.get(&text) {
            return Ok(declaration);
        }
        if known.len() >= MOST_KNOWN {
            let reason = format!("this process has loaded {MOST_KNOWN} different effects, its limit: restart it");
            return Err(Refusal::new("id", reason));
        }
        let declaration: &'static EffectDeclaration = Box::leak(Box::new(self.compile()?));
        known.insert(text, declaration);
        Ok(declaration)
    }

    fn compile(&self) -> Result<EffectDeclaration, Refusal> {
        let good = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-';
        if self.id.len() > 64 || !self.id.starts_with(|c: char| c.is_ascii_lowercase()) || !self.id.chars().all(good) {
            let reason = format!(
                "expected an id of small letters, digits and '-' that begins with a letter, got {:?}",
                self.id
            );
            return Err(Refusal::new("id", reason));
        }
        if catalogue().iter().any(|entry| entry.id == self.id) {
            let reason = format!("`{}` is the id of a built-in effect: expected another", self.id);
            return Err(Refusal::new("id", reason));
        }
        for (key, count) in [("parameter", self.parameter.len()), ("term", self.term.len())] {
            if !(1..=MOST).contains(&count) {
                return Err(Refusal::new(key, format!("expected 1 to {MOST} of them, got {count}")));
            }
        }
        let mut symbols = Vec::new();
        for (i, entry) in self.parameter.iter().enumerate() {
            let dimension = self
                .check_parameter(i, entry)
                .map_err(|r| r.under(&format!("parameter[{i}]")))?;
            symbols.push(Symbol {
                name: &entry.name,
                dimension,
            });
        }
        if self.parameter.iter().all(|p| p.shape) {
            return Err(Refusal::new(
                "parameter",
                "expected at least one size: a parameter that is neutral at 0",
            ));
        }
        let mut terms = Vec::new();
        for (i, entry) in self.term.iter().enumerate() {
            terms.push(
                self.check_term(entry, &symbols)
                    .map_err(|r| r.under(&format!("term[{i}]")))?,
            );
        }
        if let Some(i) = (0..symbols.len()).find(|&i| !terms.iter().any(|(_, program)| program.uses_parameter(i))) {
            let reason = format!("`{}` is used by no expression", symbols[i].name);
            return Err(Refusal::new(format!("parameter[{i}].name"), reason));
        }
        Ok(self.declare(terms))
    }

    fn check_parameter(&self, index: usize, entry: &ParameterEntry) -> Result<Dimension, Refusal> {
        let good = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_';
        let name = &entry.name;
        if name.len() > 64 || !name.starts_with(|c: char| c.is_ascii_lowercase()) || !name.chars().all(good) {
            let reason =
                format!("expected a name of small letters, digits and '_' that begins with a letter, got {name:?}");
            return Err(Refusal::new("name", reason));
        }
        if Variable::named(name).is_some() || self.parameter[..index].iter().any(|other| other.name == *name) {
            return Err(Refusal::new("name", format!("`{name}` is taken already")));
        }
        let dimension = Dimension::parse(&entry.unit).map_err(|reason| Refusal::new("unit", reason))?;
        in_range("low", entry.low, -1e12, 1e12, "")?;
        in_range("high", entry.high, -1e12, 1e12, "")?;
        if entry.low >= entry.high {
            let reason = format!("expected a value above `low` = {}, got {}", entry.low, entry.high);
            return Err(Refusal::new("high", reason));
        }
        in_range("typical", entry.typical, entry.low, entry.high, "")?;
        let neutral_at_zero = entry.low <= 0.0 && entry.high >= 0.0 && entry.typical != 0.0;
        if !(entry.shape || neutral_at_zero) {
            let reason = "expected a range that contains 0 and a typical value other than 0: a size is neutral at 0";
            return Err(Refusal::new("typical", reason));
        }
        if let Some(size) = entry.size {
            in_range("size", size, 1e-12, 1e12, "")?;
        }
        Ok(dimension)
    }

    fn check_term(&self, entry: &TermEntry, symbols: &[Symbol<'_>]) -> Result<(Target, Program), Refusal> {
        let Some(&(_, target, dimension)) = TARGETS.iter().find(|(name, ..)| *name == entry.place) else {
            let names = TARGETS.iter().map(|(name, ..)| *name).collect::<Vec<_>>().join(", ");
            return Err(Refusal::new(
                "place",
                format!("expected one of {names}, got `{}`", entry.place),
            ));
        };
        let program = Program::compile(&entry.expression, symbols, dimension).map_err(|error| {
            let reason = format!("at column {} of the expression: {}", error.column, error.reason);
            Refusal::new("expression", reason)
        })?;
        if program.per_rotor() && !target.per_rotor() && !self.per_rotor {
            let variable = program.variables().find(|v| v.per_rotor());
            let reason = format!(
                "{variable:?} differs from rotor to rotor: expected a place of each rotor (command, static_lift, rotor_thrust), or \
                 per_rotor = true"
            );
            return Err(Refusal::new("expression", reason));
        }
        // Sizes of 0 must mean nothing, whatever the vehicle does.
        let neutral: Vec<f64> = self
            .parameter
            .iter()
            .map(|p| if p.shape { p.typical } else { 0.0 })
            .collect();
        for draw in 1..=8_u32 {
            let value = program.value(&neutral, |name| {
                let spread = libm::sin(f64::from(draw) * (1.0 + f64::from(name as u32)));
                if name.dimension() == Dimension::NONE {
                    spread
                } else {
                    5.0 * spread
                }
            });
            if value != 0.0 {
                let reason = format!(
                    "expected 0 where every size is 0, got {value}: a term must be multiplied by a size, and finite"
                );
                return Err(Refusal::new("expression", reason));
            }
        }
        Ok((target, program))
    }

    fn declare(&self, terms: Vec<(Target, Program)>) -> EffectDeclaration {
        let text = |text: &str| -> &'static str { Box::leak(text.to_owned().into_boxed_str()) };
        let (mut hooks, mut places, mut channels) = (Hooks::NONE, Vec::new(), Vec::new());
        for (target, _) in &terms {
            let (hook, place, groups) = target.declared();
            hooks = hooks.and(hook);
            places.push(place);
            channels.extend(groups);
        }
        places.dedup();
        channels.sort_unstable();
        channels.dedup();
        let equation = |t: &TermEntry| format!("{} += {}", t.place, t.expression);
        let parameters: Vec<ParameterDeclaration> = self
            .parameter
            .iter()
            .map(|p| {
                let (name, unit, meaning, range) = (text(&p.name), text(&p.unit), text(&p.meaning), (p.low, p.high));
                let size = p.size.unwrap_or(0.5 * (p.high - p.low));
                let mut declared = ParameterDeclaration::size(name, name, unit, meaning, range, size, p.typical);
                if p.shape {
                    declared.kind = ParameterKind::Shape;
                    declared.clutter = 0.0;
                }
                declared
            })
            .collect();
        let reads_only = terms.iter().all(|(target, _)| target.declared().1 == Place::Reading);
        let confused: Vec<&'static str> = self.confused_with.iter().map(|id| text(id)).collect();
        let wind = places.contains(&Place::Wind);
        let search = search(&terms, &parameters);
        let effect: &'static UserEffect = Box::leak(Box::new(UserEffect {
            terms,
            hooks,
            per_rotor: self.per_rotor,
        }));
        EffectDeclaration {
            id: text(&self.id),
            name: text(&self.name),
            catalogue_number: None,
            class: if reads_only {
                EffectClass::SensorFault
            } else {
                EffectClass::Physics
            },
            equation: text(&self.term.iter().map(equation).collect::<Vec<_>>().join(",   ")),
            places: Box::leak(places.into_boxed_slice()),
            channels: Box::leak(channels.into_boxed_slice()),
            parameters: Box::leak(parameters.into_boxed_slice()),
            per_rotor: self.per_rotor,
            may_set_in: true,
            needs: if wind {
                &["rotor-drag", "quadratic-drag", "linear-friction"]
            } else {
                &[]
            },
            search,
            excited_by: text(&self.excited_by),
            confused_with: Box::leak(confused.into_boxed_slice()),
            source: text(&self.source),
            build: Build::User(Box::leak(Box::new(move |setup: &Setup<'_>| {
                Active::boxed(effect, setup)
            }))),
        }
    }
}

/// A grid over the range of every shape that has one in geometric steps; the inputs of every term are required, because
/// otherwise another term would show without them.
fn search(terms: &[(Target, Program)], parameters: &[ParameterDeclaration]) -> Search {
    let ranges: Vec<&'static str> = parameters
        .iter()
        .filter(|p| p.kind == ParameterKind::Shape && p.plausible_low > 0.0)
        .map(|p| p.name)
        .collect();
    let strategy = if ranges.is_empty() {
        Strategy::Linear
    } else {
        Strategy::Shapes(Shapes::Range(Box::leak(ranges.into_boxed_slice())))
    };
    let of_all: Vec<Requirement> = [
        Requirement::HeightAboveGround,
        Requirement::Position,
        Requirement::AirVelocity,
        Requirement::BatteryVoltage,
    ]
    .into_iter()
    .filter(|wanted| {
        terms
            .iter()
            .all(|(_, program)| program.variables().any(|v| v.requirement() == Some(*wanted)))
    })
    .collect();
    Search::by(strategy).requiring(Box::leak(of_all.into_boxed_slice()))
}

/// Variables that expressions can read: name, unit, meaning.
pub fn expression_variables() -> impl Iterator<Item = (&'static str, String, &'static str)> {
    Variable::ALL
        .iter()
        .map(|(name, dimension, meaning)| (*name, dimension.to_string(), *meaning))
}

/// Places that terms can act on: name and unit.
pub fn expression_places() -> impl Iterator<Item = (&'static str, String)> {
    TARGETS
        .iter()
        .map(|(name, _, dimension)| (*name, dimension.to_string()))
}

/// Unit of the factor c that makes `c * expression` fit a place: `N·s/m` for `force_x` and `air_velocity_x`; empty if it has none.
///
/// # Errors
/// No such place, or no expression of the variables.
pub fn factor_unit(place: &str, expression: &str) -> Result<String, Refusal> {
    let names = || TARGETS.iter().map(|(name, ..)| *name).collect::<Vec<_>>().join(", ");
    let (_, _, of_place) = TARGETS
        .iter()
        .find(|(name, ..)| *name == place)
        .ok_or_else(|| Refusal::new("place", format!("expected one of {}, got `{place}`", names())))?;
    let dimension = expression::dimension(expression).map_err(|error| {
        let reason = format!("at column {} of the expression: {}", error.column, error.reason);
        Refusal::new("expression", reason)
    })?;
    let unit = of_place.per(dimension);
    Ok(if unit == Dimension::NONE {
        String::new()
    } else {
        unit.to_string()
    })
}

#[cfg(test)]
mod tests;
