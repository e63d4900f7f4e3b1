//! Tables of test stands: any delimiter, header or none, columns found by role, units from the header or the mapping.
//!
//! Roles: time, command, thrust, voltage, current. A mapping names a column by its header or by its number (from 1) and may give a
//! unit: `thrust=Thrust (gf)`, `thrust=2:kg`; a unit with a minus (`-kg`) turns the sign of a load cell. A column without a unit is taken as SI,
//! and a note says so; a unit in brackets that does not fit its role is rejected. Text logs of ArduPilot are read one
//! message at a time (`message`), with the columns of the message's FMT line. Everything becomes SI: s, duty 0…1, N, V,
//! A, N·m, W.

use super::{FitError, refuse};
use std::path::Path;

/// Standard gravity, m/s²: the definition of a gram-force.
const STANDARD_GRAVITY: f64 = 9.806_65;

/// What a column means.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// s.
    Time,
    /// Duty 0…1.
    Command,
    /// N.
    Thrust,
    /// V.
    Voltage,
    /// A, discharge positive.
    Current,
    /// N·m about the rotor's axis.
    Torque,
    /// W, electrical.
    Power,
}

impl Role {
    /// Name in mappings.
    pub fn name(self) -> &'static str {
        match self {
            Self::Time => "time",
            Self::Command => "command",
            Self::Thrust => "thrust",
            Self::Voltage => "voltage",
            Self::Current => "current",
            Self::Torque => "torque",
            Self::Power => "power",
        }
    }

    const ALL: [Self; 7] = [
        Self::Time,
        Self::Command,
        Self::Thrust,
        Self::Voltage,
        Self::Current,
        Self::Torque,
        Self::Power,
    ];

    /// Fits of thrust, battery and lag work without it: a column with gaps is left out.
    fn is_extra(self) -> bool {
        matches!(self, Self::Torque | Self::Power)
    }

    /// Words that a header may begin with, and the default unit.
    fn headers(self) -> (&'static [&'static str], &'static str) {
        match self {
            Self::Time => (&["time", "t"], "s"),
            Self::Command => (
                &[
                    "esc signal",
                    "esc throttle",
                    "throttle",
                    "command",
                    "duty",
                    "pwm",
                    "u",
                    "signal",
                    "thr",
                ],
                "",
            ),
            Self::Thrust => (&["thrust", "lift", "force", "f", "weight"], "N"),
            Self::Voltage => (&["voltage", "battery_voltage", "volt", "vbat", "v"], "V"),
            Self::Current => (&["current", "battery_current", "curr", "i"], "A"),
            Self::Torque => (&["torque", "moment"], "Nm"),
            Self::Power => (&["electrical power", "power", "electrical_power"], "W"),
        }
    }

    /// Units that are read.
    fn units(self) -> &'static str {
        match self {
            Self::Time => "s, ms, us",
            Self::Command => "none: its values say what it is",
            Self::Thrust => "N, mN, g, gf, kg, kgf, lbf",
            Self::Voltage => "V, mV, cV",
            Self::Current => "A, mA, cA",
            Self::Torque => "Nm, mNm, Nmm, kgfcm, gfcm, lbfin",
            Self::Power => "W, kW",
        }
    }

    /// Factor to SI.
    fn factor(self, unit: &str) -> Option<f64> {
        if let Some(unit) = unit.strip_prefix('-') {
            return self.factor(unit).map(|factor| -factor);
        }
        let unit = unit
            .trim()
            .to_lowercase()
            .replace(['µ', 'μ'], "u")
            .replace(['·', '*', '.', '⋅'], "");
        match (self, unit.as_str()) {
            (Self::Time, "s")
            | (Self::Voltage, "v")
            | (Self::Current, "a")
            | (Self::Thrust, "n")
            | (Self::Torque, "nm")
            | (Self::Power, "w") => Some(1.0),
            (Self::Torque, "mnm" | "nmm") => Some(1e-3),
            (Self::Torque, "kgfcm" | "kgcm") => Some(1e-2 * STANDARD_GRAVITY),
            (Self::Torque, "gfcm" | "gcm") => Some(1e-5 * STANDARD_GRAVITY),
            (Self::Torque, "lbfin" | "inlbf") => Some(0.112_984_83),
            (Self::Power, "kw") => Some(1e3),
            (Self::Time, "ms") | (Self::Voltage, "mv") | (Self::Current, "ma") | (Self::Thrust, "mn") => Some(1e-3),
            (Self::Time, "us") => Some(1e-6),
            (Self::Voltage, "cv") | (Self::Current, "ca") => Some(1e-2),
            (Self::Thrust, "gf" | "g") => Some(1e-3 * STANDARD_GRAVITY),
            (Self::Thrust, "kgf" | "kg") => Some(STANDARD_GRAVITY),
            (Self::Thrust, "lbf") => Some(4.448_221_615),
            _ => None,
        }
    }
}

/// Assignment of columns; empty fields are found by the usual headers.
#[derive(Debug, Clone, Default)]
pub struct Mapping {
    /// (role, header or number, unit) as given by the user.
    pub columns: Vec<(Role, String, Option<String>)>,
    /// Message name of a text log of ArduPilot.
    pub message: Option<String>,
    /// s between rows, if there is no time column.
    pub period_s: Option<f64>,
    /// Pulse at duty 0 and at duty 1, µs.
    pub pulse_us: Option<[f64; 2]>,
    /// Times that are used, s.
    pub window_s: Option<[f64; 2]>,
}

impl Mapping {
    /// Adds `role=column` or `role=column:unit`.
    pub fn add(&mut self, text: &str) -> Result<(), FitError> {
        let expected = "expected role=column or role=column:unit with a role time, command, thrust, voltage, current, torque or power";
        let Some((name, rest)) = text.split_once('=') else {
            return refuse(format!("--map {text}: {expected}"));
        };
        let Some(role) = Role::ALL.into_iter().find(|role| role.name() == name) else {
            return refuse(format!("--map {text}: {expected}, got the role `{name}`"));
        };
        let (column, unit) = match rest.rsplit_once(':') {
            Some((column, unit)) => (column, Some(unit.to_owned())),
            None => (rest, None),
        };
        self.columns.push((role, column.to_owned(), unit));
        Ok(())
    }
}

/// A table in SI.
#[derive(Debug, Clone, Default)]
pub struct Table {
    /// File.
    pub name: String,
    /// s; empty if unknown.
    pub time: Vec<f64>,
    /// 0…1; empty if unknown.
    pub command: Vec<f64>,
    /// N; empty if unknown.
    pub thrust: Vec<f64>,
    /// V; empty if unknown.
    pub voltage: Vec<f64>,
    /// A; empty if unknown.
    pub current: Vec<f64>,
    /// N·m; empty if unknown.
    pub torque: Vec<f64>,
    /// W; empty if unknown.
    pub power: Vec<f64>,
    /// Notes on the conversion, in sentences.
    pub notes: Vec<String>,
    /// Why a time column was left out, if it was: quoted by what requires a time.
    pub without_time: Option<String>,
}

fn decode(bytes: &[u8]) -> String {
    match std::str::from_utf8(bytes) {
        Ok(text) => text.trim_start_matches('\u{feff}').to_owned(),
        // Latin-1: each byte is its code point.
        Err(_) => bytes.iter().map(|byte| char::from(*byte)).collect(),
    }
}

/// Unit in round or square brackets at the end of a header.
fn bracketed_unit(header: &str) -> Option<&str> {
    [('(', ')'), ('[', ']')].into_iter().find_map(|(open, close)| {
        let inside = header.trim_end().strip_suffix(close)?;
        inside.rsplit_once(open).map(|(_, unit)| unit.trim())
    })
}

/// Unit in brackets at the end of a header, or after its last underscore.
fn header_unit(header: &str) -> Option<&str> {
    bracketed_unit(header).or_else(|| header.rsplit_once('_').map(|(_, unit)| unit))
}

impl Table {
    /// Reads a file.
    pub fn read(path: &Path, mapping: &Mapping) -> Result<Self, FitError> {
        let bytes = std::fs::read(path).map_err(|error| FitError(format!("{}: {error}", path.display())))?;
        Self::parse(&path.display().to_string(), &decode(&bytes), mapping)
    }

    /// Reads a text.
    pub fn parse(name: &str, text: &str, mapping: &Mapping) -> Result<Self, FitError> {
        let (header, rows) = split(name, text, mapping)?;
        let mut table = Self {
            name: name.to_owned(),
            ..Self::default()
        };
        let mut columns: Vec<(Role, usize, f64)> = Vec::new();
        let mut assumed = Vec::new();
        for role in Role::ALL {
            let Some((index, unit)) = find(name, role, &header, mapping)? else {
                continue;
            };
            let factor = match unit {
                // The unit of a command is settled from its values below.
                _ if role == Role::Command => f64::NAN,
                Some(unit) => role.factor(&unit).ok_or_else(|| no_unit(name, role, &unit))?,
                None => {
                    let column = header.get(index).map_or_else(
                        || format!("column {}", index + 1),
                        |head| format!("column `{}`", head.chars().take(40).collect::<String>()),
                    );
                    assumed.push(format!("{} ({column}) is taken as {}", role.name(), role.headers().1));
                    1.0
                }
            };
            columns.push((role, index, factor));
        }
        if !assumed.is_empty() {
            table
                .notes
                .push(format!("no unit in the header: {}", assumed.join(", ")));
        }
        let number = |row: &[String], index: usize| {
            let cell = row.get(index).map_or("", |cell| cell.trim());
            (cell.to_owned(), cell.trim_end_matches('%').trim_end().parse::<f64>())
        };
        columns.retain(|(role, index, _)| {
            let whole = !role.is_extra()
                || rows
                    .iter()
                    .all(|(_, row)| number(row, *index).1.is_ok_and(f64::is_finite));
            if !whole {
                table.notes.push(format!(
                    "the column of {} has cells without a number: left out",
                    role.name()
                ));
            }
            whole
        });
        let mut kept = 0;
        for (line, row) in &rows {
            let mut values = Vec::with_capacity(columns.len());
            for (role, index, factor) in &columns {
                let (cell, value) = number(row, *index);
                let Ok(value) = value else {
                    return refuse(format!(
                        "{name}, line {line}, column {} ({}): expected a number, got `{cell}`",
                        index + 1,
                        role.name()
                    ));
                };
                if !value.is_finite() {
                    return refuse(format!(
                        "{name}, line {line}, column {}: expected a finite number, got {cell}",
                        index + 1
                    ));
                }
                values.push(if factor.is_nan() { value } else { value * factor });
            }
            kept += 1;
            for ((role, _, _), value) in columns.iter().zip(values) {
                table.column_mut(*role).push(value);
            }
        }
        if kept < 2 {
            return refuse(format!("{name}: expected at least two rows of numbers, got {kept}"));
        }
        if table.time.is_empty()
            && let Some(period) = mapping.period_s
        {
            table.time = (0..kept).map(|k| k as f64 * period).collect();
            table
                .notes
                .push(format!("no time column: rows are taken as {period} s apart"));
        }
        table.leave_out_the_few_out_of_order();
        // Points of a thrust curve need no clock, and RCbenchmark writes an averaging time instead of the first ones.
        if let Some(k) = table.time.windows(2).position(|pair| pair[1] <= pair[0]) {
            table.without_time = Some(format!(
                "{name}, row {}: expected a time that increases, got {} after {}",
                k + 2,
                table.time[k + 1],
                table.time[k]
            ));
            table.notes.push(format!(
                "the time of row {} is not after that of the row before: the time column is left out",
                k + 2
            ));
            table.time.clear();
        }
        table.settle_command(mapping)?;
        table.cut(mapping)?;
        Ok(table)
    }

    /// Leaves out rows whose time is not after that of the rows before, if they are at most one in a hundred.
    fn leave_out_the_few_out_of_order(&mut self) {
        const MOST_SHARE: f64 = 0.01;
        let mut latest = f64::NEG_INFINITY;
        let keep: Vec<bool> = self
            .time
            .iter()
            .map(|time| {
                let after = *time > latest;
                latest = latest.max(*time);
                after
            })
            .collect();
        let count = keep.iter().filter(|keep| !**keep).count();
        if count == 0 || count as f64 > MOST_SHARE * keep.len() as f64 {
            return;
        }
        self.notes.push(format!(
            "{count} of {} rows are left out: their time is not after that of the rows before",
            keep.len()
        ));
        self.retain(&keep);
    }

    fn retain(&mut self, keep: &[bool]) {
        for role in Role::ALL {
            let mut rows = keep.iter();
            self.column_mut(role).retain(|_| rows.next().is_none_or(|keep| *keep));
        }
    }

    fn column_mut(&mut self, role: Role) -> &mut Vec<f64> {
        match role {
            Role::Time => &mut self.time,
            Role::Command => &mut self.command,
            Role::Thrust => &mut self.thrust,
            Role::Voltage => &mut self.voltage,
            Role::Current => &mut self.current,
            Role::Torque => &mut self.torque,
            Role::Power => &mut self.power,
        }
    }

    /// A required column.
    pub fn require(&self, role: Role) -> Result<&[f64], FitError> {
        let column = match role {
            Role::Time => &self.time,
            Role::Command => &self.command,
            Role::Thrust => &self.thrust,
            Role::Voltage => &self.voltage,
            Role::Current => &self.current,
            Role::Torque => &self.torque,
            Role::Power => &self.power,
        };
        if let (true, Role::Time, Some(reason)) = (column.is_empty(), role, &self.without_time) {
            return refuse(reason.clone());
        }
        if column.is_empty() {
            let name = role.name();
            return refuse(format!(
                "{}: no column for {name} found; name it with --map {name}=COLUMN[:UNIT]",
                self.name
            ));
        }
        Ok(column)
    }

    /// The table without the points of a stalled motor: less than a tenth of the current and a third of the thrust at a
    /// lower command. Without a current in the table a stall cannot be detected, and all points are kept.
    #[must_use]
    pub fn without_stalls(&self) -> Self {
        const CURRENT_SHARE: f64 = 0.1;
        const THRUST_SHARE: f64 = 0.3;
        let points = self.command.len();
        if [&self.current, &self.thrust]
            .iter()
            .any(|column| column.len() != points)
        {
            return self.clone();
        }
        // The most current of all lower commands, and the thrust there.
        let mut order: Vec<usize> = (0..points).collect();
        order.sort_by(|a, b| self.command[*a].total_cmp(&self.command[*b]));
        let mut stands = vec![false; points];
        let mut most: Option<usize> = None;
        let mut from = 0;
        while from < points {
            let same = order[from..].partition_point(|k| self.command[*k] <= self.command[order[from]]);
            let level = &order[from..from + same];
            from += same;
            let Some(lower) = most else {
                most = level
                    .iter()
                    .copied()
                    .max_by(|a, b| self.current[*a].total_cmp(&self.current[*b]));
                continue;
            };
            for k in level {
                stands[*k] = self.current[*k] < CURRENT_SHARE * self.current[lower]
                    && self.thrust[*k] < THRUST_SHARE * self.thrust[lower];
            }
            most = level
                .iter()
                .copied()
                .chain([lower])
                .max_by(|a, b| self.current[*a].total_cmp(&self.current[*b]));
        }
        let count = stands.iter().filter(|stands| **stands).count();
        if count == 0 {
            return self.clone();
        }
        let first = (0..points)
            .filter(|k| stands[*k])
            .map(|k| self.command[k])
            .fold(f64::INFINITY, f64::min);
        let mut table = self.clone();
        let turns: Vec<bool> = stands.iter().map(|stands| !stands).collect();
        table.retain(&turns);
        table.notes.push(format!(
            "{count} of {points} points are left out: the motor does not turn there, from duty {first:.2} on, with less than a tenth of the current and a third \
             of the thrust of a lower duty"
        ));
        table
    }

    /// Commands in µs, percent, thousandths or fractions become fractions.
    fn settle_command(&mut self, mapping: &Mapping) -> Result<(), FitError> {
        let Some(high) = self.command.iter().copied().reduce(f64::max) else {
            return Ok(());
        };
        let low = self.command.iter().copied().fold(f64::INFINITY, f64::min);
        let (zero, one, what) = match mapping.pulse_us {
            Some([zero, one]) if one > zero => (zero, one, "pulse"),
            Some(_) => return refuse(format!("{}: expected a pulse range that rises", self.name)),
            None if low >= 0.0 && high <= 1.0 => (0.0, 1.0, "fraction"),
            None if low >= 0.0 && high <= 100.0 => (0.0, 100.0, "percent"),
            None if low >= 800.0 && high <= 2200.0 => (1000.0, 2000.0, "pulse of 1000 to 2000 µs"),
            None if low >= 0.0 && high <= 1000.0 => (0.0, 1000.0, "thousandths"),
            None => {
                return refuse(format!(
                    "{}: commands from {low} to {high} are neither a fraction, percent, thousandths nor a pulse in µs; give --pulse ZERO:ONE",
                    self.name
                ));
            }
        };
        self.notes
            .push(format!("command read as {what}: {zero} is duty 0, {one} is duty 1"));
        for value in &mut self.command {
            *value = (*value - zero) / (one - zero);
            if !(-0.05..=1.05).contains(value) {
                return refuse(format!("{}: expected duties from 0 to 1, got {value:.3}", self.name));
            }
        }
        Ok(())
    }

    fn cut(&mut self, mapping: &Mapping) -> Result<(), FitError> {
        let Some([from, to]) = mapping.window_s else {
            return Ok(());
        };
        let keep: Vec<bool> = self
            .require(Role::Time)?
            .iter()
            .map(|t| (from..=to).contains(t))
            .collect();
        let count = keep.iter().filter(|keep| **keep).count();
        if count < 2 {
            return refuse(format!(
                "{}: expected at least two rows from {from} to {to} s, got {count}",
                self.name
            ));
        }
        self.notes
            .push(format!("{count} of {} rows used: {from} to {to} s", keep.len()));
        self.retain(&keep);
        Ok(())
    }
}

type Rows = Vec<(usize, Vec<String>)>;

/// Header (empty if none) and rows with their line numbers.
fn split(name: &str, text: &str, mapping: &Mapping) -> Result<(Vec<String>, Rows), FitError> {
    let cells = |line: &str, delimiter: char| -> Vec<String> {
        line.split(delimiter).map(|cell| cell.trim().to_owned()).collect()
    };
    if let Some(message) = &mapping.message {
        let mut header = Vec::new();
        let mut rows = Vec::new();
        for (k, line) in text.lines().enumerate() {
            let row = cells(line, ',');
            if row.first().is_some_and(|cell| cell == "FMT") && row.get(3) == Some(message) {
                header = row[5..].to_vec();
                header.insert(0, "message".to_owned());
            } else if row.first() == Some(message) {
                rows.push((k + 1, row));
            }
        }
        if header.is_empty() || rows.is_empty() {
            return refuse(format!(
                "{name}: there is no message `{message}` with a FMT line and rows"
            ));
        }
        return Ok((header, rows));
    }
    let Some(first) = text.lines().find(|line| !line.trim().is_empty()) else {
        return refuse(format!("{name}: the file is empty"));
    };
    let delimiter = [',', ';', '\t']
        .into_iter()
        .max_by_key(|c| first.matches(*c).count())
        .unwrap_or(',');
    let mut lines = text.lines().enumerate().filter(|(_, line)| {
        let bare = line.trim();
        !bare.is_empty() && !bare.starts_with('#')
    });
    let mut rows: Rows = Vec::new();
    let mut header = Vec::new();
    if let Some((k, line)) = lines.next() {
        let row = cells(line, delimiter);
        if row.first().is_some_and(|cell| cell.parse::<f64>().is_ok()) {
            rows.push((k + 1, row));
        } else {
            header = row;
        }
    }
    rows.extend(lines.map(|(k, line)| (k + 1, cells(line, delimiter))));
    Ok((header, rows))
}

/// Column of a role and its unit.
fn find(
    name: &str,
    role: Role,
    header: &[String],
    mapping: &Mapping,
) -> Result<Option<(usize, Option<String>)>, FitError> {
    if let Some((_, column, unit)) = mapping.columns.iter().find(|(mapped, _, _)| *mapped == role) {
        let by_header = header.iter().position(|cell| cell.eq_ignore_ascii_case(column));
        let by_number = column.parse::<usize>().ok().and_then(|number| number.checked_sub(1));
        let Some(index) = by_header.or(by_number) else {
            let known = if header.is_empty() {
                "the file has no header: give a number".to_owned()
            } else {
                header.join(", ")
            };
            return refuse(format!(
                "{name}: there is no column `{column}` for {}; there are: {known}",
                role.name()
            ));
        };
        let unit = match unit {
            Some(unit) => Some(unit.clone()),
            None => header.get(index).map_or(Ok(None), |cell| unit_of(name, role, cell))?,
        };
        return Ok(Some((index, unit)));
    }
    let (words, _) = role.headers();
    // Tyto's stands write `Powertrain1 - voltage (V)`.
    let bare = |cell: &str| {
        let name = cell.split(['(', '[']).next().unwrap_or("");
        name.rsplit(" - ").next().unwrap_or("").trim().to_lowercase()
    };
    let found = words.iter().find_map(|word| {
        header.iter().position(|cell| {
            let cell = bare(cell);
            cell == *word
                || (word.len() > 1 && (cell.starts_with(&format!("{word}_")) || cell.starts_with(&format!("{word} "))))
        })
    });
    found
        .map(|index| Ok((index, unit_of(name, role, &header[index])?)))
        .transpose()
}

/// The unit that a header states, if it states one. Brackets contain units only: one that is not valid for the role is
/// rejected, as the numbers would otherwise be taken for newtons.
fn unit_of(name: &str, role: Role, header: &str) -> Result<Option<String>, FitError> {
    if role == Role::Command {
        return Ok(None);
    }
    if let Some(unit) = bracketed_unit(header).filter(|unit| role.factor(unit).is_none()) {
        return Err(no_unit(name, role, unit));
    }
    Ok(header_unit(header)
        .filter(|unit| role.factor(unit).is_some())
        .map(str::to_owned))
}

fn no_unit(name: &str, role: Role, unit: &str) -> FitError {
    FitError(format!(
        "{name}: `{}` is no unit of {}; expected one of {}",
        unit.chars().take(40).collect::<String>(),
        role.name(),
        role.units()
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_units_and_roles_of_a_test_stand() {
        let text = "Time (s),ESC signal (µs),Servo 1 (µs),Thrust (gf),Voltage (V),Current (A)\n0,1050,,15,11.1,0.5\n1,1145,,37,11.0,1.0\n";
        let table = Table::parse("bench.csv", text, &Mapping::default()).unwrap();
        assert!((table.thrust[0] - 0.147_099_75).abs() < 1e-9);
        assert!((table.command[1] - 0.145).abs() < 1e-12);
        assert_eq!(table.voltage, [11.1, 11.0]);
    }

    #[test]
    fn regress_the_columns_of_one_powertrain_are_found() {
        let text = "Time (s),Powertrain1 - ESC throttle (μs),Powertrain1 - voltage (V),Powertrain1 - current (A),Powertrain1 - torque MZ (torque) (N·m),Powertrain1 - force Fz (thrust) (kgf)\n\
                    0,1100,16.1,0.5,0.01,0.1\n1,1200,16.0,1.0,0.02,0.2\n";
        let table = Table::parse("tyto.csv", text, &Mapping::default()).unwrap();
        assert!(
            (table.command[1] - 0.2).abs() < 1e-12 && (table.thrust[0] - 0.980_665).abs() < 1e-9,
            "{table:?}"
        );
        assert_eq!((table.voltage[1], table.current[1], table.torque[1]), (16.0, 1.0, 0.02));
    }

    /// `thrust [g]` was read as newtons.
    #[test]
    fn regress_units_in_square_brackets_are_read() {
        let text = "throttle [%],thrust [g],voltage [mV],torque [Nm]\n20,100,11100,0.02\n30,200,11000,0.03\n";
        let table = Table::parse("sheet.csv", text, &Mapping::default()).unwrap();
        assert!((table.thrust[1] - 1.961_33).abs() < 1e-9);
        assert!((table.voltage[0] - 11.1).abs() < 1e-9);
        assert_eq!(table.torque, [0.02, 0.03]);
        assert!((table.command[0] - 0.2).abs() < 1e-12);
    }

    /// Grams under a header without a unit were silently taken as newtons.
    #[test]
    fn regress_a_unit_that_was_assumed_is_told() {
        let text = "throttle,Thrust,voltage [V],current_a\n20,100,11.1,1\n30,200,11.0,2\n";
        let table = Table::parse("sheet.csv", text, &Mapping::default()).unwrap();
        assert_eq!(table.thrust, [100.0, 200.0]);
        assert_eq!(
            table.notes[0], "no unit in the header: thrust (column `Thrust`) is taken as N",
            "{:?}",
            table.notes
        );
        let mut mapping = Mapping::default();
        mapping.add("thrust=2").unwrap();
        mapping.add("time=1").unwrap();
        let table = Table::parse("cell.csv", "0,0.8\n0.02,0.7\n", &mapping).unwrap();
        assert_eq!(
            table.notes,
            ["no unit in the header: time (column 1) is taken as s, thrust (column 2) is taken as N"]
        );
    }

    /// `thrust (oz)` was taken as newtons.
    #[test]
    fn regress_a_unit_that_is_not_known_is_refused() {
        for (header, part) in [
            (
                "throttle,thrust (oz)",
                "`oz` is no unit of thrust; expected one of N, mN, g",
            ),
            (
                "throttle,thrust (g),torque [ft-lb]",
                "`ft-lb` is no unit of torque; expected one of Nm",
            ),
        ] {
            let text = format!("{header}\n20,1,1\n30,2,2\n");
            let sentence = Table::parse("sheet.csv", &text, &Mapping::default())
                .unwrap_err()
                .to_string();
            assert!(
                sentence.starts_with("sheet.csv: ") && sentence.contains(part),
                "{sentence}"
            );
        }
        // With an explicit unit the header may contain anything.
        let mut mapping = Mapping::default();
        mapping.add("thrust=thrust (left):g").unwrap();
        let text = "throttle,thrust (left)\n20,100\n30,200\n";
        let table = Table::parse("sheet.csv", text, &mapping).unwrap();
        assert!((table.thrust[0] - 0.980_665).abs() < 1e-9);
    }

    #[test]
    fn scenario_a_file_without_header_and_bad_input() {
        let mut mapping = Mapping::default();
        mapping.add("time=1").unwrap();
        mapping.add("thrust=2:kg").unwrap();
        let table = Table::parse("cell.csv", "0,0.8\n0.02,0.7\n", &mapping).unwrap();
        assert!((table.thrust[0] - 7.845_32).abs() < 1e-9);
        for (text, part) in [
            ("0,0.8\n0.02,x\n", "expected a number, got `x`"),
            ("0,0.8\n", "at least two rows"),
            ("", "the file is empty"),
        ] {
            let sentence = Table::parse("cell.csv", text, &mapping).unwrap_err().to_string();
            assert!(sentence.contains(part), "{sentence}");
        }
        // Only a role that needs a time is rejected.
        let table = Table::parse("cell.csv", "0,0.8\n0,0.7\n", &mapping).unwrap();
        assert_eq!(table.thrust.len(), 2);
        assert!(
            table.notes.iter().any(|note| note.contains("left out")),
            "{:?}",
            table.notes
        );
        let sentence = table.require(Role::Time).unwrap_err().to_string();
        assert!(
            sentence.contains("row 2: expected a time that increases, got 0 after 0"),
            "{sentence}"
        );
        assert!(
            mapping
                .add("weight=2")
                .unwrap_err()
                .to_string()
                .contains("got the role `weight`")
        );
    }

    /// A motor that stalls at high commands was fitted as a thrust that decreases with the duty.
    #[test]
    fn regress_a_motor_that_stands_gives_no_points() {
        let text = "pulse,thrust [g],current [A]\n1300,5.9,0.66\n1400,10,1.0\n1500,15,1.2\n1600,18.8,1.33\n1640,-0.9,0.02\n1660,2.5,0.017\n1000,0,0.01\n";
        let mut mapping = Mapping::default();
        mapping.add("command=1").unwrap();
        let table = Table::parse("stall.csv", text, &mapping).unwrap().without_stalls();
        assert_eq!(table.command.len(), 5, "{table:?}");
        assert!(table.command.iter().all(|duty| *duty < 0.61));
        assert!(
            table.notes.iter().any(|note| note.starts_with("2 of 7 points")),
            "{:?}",
            table.notes
        );
        // Without a current there is no way to tell.
        let whole = Table {
            current: Vec::new(),
            ..table.clone()
        };
        assert_eq!(whole.without_stalls().command.len(), 5);
    }

    /// `fit lag` rejected 1000 rows of RCbenchmark because of the second one, although `fit thrust` read them.
    #[test]
    fn regress_the_few_rows_out_of_order_are_left_out() {
        let rows: Vec<String> = (0..200)
            .map(|k| format!("{},{},{}", 0.01 * f64::from(k) + 0.05, k % 7, 8.1))
            .collect();
        let text = format!(
            "time [s],weight[g],vbat[V]\n0.0482,1,8.1\n0.0467,1,8.1\n{}\n",
            rows.join("\n")
        );
        let table = Table::parse("steps.csv", &text, &Mapping::default()).unwrap();
        assert_eq!(
            (table.time.len(), table.thrust.len(), table.voltage.len()),
            (201, 201, 201)
        );
        assert!(
            table
                .notes
                .iter()
                .any(|note| note.starts_with("1 of 202 rows are left out")),
            "{:?}",
            table.notes
        );
        // With few rows, none is left out unless its time is needed.
        let table = Table::parse("few.csv", "time [s],weight[g]\n0,1\n0,2\n1,3\n", &Mapping::default()).unwrap();
        assert_eq!(table.thrust.len(), 3);
    }

    #[test]
    fn scenario_a_message_of_a_text_log() {
        let text = "FMT, 9, 19, CURR, hIhhhf, Thr,ThrInt,Volt,Curr,Vcc,CurrTot\nATT, 1, 2\nCURR, 164, 1153, 1198, 297, 5028, 0.6\nCURR, 0, 1811, 1210, 0, 5028, 1.0\n";
        let mut mapping = Mapping {
            message: Some("CURR".to_owned()),
            period_s: Some(1.0),
            ..Mapping::default()
        };
        mapping.add("voltage=Volt:cV").unwrap();
        mapping.add("current=Curr:cA").unwrap();
        let table = Table::parse("x.log", text, &mapping).unwrap();
        assert_eq!(table.voltage, [11.98, 12.1]);
        assert_eq!(table.time, [0.0, 1.0]);
    }
}
