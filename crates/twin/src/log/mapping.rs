//! Which fields of a source become which canonical columns.
//!
//! A mapping is a TOML file, one per kind of source; the ones in `config/log-mappings` are built in. It is a list of rows:
//!
//! ```toml
//! [[column]]
//! to = "rates"                                  # a canonical column, a group of them, or a name of your own
//! from = "vehicle_angular_velocity:xyz[]"       # topic:field; several fields with commas; [] counts up; #1 = second instance
//! unit = "rad/s"                                # or several: the first one that the data allow
//! frame = "frd"                                 # frd flu (body), ned enu nwu (world), both for a quaternion: "enu-flu"
//! ```
//! Of several rows with the same `to` the first one whose fields are in the log wins: this is how a mapping survives
//! renamed topics. A user's mapping takes precedence over the built-in one, so it can override one row and leave the
//! rest. Canonical files have no built-in mapping; [`super::remap`] applies a user's mapping to their columns.

use super::sources::csv_table::Layout;
use super::units::{self, Dimension};
use super::{LogError, error, names};
use rotortwin_flight_core::MAX_ROTORS;
use serde::Deserialize;
use std::collections::BTreeSet;
use std::path::Path;

/// A mapping file.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct MappingFile {
    /// Kind of source that it is for.
    pub(crate) source: SourceName,
    /// Streams that may give the time base, best first; others only if none of these is there.
    #[serde(default)]
    pub(crate) base: Vec<String>,
    /// Recordings of ROS 2: beginnings of topic names that are taken before others of their type (`/drone2/`).
    #[serde(default)]
    pub(crate) topics: Vec<String>,
    /// Keep the fields that no row takes, as `topic.field`, of the stream that gives the time base.
    #[serde(default)]
    pub(crate) keep_rest: bool,
    /// Rows, best first.
    #[serde(default, rename = "column")]
    pub(crate) rows: Vec<Row>,
    /// Layout of the table, for `source = "csv"`.
    #[serde(default)]
    pub(crate) csv: Option<Layout>,
}

/// Sources with a mapping.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum SourceName {
    Px4Ulog,
    ArdupilotDataflash,
    CrazyflieUsdlog,
    Blackbox,
    /// CSV and Parquet: columns that do not contain what their names say.
    Canonical,
    MavlinkTlog,
    Ros2,
    RunMcap,
    /// A table of whatever columns: the mapping says how it is laid out.
    Csv,
}

impl SourceName {
    /// As a mapping writes it.
    fn as_str(self) -> &'static str {
        match self {
            Self::Px4Ulog => "px4-ulog",
            Self::ArdupilotDataflash => "ardupilot-dataflash",
            Self::CrazyflieUsdlog => "crazyflie-usdlog",
            Self::Blackbox => "blackbox",
            Self::Canonical => "canonical",
            Self::MavlinkTlog => "mavlink-tlog",
            Self::Ros2 => "ros2",
            Self::RunMcap => "run-mcap",
            Self::Csv => "csv",
        }
    }
}

/// One row.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Row {
    /// Canonical column, group, or a name of one's own.
    pub(crate) to: String,
    /// `topic:field,field`.
    pub(crate) from: String,
    /// Unit, or units in order of preference.
    #[serde(default = "one")]
    pub(crate) unit: Units,
    /// Several units: the unit in the same place as the one that another field of the message has.
    #[serde(default)]
    pub(crate) unit_as: Option<UnitAs>,
    /// Axes of the source.
    #[serde(default)]
    pub(crate) frame: Option<Frame>,
    /// Factor in addition to the unit: −1 reverses a sign.
    #[serde(default)]
    pub(crate) factor: Option<f64>,
    /// Duty only: the number in the source that means 0 (a parameter of the log, or a number).
    #[serde(default)]
    pub(crate) low: Option<Level>,
    /// Duty only: the number in the source that means 1.
    #[serde(default)]
    pub(crate) high: Option<Level>,
    /// Duty and rotor speed: for each rotor of the vehicle file, which field of the source it is, from 1.
    #[serde(default)]
    pub(crate) order: Option<Vec<usize>>,
    /// A field that must not be 0 for a sample to count.
    #[serde(default)]
    pub(crate) valid: Option<String>,
}

/// A field of the same message, with its possible units: those of a voltage can be distinguished by its size, those of
/// a current cannot.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct UnitAs {
    pub(crate) field: String,
    pub(crate) unit: Units,
}

/// One unit or several.
#[derive(Clone, Debug, Deserialize)]
#[serde(untagged)]
pub(crate) enum Units {
    One(String),
    Several(Vec<String>),
}

fn one() -> Units {
    Units::One("1".to_owned())
}

impl Units {
    pub(crate) fn list(&self) -> &[String] {
        match self {
            Self::One(unit) => std::slice::from_ref(unit),
            Self::Several(units) => units,
        }
    }
}

/// A number, or the first of several parameters that the log contains, with a number as the default.
#[derive(Clone, Debug, Deserialize)]
#[serde(untagged)]
pub(crate) enum Level {
    Number(f64),
    Parameter { parameter: Vec<String>, default: f64 },
}

/// Axes of a vector in the source.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Frame {
    /// Body forward, right, down.
    Frd,
    /// Body forward, left, up.
    Flu,
    /// World north, east, down.
    Ned,
    /// World east, north, up.
    Enu,
    /// World north, west, up.
    Nwu,
    /// Attitude from FRD to NED.
    NedFrd,
    /// Attitude from FLU to ENU.
    EnuFlu,
    /// Attitude from FLU to NWU.
    NwuFlu,
    /// Latitude, longitude (degrees), altitude (m).
    Geodetic,
}

impl Frame {
    /// As people write it.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Frd => "FRD",
            Self::Flu => "FLU",
            Self::Ned => "NED",
            Self::Enu => "ENU",
            Self::Nwu => "NWU",
            Self::NedFrd => "NED-FRD",
            Self::EnuFlu => "ENU-FLU",
            Self::NwuFlu => "NWU-FLU",
            Self::Geodetic => "geodetic",
        }
    }
}

impl MappingFile {
    /// Topics, messages and types that the rows name.
    pub(crate) fn places(&self) -> BTreeSet<&str> {
        self.rows.iter().filter_map(|row| Some(row.place()?.topic)).collect()
    }
}

/// Target of a row's `to`.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Target {
    /// Fixed columns, with the dimension of all of them.
    Columns(Vec<&'static str>, Dimension),
    /// `duty_1` … as many as there are.
    Duty,
    /// `rotor_speed_1_rad_s` … as many as there are.
    RotorSpeed,
    /// A custom name.
    Own(String),
}

impl Target {
    pub(crate) fn of(name: &str) -> Self {
        let canonical = |name: &str| -> Option<&'static str> {
            let groups: [&[&'static str]; 9] = [
                &names::POSITION,
                &names::VELOCITY,
                &names::ATTITUDE,
                &names::QUATERNION,
                &names::RATES,
                &names::ACCEL,
                &names::REFERENCE,
                &names::TORQUE_COMMAND,
                &[
                    names::BATTERY_VOLTAGE,
                    names::BATTERY_CURRENT,
                    names::HEIGHT_ABOVE_GROUND,
                    names::THRUST_COMMAND,
                ],
            ];
            groups.into_iter().flatten().copied().find(|known| *known == name)
        };
        match name {
            "position" => Self::Columns(names::POSITION.to_vec(), Dimension::Length),
            "velocity" => Self::Columns(names::VELOCITY.to_vec(), Dimension::Speed),
            "attitude" => Self::Columns(names::ATTITUDE.to_vec(), Dimension::Angle),
            "quaternion" => Self::Columns(names::QUATERNION.to_vec(), Dimension::One),
            "rates" => Self::Columns(names::RATES.to_vec(), Dimension::AngularRate),
            "accel" => Self::Columns(names::ACCEL.to_vec(), Dimension::Acceleration),
            "reference_position" => Self::Columns(names::REFERENCE[..3].to_vec(), Dimension::Length),
            "torque_command" => Self::Columns(names::TORQUE_COMMAND.to_vec(), Dimension::Torque),
            "duty" => Self::Duty,
            "rotor_speed" => Self::RotorSpeed,
            name => match canonical(name).and_then(|known| Some((known, units::dimension(known)?))) {
                Some((known, dimension)) => Self::Columns(vec![known], dimension),
                None => Self::Own(name.to_owned()),
            },
        }
    }

    /// Dimension that the units of the row must have; `None` for a custom name.
    fn dimension(&self) -> Option<Dimension> {
        match self {
            Self::Columns(_, dimension) => Some(*dimension),
            Self::Duty => Some(Dimension::One),
            Self::RotorSpeed => Some(Dimension::AngularRate),
            Self::Own(_) => None,
        }
    }
}

/// The fields of a row: topic, instance, field names (still with `[]`).
pub(crate) struct Place<'a> {
    pub(crate) topic: &'a str,
    pub(crate) instance: u16,
    pub(crate) fields: Vec<&'a str>,
}

impl Row {
    /// The row's `from` in parts; `None` for a row without a place.
    pub(crate) fn place(&self) -> Option<Place<'_>> {
        let (topic, fields) = self.from.split_once(':')?;
        let (topic, instance) = match topic.split_once('#') {
            Some((topic, instance)) => (topic, instance.parse().ok()?),
            None => (topic, 0),
        };
        let fields: Vec<&str> = fields
            .split(',')
            .map(str::trim)
            .filter(|field| !field.is_empty())
            .collect();
        (!topic.is_empty() && !fields.is_empty()).then_some(Place {
            topic,
            instance,
            fields,
        })
    }

    fn check(&self) -> Result<(), String> {
        if self.place().is_none() && self.from != "none" {
            return Err(format!(
                "from = \"{}\": expected \"topic:field\" or \"none\"",
                self.from
            ));
        }
        let target = Target::of(&self.to);
        for name in self.unit.list() {
            let (_, dimension) = units::unit(name)
                .ok_or_else(|| format!("unit = \"{name}\" is not known; known: {}", units::unit_names()))?;
            let geodetic = self.frame == Some(Frame::Geodetic);
            if target.dimension().is_some_and(|wanted| wanted != dimension) && !geodetic {
                return Err(format!("unit = \"{name}\" does not fit '{}'", self.to));
            }
        }
        if let Some(other) = &self.unit_as {
            if other.unit.list().len() != self.unit.list().len() {
                return Err("unit_as must have as many units as unit".to_owned());
            }
            for name in other.unit.list() {
                if units::unit(name).is_none() {
                    return Err(format!(
                        "unit_as: unit \"{name}\" is not known; known: {}",
                        units::unit_names()
                    ));
                }
            }
        }
        let frames: &[Frame] = match self.to.as_str() {
            "rates" | "accel" | "torque_command" => &[Frame::Frd, Frame::Flu],
            "velocity" | "reference_position" => &[Frame::Ned, Frame::Enu, Frame::Nwu],
            "position" => &[Frame::Ned, Frame::Enu, Frame::Nwu, Frame::Geodetic],
            "quaternion" | "attitude" => &[Frame::NedFrd, Frame::EnuFlu, Frame::NwuFlu],
            _ => &[],
        };
        let fits = self.frame.is_none_or(|frame| frames.contains(&frame));
        if !fits {
            return Err(format!("frame = {:?} does not fit '{}'", self.frame, self.to));
        }
        if let Some(order) = &self.order {
            if order.is_empty() || order.len() > MAX_ROTORS || order.contains(&0) {
                return Err("order must name fields of the source, from 1".to_owned());
            }
            if let Some((field, first, second)) = named_twice(order) {
                return Err(format!(
                    "order = {order:?} names field {field} for rotors {first} and {second}; expected another field for each rotor"
                ));
            }
        }
        // Two rotors with the same values are one rotor counted twice.
        if let Some(place) = self.place()
            && matches!(target, Target::Duty | Target::RotorSpeed)
            && let Some((field, first, second)) = named_twice(&place.fields)
        {
            return Err(format!(
                "from = \"{}\" names {field} in places {first} and {second}; expected another field for each rotor",
                self.from
            ));
        }
        Ok(())
    }
}

/// The first entry of a list that is in it before, with both places, from 1.
fn named_twice<T: PartialEq>(list: &[T]) -> Option<(&T, usize, usize)> {
    list.iter().enumerate().find_map(|(later, entry)| {
        let first = list[..later].iter().position(|known| known == entry)?;
        Some((entry, first + 1, later + 1))
    })
}

/// Two rows that read the duties, or the speeds, of different rotors from one field: both targets and the field.
fn rotors_of_one_field(rows: &[Row]) -> Option<(&str, &str, &str)> {
    for rotor_of in [names::duty_rotor, names::speed_rotor] {
        let of_a_rotor = |row: &&Row| row.place().is_some() && rotor_of(&row.to).is_some();
        let mut known: Vec<&Row> = Vec::new();
        for row in rows.iter().filter(of_a_rotor) {
            if let Some(other) = known.iter().find(|other| other.from == row.from && other.to != row.to) {
                return Some((&other.to, &row.to, &row.from));
            }
            known.push(row);
        }
    }
    None
}

/// Built-in mapping files.
const BUILT_IN: [(&str, &str); 7] = [
    (
        "px4-ulog.toml",
        include_str!("../../../../config/log-mappings/px4-ulog.toml"),
    ),
    (
        "ardupilot-dataflash.toml",
        include_str!("../../../../config/log-mappings/ardupilot-dataflash.toml"),
    ),
    (
        "crazyflie-usdlog.toml",
        include_str!("../../../../config/log-mappings/crazyflie-usdlog.toml"),
    ),
    (
        "blackbox.toml",
        include_str!("../../../../config/log-mappings/blackbox.toml"),
    ),
    (
        "mavlink-tlog.toml",
        include_str!("../../../../config/log-mappings/mavlink-tlog.toml"),
    ),
    ("ros2.toml", include_str!("../../../../config/log-mappings/ros2.toml")),
    (
        "run-mcap.toml",
        include_str!("../../../../config/log-mappings/run-mcap.toml"),
    ),
];

fn parse(path: &Path, text: &str) -> Result<MappingFile, LogError> {
    let mapping: MappingFile = toml::from_str(text).map_err(|bad| {
        let line = bad
            .span()
            .map_or(1, |span| 1 + text[..span.start.min(text.len())].matches('\n').count());
        LogError::format(path, format!("line {line}: {}", bad.message().replace('\n', " ")))
    })?;
    for (index, row) in mapping.rows.iter().enumerate() {
        row.check()
            .map_err(|reason| LogError::format(path, format!("column {} ('{}'): {reason}", index + 1, row.to)))?;
    }
    if let Some((first, second, from)) = rotors_of_one_field(&mapping.rows) {
        return Err(LogError::format(
            path,
            format!("'{first}' and '{second}' are both read from \"{from}\"; expected another field for each rotor"),
        ));
    }
    let fits = (mapping.source == SourceName::Csv) == mapping.csv.is_some();
    let layout = mapping.csv.as_ref().map_or(Ok(()), Layout::check);
    if !fits {
        return Err(LogError::format(
            path,
            "expected the table [csv] in a mapping with source = \"csv\", and in no other",
        ));
    }
    layout.map_err(|reason| LogError::format(path, reason))?;
    Ok(mapping)
}

/// A custom mapping for a canonical file, which has no built-in one.
pub(crate) fn load_for_canonical(path: &Path) -> Result<MappingFile, LogError> {
    let text = std::fs::read_to_string(path).map_err(error::io(path, "cannot read the mapping"))?;
    let mapping = parse(path, &text)?;
    if mapping.source == SourceName::Canonical {
        return Ok(mapping);
    }
    Err(LogError::format(
        path,
        format!(
            "the mapping is for source = \"{}\"; the columns of this log are canonical, expected source = \"canonical\"",
            mapping.source.as_str()
        ),
    ))
}

/// A user's mapping of a table of whatever columns; `None` if it is one of another source.
pub(crate) fn of_table(path: &Path) -> Result<Option<(MappingFile, Layout)>, LogError> {
    let text = std::fs::read_to_string(path).map_err(error::io(path, "cannot read the mapping"))?;
    let mapping = parse(path, &text)?;
    let layout = mapping.csv.clone();
    Ok(layout.map(|layout| (mapping, layout)))
}

/// A drafted mapping, checked as one that is read.
pub(crate) fn check_draft(text: &str) -> Result<(), LogError> {
    parse(Path::new("draft"), text).map(|_| ())
}

/// The mapping of a source: the user's rows first, then the built-in ones.
pub(crate) fn load(source: SourceName, user: Option<&Path>) -> Result<MappingFile, LogError> {
    let mut built_in = None;
    for (name, text) in BUILT_IN {
        let mapping = parse(Path::new(name), text)?;
        if mapping.source == source {
            built_in = Some(mapping);
        }
    }
    let built_in = built_in.ok_or_else(|| LogError::format(Path::new("log-mappings"), "no mapping for this source"))?;
    let Some(path) = user else {
        return Ok(built_in);
    };
    let text = std::fs::read_to_string(path).map_err(error::io(path, "cannot read the mapping"))?;
    let mut mapping = parse(path, &text)?;
    if mapping.source != source {
        return Err(LogError::format(
            path,
            format!(
                "the mapping is for source = \"{}\", and the log is of source = \"{}\"",
                mapping.source.as_str(),
                source.as_str()
            ),
        ));
    }
    mapping.rows.extend(built_in.rows);
    mapping.base.extend(built_in.base);
    mapping.topics.extend(built_in.topics);
    mapping.keep_rest |= built_in.keep_rest;
    Ok(mapping)
}
