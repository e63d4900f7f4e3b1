//! A CSV table with arbitrary columns: the `[csv]` of a mapping gives its layout and the column of the clock.
//!
//! ```toml
//! [csv]
//! separator = ","          # , ; tab space
//! decimal = "."            # or ","
//! skip_lines = 0           # lines before the header
//! clock = "Time"           # column; or rate_hz = 100 where there is none
//! clock_format = "hh:mm:ss"   # s ms us ns · mm:ss · hh:mm:ss · date hh:mm:ss (all with fractions)
//! ```
//! The rows become the one topic `csv`, with the columns by their names (a comma or colon in a name is read as a space,
//! because the rows of a mapping use them as separators). A cell that is not a number is a missing value; their number
//! is reported column by column.
//!
//! A column whose cells are lists (`"[0.1, 0.2, 0.3]"`, as pandas writes them) is as many columns as it has numbers: `v[0]`, `v[1]`, `v[2]`; lists
//! of one number are a column of numbers. Lists in lists follow each other, row by row.
//!
//! A Parquet file of another program uses the same mapping: its columns are already numbers, so `separator` and
//! `decimal` are ignored.

use super::super::table::Table;
use super::{MAX_COLUMNS, RawStream, Room, SourceLog};
use serde::Deserialize;

/// Seconds of a day.
const DAY_S: f64 = 86_400.0;
/// Rows below the header that decide which columns contain lists, and of what length.
const LIST_ROWS: usize = 100;

/// How a table is laid out.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Layout {
    /// `,`, `;`, `tab` or `space`.
    #[serde(default = "comma")]
    pub(crate) separator: String,
    /// `.` or `,`.
    #[serde(default = "point")]
    pub(crate) decimal: String,
    /// Number of lines before the header.
    #[serde(default)]
    pub(crate) skip_lines: usize,
    /// Column that holds the time.
    #[serde(default)]
    pub(crate) clock: Option<String>,
    /// How it is written.
    #[serde(default)]
    pub(crate) clock_format: Option<Clock>,
    /// Rows in a second, where no column holds the time.
    #[serde(default)]
    pub(crate) rate_hz: Option<f64>,
}

fn comma() -> String {
    ",".to_owned()
}

fn point() -> String {
    ".".to_owned()
}

/// How a time is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
pub(crate) enum Clock {
    #[serde(rename = "s")]
    Seconds,
    #[serde(rename = "ms")]
    Milliseconds,
    #[serde(rename = "us")]
    Microseconds,
    #[serde(rename = "ns")]
    Nanoseconds,
    #[serde(rename = "mm:ss")]
    MinutesSeconds,
    #[serde(rename = "hh:mm:ss")]
    HoursMinutesSeconds,
    #[serde(rename = "date hh:mm:ss")]
    DateTime,
}

impl Clock {
    /// Every way, in the order in which a draft tries them.
    pub(crate) const ALL: [Self; 7] = [
        Self::Seconds,
        Self::Milliseconds,
        Self::Microseconds,
        Self::Nanoseconds,
        Self::MinutesSeconds,
        Self::HoursMinutesSeconds,
        Self::DateTime,
    ];

    /// As a mapping writes it.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Seconds => "s",
            Self::Milliseconds => "ms",
            Self::Microseconds => "us",
            Self::Nanoseconds => "ns",
            Self::MinutesSeconds => "mm:ss",
            Self::HoursMinutesSeconds => "hh:mm:ss",
            Self::DateTime => "date hh:mm:ss",
        }
    }

    /// Seconds of a cell; of a time of day, since midnight; of a date, since 1970 without time zones.
    pub(crate) fn seconds(self, cell: &str, decimal: char) -> Option<f64> {
        match self {
            Self::Seconds => number(cell, decimal),
            Self::Milliseconds => number(cell, decimal).map(|time| 1e-3 * time),
            Self::Microseconds => number(cell, decimal).map(|time| 1e-6 * time),
            Self::Nanoseconds => number(cell, decimal).map(|time| 1e-9 * time),
            Self::MinutesSeconds => sexagesimal(cell, decimal, 2),
            Self::HoursMinutesSeconds => sexagesimal(cell, decimal, 3),
            Self::DateTime => {
                let (date, time) = cell.split_once(['T', ' '])?;
                let time = time.trim_end_matches('Z').split(['+']).next()?;
                Some(DAY_S * days(date)? + sexagesimal(time, decimal, 3)?)
            }
        }
    }
}

/// A finite number.
pub(crate) fn number(cell: &str, decimal: char) -> Option<f64> {
    let value: f64 = if decimal == '.' {
        cell.parse().ok()?
    } else {
        cell.replace(decimal, ".").parse().ok()?
    };
    value.is_finite().then_some(value)
}

/// `hh:mm:ss.fff` or `mm:ss.fff`.
fn sexagesimal(cell: &str, decimal: char, parts: usize) -> Option<f64> {
    let cells: Vec<&str> = cell.trim().split(':').collect();
    if cells.len() != parts {
        return None;
    }
    let mut seconds = 0.0;
    for (place, cell) in cells.iter().enumerate() {
        let value = number(cell, decimal)?;
        // The first part may count on beyond 59.
        if value < 0.0 || (place > 0 && value >= 60.0) || (place + 1 < parts && value.fract() != 0.0) {
            return None;
        }
        seconds = 60.0 * seconds + value;
    }
    Some(seconds)
}

/// Days since 1970 of `yyyy-mm-dd`, also with slashes or dots.
fn days(date: &str) -> Option<f64> {
    let parts: Vec<i64> = date
        .split(['-', '/', '.'])
        .map(|part| part.parse().ok())
        .collect::<Option<_>>()?;
    let [year, month, day] = parts.as_slice() else {
        return None;
    };
    if !(1970..=2200).contains(year) || !(1..=12).contains(month) || !(1..=31).contains(day) {
        return None;
    }
    // Years from March on, so that the leap day is the last one (Fliegel, van Flandern).
    let (year, month) = if *month > 2 {
        (*year, month - 3)
    } else {
        (year - 1, month + 9)
    };
    let civil = 365 * year + year / 4 - year / 100 + year / 400 + (153 * month + 2) / 5 + day - 1;
    Some((civil - 719_468) as f64)
}

impl Layout {
    pub(crate) fn separator(&self) -> Result<char, String> {
        match self.separator.as_str() {
            "tab" => Ok('\t'),
            "space" => Ok(' '),
            "," => Ok(','),
            ";" => Ok(';'),
            other => Err(format!(
                "csv.separator = \"{other}\": expected \",\", \";\", \"tab\" or \"space\""
            )),
        }
    }

    pub(crate) fn decimal(&self) -> Result<char, String> {
        match self.decimal.as_str() {
            "." => Ok('.'),
            "," => Ok(','),
            other => Err(format!("csv.decimal = \"{other}\": expected \".\" or \",\"")),
        }
    }

    /// Refuses a layout that no table can have.
    pub(crate) fn check(&self) -> Result<(), String> {
        let (separator, decimal) = (self.separator()?, self.decimal()?);
        if separator == decimal {
            return Err("csv.separator and csv.decimal are the same".to_owned());
        }
        match (&self.clock, self.rate_hz) {
            (Some(_), None) => Ok(()),
            (None, Some(rate)) if rate > 0.0 && rate <= 1e5 => Ok(()),
            (None, Some(rate)) => Err(format!("csv.rate_hz = {rate}: expected a rate above 0, up to 100000")),
            _ => Err(
                "expected csv.clock (the column that holds the time), or csv.rate_hz if there is no such column"
                    .to_owned(),
            ),
        }
    }
}

/// Name of a column as a mapping's row can name it.
pub(crate) fn plain(name: &str) -> String {
    let plain = name.replace([',', ':', '#'], " ");
    plain.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// Cells of a line; quotes are taken off, several spaces are one.
pub(crate) fn cells(line: &str, separator: char) -> Vec<&str> {
    if separator == ' ' {
        return line.split_whitespace().collect();
    }
    let mut out = Vec::new();
    let (mut start, mut quoted) = (0, false);
    for (at, character) in line.char_indices() {
        match character {
            '"' => quoted = !quoted,
            _ if character == separator && !quoted => {
                out.push(unquoted(&line[start..at]));
                start = at + character.len_utf8();
                if out.len() > MAX_COLUMNS {
                    return out;
                }
            }
            _ => {}
        }
    }
    out.push(unquoted(&line[start..]));
    out
}

fn unquoted(cell: &str) -> &str {
    let cell = cell.trim();
    cell.strip_prefix('"')
        .and_then(|cell| cell.strip_suffix('"'))
        .unwrap_or(cell)
        .trim()
}

/// The numbers of a cell that is a list, as text: `[0.1, 0.2]`, `(1 2 3)`; those of lists in it one after the other. None of any other cell.
pub(crate) fn list_parts(cell: &str, decimal: char) -> Option<Vec<&str>> {
    if !cell.starts_with(['[', '(']) || !cell.ends_with([']', ')']) {
        return None;
    }
    let between = |c: char| c.is_whitespace() || "[]();".contains(c) || (c == ',' && decimal != ',');
    let parts: Vec<&str> = cell.split(between).filter(|part| !part.is_empty()).collect();
    let is_number = |part: &&str| number(part, decimal).is_some() || part.eq_ignore_ascii_case("nan");
    (!parts.is_empty() && parts.iter().all(is_number)).then_some(parts)
}

/// Which columns of a table hold lists: by column, how many numbers each of its lists has; none of a column of single cells.
#[derive(Debug, Clone)]
pub(crate) struct Lists(Vec<Option<usize>>);

impl Lists {
    /// Told from the first rows: most cells of such a column are lists, and its width is that of most of them.
    pub(crate) fn of<'a>(lines: impl Iterator<Item = &'a str>, width: usize, separator: char, decimal: char) -> Self {
        let rows: Vec<Vec<&str>> = lines
            .map(|line| cells(line, separator))
            .filter(|cells| cells.len() == width)
            .take(LIST_ROWS)
            .collect();
        let of_column = |column: usize| {
            let mut lengths: Vec<usize> = rows
                .iter()
                .filter_map(|cells| list_parts(cells[column], decimal))
                .map(|parts| parts.len())
                .collect();
            let filled = rows.iter().filter(|cells| !cells[column].is_empty()).count();
            if lengths.is_empty() || 2 * lengths.len() <= filled {
                return None;
            }
            lengths.sort_unstable();
            let count = |length: usize| lengths.iter().filter(|other| **other == length).count();
            lengths.iter().copied().max_by_key(|length| (count(*length), *length))
        };
        Self((0..width).map(of_column).collect())
    }

    /// Names of the columns, with those of the parts of lists: `v[0]`, `v[1]`.
    pub(crate) fn names(&self, names: &[String]) -> Vec<String> {
        let mut out = Vec::new();
        for (name, list) in names.iter().zip(&self.0) {
            match list {
                None | Some(1) => out.push(name.clone()),
                Some(count) => out.extend((0..*count).map(|part| format!("{name}[{part}]"))),
            }
        }
        out
    }

    /// Names of the columns whose lists are parted.
    pub(crate) fn parted<'a>(&self, names: &'a [String]) -> Vec<&'a str> {
        let parted = names
            .iter()
            .zip(&self.0)
            .filter(|(_, list)| list.is_some_and(|count| count > 1));
        parted.map(|(name, _)| name.as_str()).collect()
    }

    /// Cells of a row, with lists split into their parts. A list of another length than the others gives no number in
    /// any of its parts.
    pub(crate) fn cells<'a>(&self, cells: Vec<&'a str>, decimal: char) -> Vec<&'a str> {
        if self.0.iter().all(Option::is_none) {
            return cells;
        }
        let mut out = Vec::with_capacity(cells.len());
        for (cell, list) in cells.into_iter().zip(&self.0) {
            match list {
                None => out.push(cell),
                Some(count) => match list_parts(cell, decimal).filter(|parts| parts.len() == *count) {
                    Some(parts) => out.extend(parts),
                    None => out.extend(std::iter::repeat_n(cell, *count)),
                },
            }
        }
        out
    }
}

/// A table whose columns are numbers already, as a mapping's `[csv]` says: of it only the clock counts.
pub(super) fn of_columns(table: Table, layout: &Layout) -> Result<SourceLog, String> {
    layout.check()?;
    let mut names = Vec::new();
    let mut columns = Vec::new();
    let mut log = SourceLog::default();
    for column in table.columns {
        if column.bad_cells > 0 {
            log.notes
                .push(format!("{}: {} cells are not numbers", column.name, column.bad_cells));
        }
        names.push(plain(&column.name));
        columns.push(column.values);
    }
    let rows = columns.first().map_or(0, Vec::len);
    let mut time_s: Vec<f64> = match &layout.clock {
        None => (0..rows)
            .map(|row| row as f64 / layout.rate_hz.unwrap_or(1.0))
            .collect(),
        Some(wanted) => {
            let found = clock_column(&names, wanted)?;
            let scale = match layout.clock_format.unwrap_or(Clock::Seconds) {
                Clock::Seconds => 1.0,
                Clock::Milliseconds => 1e-3,
                Clock::Microseconds => 1e-6,
                Clock::Nanoseconds => 1e-9,
                other => {
                    return Err(format!(
                        "csv.clock_format = \"{}\": a time of a Parquet file is a number: s, ms, us or ns was expected",
                        other.name()
                    ));
                }
            };
            columns[found].iter().map(|time| scale * time).collect()
        }
    };
    let timeless = time_s.iter().filter(|time| !time.is_finite()).count();
    if timeless == rows {
        return Err("no row of the table has a time; is csv.clock right?".to_owned());
    }
    if timeless > 0 {
        log.notes.push(format!("{timeless} rows without a time are left out"));
        let keep: Vec<bool> = time_s.iter().map(|time| time.is_finite()).collect();
        for values in columns.iter_mut().chain([&mut time_s]) {
            let mut keep = keep.iter();
            values.retain(|_| keep.next() == Some(&true));
        }
    }
    log.streams.push(RawStream {
        name: "csv".to_owned(),
        time_s,
        fields: names.into_iter().zip(columns).collect(),
        ..RawStream::default()
    });
    Ok(log)
}

/// The column that a mapping names as the clock.
fn clock_column(names: &[String], wanted: &str) -> Result<usize, String> {
    let wanted = plain(wanted);
    names.iter().position(|name| *name == wanted).ok_or_else(|| {
        format!(
            "csv.clock = \"{wanted}\": there is no such column; the columns are {}",
            names.join(", ")
        )
    })
}

/// Parses a table as it is laid out.
pub(super) fn parse(bytes: &[u8], layout: &Layout, mut room: Room) -> Result<SourceLog, String> {
    layout.check()?;
    let (separator, decimal) = (layout.separator()?, layout.decimal()?);
    let text = String::from_utf8_lossy(bytes);
    let text = text.strip_prefix('\u{feff}').unwrap_or(&text);
    let mut lines = text
        .lines()
        .skip(layout.skip_lines)
        .filter(|line| !line.trim().is_empty());
    let header = lines
        .next()
        .ok_or("the table is empty; a header line with column names was expected")?;
    let names: Vec<String> = cells(header.trim_start_matches('#'), separator)
        .into_iter()
        .map(plain)
        .collect();
    let width = names.len();
    let lists = Lists::of(lines.clone(), width, separator, decimal);
    let names = lists.names(&names);
    if names.len() > MAX_COLUMNS {
        return Err(format!(
            "more than {MAX_COLUMNS} columns in the header; a flight log was expected"
        ));
    }
    let clock = match &layout.clock {
        Some(wanted) => Some((
            clock_column(&names, wanted)?,
            layout.clock_format.unwrap_or(Clock::Seconds),
        )),
        None => None,
    };
    room.stream(names.len())?;
    let mut columns: Vec<Vec<f64>> = vec![Vec::new(); names.len()];
    let (mut bad, mut time_s) = (vec![0_usize; names.len()], Vec::new());
    let (mut short, mut timeless, mut rows) = (0_usize, 0_usize, 0_usize);
    let (mut last, mut midnight) = (f64::NEG_INFINITY, 0.0);
    for line in lines {
        let cells = cells(line, separator);
        if cells.len() != width {
            short += 1;
            continue;
        }
        let cells = lists.cells(cells, decimal);
        let time = match clock {
            Some((column, format)) => match format.seconds(cells[column], decimal) {
                Some(time) => {
                    // A time of day starts anew at midnight.
                    let of_day = matches!(format, Clock::HoursMinutesSeconds | Clock::MinutesSeconds);
                    let cycle = if format == Clock::MinutesSeconds {
                        DAY_S / 24.0
                    } else {
                        DAY_S
                    };
                    if of_day && time + midnight < last - 0.5 * cycle {
                        midnight += cycle;
                    }
                    last = time + midnight;
                    last
                }
                None => {
                    timeless += 1;
                    continue;
                }
            },
            None => rows as f64 / layout.rate_hz.unwrap_or(1.0),
        };
        rows += 1;
        room.sample(1 + names.len())?;
        time_s.push(time);
        for ((column, bad), cell) in columns.iter_mut().zip(&mut bad).zip(cells) {
            let value = number(cell, decimal);
            *bad += usize::from(value.is_none() && !cell.is_empty());
            column.push(value.unwrap_or(f64::NAN));
        }
    }
    let mut log = SourceLog::default();
    if short > 0 {
        log.notes.push(format!(
            "{short} lines have not as many cells as the header and are left out"
        ));
    }
    if timeless > 0 {
        log.notes.push(format!("{timeless} lines without a time are left out"));
    }
    if time_s.is_empty() {
        return Err(format!(
            "no row of the table has a time ({}); is csv.clock_format right?",
            log.notes.join("; ")
        ));
    }
    for (index, count) in bad.iter().enumerate().filter(|(_, count)| **count > 0) {
        if clock.is_none_or(|(column, _)| column != index) {
            log.notes
                .push(format!("{}: {count} cells are not numbers", names[index]));
        }
    }
    log.streams.push(RawStream {
        name: "csv".to_owned(),
        time_s,
        fields: names.into_iter().zip(columns).collect(),
        ..RawStream::default()
    });
    Ok(log)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn layout(text: &str) -> Layout {
        toml::from_str(text).unwrap()
    }

    fn read(text: &str, layout: &Layout) -> Result<SourceLog, String> {
        parse(text.as_bytes(), layout, Room::new(1 << 16))
    }

    #[test]
    fn val_clocks_are_read_as_people_write_them() {
        for (clock, cell, seconds) in [
            (Clock::Milliseconds, "1500", 1.5),
            (Clock::MinutesSeconds, "02:03.5", 123.5),
            (Clock::HoursMinutesSeconds, "13:59:59.250", 50_399.25),
            (Clock::DateTime, "1970-01-02 00:00:01", 86_401.0),
            (Clock::DateTime, "2024-02-29T12:00:00.5Z", 1_709_208_000.5),
        ] {
            assert_eq!(clock.seconds(cell, '.'), Some(seconds), "{cell}");
        }
        for (clock, cell) in [
            (Clock::HoursMinutesSeconds, "12:61:00"),
            (Clock::HoursMinutesSeconds, "12:00"),
            (Clock::DateTime, "2024-13-01 00:00:00"),
            (Clock::Seconds, "nan"),
        ] {
            assert_eq!(clock.seconds(cell, '.'), None, "{cell}");
        }
        assert_eq!(Clock::HoursMinutesSeconds.seconds("00:00:01,5", ','), Some(1.5));
    }

    #[test]
    fn val_a_table_over_midnight_with_decimal_commas() {
        let layout =
            layout("separator = \";\"\ndecimal = \",\"\nskip_lines = 1\nclock = \"Time\"\nclock_format = \"hh:mm:ss\"");
        let log = read(
            "made by a logger\nTime;Gyro X, roll;Mode\n23:59:59,5;1,25;AUTO\n00:00:00,5;-2,5;AUTO\nbroken line\n",
            &layout,
        )
        .unwrap();
        let stream = &log.streams[0];
        assert_eq!(stream.time_s[1] - stream.time_s[0], 1.0);
        assert_eq!(stream.fields[1], ("Gyro X roll".to_owned(), vec![1.25, -2.5]));
        assert!(stream.fields[2].1.iter().all(|value| value.is_nan()));
        assert_eq!(log.notes.len(), 2, "{:?}", log.notes);
    }

    /// As pandas writes arrays: each cell was no number, and nothing of such a log could be read.
    #[test]
    fn regress_lists_in_cells_are_columns_of_their_numbers() {
        let text = ",t,v,R,throttle\n\
            0,0.0,\"[1.0, -2.5, 3e-1]\",\"[[1.0, 0.0], [0.0, 1.0]]\",[0.4]\n\
            1,0.1,\"[1.5, nan, 0.5]\",\"[[1 0]\n\
            2,0.2,\"[1.5, 2.0]\",\"[[1.0 0.5] [0.5 1.0]]\",\"(0.5,)\"\n";
        let log = read(text, &layout("clock = \"t\"")).unwrap();
        let stream = &log.streams[0];
        let names: Vec<&str> = stream.fields.iter().map(|(name, _)| name.as_str()).collect();
        assert_eq!(
            names,
            [
                "", "t", "v[0]", "v[1]", "v[2]", "R[0]", "R[1]", "R[2]", "R[3]", "throttle"
            ]
        );
        let of = |name: &str| &stream.fields.iter().find(|(field, _)| field == name).unwrap().1;
        assert_eq!((of("v[1]")[0], of("v[2]")[0], of("R[3]")[0]), (-2.5, 0.3, 1.0));
        assert_eq!((of("throttle")[0], of("throttle")[1], of("R[1]")[1]), (0.4, 0.5, 0.5));
        // A list of two among lists of three gives none of its numbers; the truncated line is not a row.
        assert!(of("v[0]")[1].is_nan());
        assert!(
            log.notes.iter().any(|note| note.starts_with("v[0]: 1 cells")),
            "{:?}",
            log.notes
        );
        assert_eq!(stream.time_s.len(), 2);
    }

    #[test]
    fn val_only_cells_of_numbers_in_brackets_are_lists() {
        assert_eq!(list_parts("[1.0, 2]", '.'), Some(vec!["1.0", "2"]));
        assert_eq!(list_parts("[1,5; 2,5]", ','), Some(vec!["1,5", "2,5"]));
        for cell in ["", "[]", "[a, b]", "1.0", "(1.0", "AUTO (2)"] {
            assert_eq!(list_parts(cell, '.'), None, "{cell}");
        }
    }

    #[test]
    fn val_a_table_of_numbers_takes_its_clock_from_a_mapping() {
        let table = || {
            let mut table = Table::default();
            table.push("stamp", vec![1e9, f64::NAN, 3e9]);
            table.push("wx", vec![0.1, 0.2, 0.3]);
            table
        };
        let log = of_columns(table(), &layout("clock = \"stamp\"\nclock_format = \"ns\"")).unwrap();
        assert_eq!(log.streams[0].time_s, [1.0, 3.0]);
        assert_eq!(log.streams[0].fields[1].1, [0.1, 0.3]);
        for (text, part) in [
            ("clock = \"t\"", "there is no such column"),
            ("clock = \"stamp\"\nclock_format = \"hh:mm:ss\"", "is a number"),
        ] {
            let reason = of_columns(table(), &layout(text)).unwrap_err();
            assert!(reason.contains(part), "{reason}");
        }
    }

    #[test]
    fn regress_what_a_layout_lacks_is_said() {
        for (text, part) in [
            ("separator = \"|\"\nclock = \"t\"", "csv.separator"),
            ("decimal = \",\"\nclock = \"t\"", "are the same"),
            ("", "csv.clock"),
            ("rate_hz = -5.0", "csv.rate_hz"),
            ("clock = \"x\"", "there is no such column"),
            ("clock = \"t\"\nclock_format = \"hh:mm:ss\"", "csv.clock_format"),
        ] {
            let reason = read("t,a\n1,2\n2,3\n", &layout(text)).unwrap_err();
            assert!(reason.contains(part), "{text}: {reason}");
        }
    }
}
