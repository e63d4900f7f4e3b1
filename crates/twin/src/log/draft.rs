//! `rotortwin log map`: drafts the mapping of a third-party CSV.
//!
//! ```text
//! head of the file ─▶ separator, decimal sign, header ─▶ clock ─▶ columns by their names, units by name or by the numbers ─▶ TOML
//! ```
//! What names and numbers reveal is filled in; the rest becomes a question above the row concerned. The draft is a
//! mapping that the import accepts unchanged, or edited by the user.
//!
//! Cells that are lists become columns of their numbers (`v[0]`, `v[1]`, `v[2]`). A Parquet file of another program can
//! be drafted as well, from its columns, which are already numbers.
//!
//! The draft is also available in parts (layout, columns, rows, questions), so that a page can show it as a form.
//!
//! Limits: it guesses by names; columns with non-English names, or numbered ones, are left out. The import's own checks
//! (axes, units, clock) detect most wrong guesses.

use super::sources::csv_table::{Clock, Lists, cells, list_parts, number, plain};
use super::{LogError, MAX_COLUMNS, mapping, names, parquet};
use serde::Serialize;
use std::borrow::Cow;
use std::collections::BTreeSet;
use std::path::Path;
use utoipa::ToSchema;

/// Rows that are examined.
const ROWS: usize = 5000;
/// Lines before a header, at most.
const MOST_PREAMBLE: usize = 50;
/// Rates above this are not rad/s of an ordinary flight.
const FAST_RAD_S: f64 = 12.0;
/// Rows per second that are assumed if no column is a time.
const GUESSED_HZ: f64 = 100.0;
/// Size of the numbers of a Parquet file that can be drafted: 256 MiB.
const MOST_CELLS: usize = 1 << 25;
/// Fewest rotors of a multirotor.
const FEWEST: usize = 3;
/// Other groups of numbered columns that a question mentions.
const MOST_GROUPS: usize = 6;
/// Cells of a column that are shown, and characters of each.
const EXAMPLES: usize = 3;
const LONGEST_EXAMPLE: usize = 40;

/// A drafted mapping.
#[derive(Debug, Clone, Serialize, ToSchema)]
#[schema(as = TableDraft)]
pub struct Draft {
    /// The mapping file (TOML), as an import takes it.
    #[serde(rename = "mapping")]
    pub toml: String,
    /// Layout of the table, and its clock.
    pub layout: DraftedLayout,
    /// Every column of the table.
    pub columns: Vec<DraftedColumn>,
    /// Which columns are mapped to what.
    pub rows: Vec<DraftedRow>,
    /// Questions that only the owner of the log can answer; the mapping file contains them too.
    pub questions: Vec<DraftQuestion>,
    /// Columns that no row uses.
    pub left_out: Vec<String>,
}

/// Layout of a table.
#[derive(Debug, Clone, Serialize, ToSchema)]
#[schema(as = TableLayout)]
pub struct DraftedLayout {
    /// `,`, `;`, `tab` or `space`.
    pub separator: String,
    /// `.` or `,`.
    pub decimal: String,
    /// Number of lines before the header.
    pub skip_lines: usize,
    /// Column that holds the time.
    pub clock: Option<String>,
    /// Format of the time: `s`, `ms`, `us`, `ns`, `mm:ss`, `hh:mm:ss` or `date hh:mm:ss`.
    pub clock_format: Option<String>,
    /// Rows per second if no column holds the time: a guess, which a question asks to confirm.
    pub rate_hz: Option<f64>,
    /// What the choice of the clock is based on.
    pub evidence: String,
}

/// A column of a table.
#[derive(Debug, Clone, Serialize, ToSchema)]
#[schema(as = TableColumn)]
pub struct DraftedColumn {
    /// Name as used in a mapping: commas and colons of the header are replaced by spaces.
    pub name: String,
    /// Unit that the header states.
    pub unit: Option<String>,
    /// Its first cells.
    pub examples: Vec<String>,
    /// Smallest number in the rows that were read; absent if no cell is a number.
    pub low: Option<f64>,
    /// Largest number.
    pub high: Option<f64>,
    /// Number of cells that are numeric.
    pub numbers: usize,
    /// Number of cells that were read.
    pub cells: usize,
}

/// A row of the mapping.
#[derive(Debug, Clone, Default, Serialize, ToSchema)]
#[schema(as = TableRow)]
pub struct DraftedRow {
    /// Target of the columns: `accel`, `rates`, `attitude`, `quaternion`, `velocity`, `position`, `duty`,
    /// `rotor_speed`, `battery_voltage_v` or `battery_current_a`.
    pub to: String,
    /// The columns, in their order in the target.
    pub from: Vec<String>,
    /// Unit of the columns.
    pub unit: Option<String>,
    /// Axes of the columns.
    pub frame: Option<String>,
    /// Motor outputs: the number that means zero throttle.
    pub low: Option<f64>,
    /// Motor outputs: the number that means full throttle.
    pub high: Option<f64>,
    /// What the guess is based on.
    pub evidence: String,
}

/// A question that the table leaves open.
#[derive(Debug, Clone, Serialize, ToSchema)]
#[schema(as = TableQuestion)]
pub struct DraftQuestion {
    /// `clock`, or the `to` of the row concerned, whether or not the draft contains this row.
    pub about: String,
    /// The question, and what is assumed until it is answered.
    pub sentence: String,
}

/// A column: name as used in a mapping's row, words, unit that the name states, numbers.
struct Column {
    name: String,
    words: Vec<String>,
    unit: Option<&'static str>,
    /// Index in a list: `v[2]`.
    part: Option<usize>,
    values: Vec<f64>,
    examples: Vec<String>,
    taken: bool,
}

impl Column {
    fn new(header: &str, cells: &[&str], decimal: char) -> Self {
        let example = |cell: &&str| cell.chars().take(LONGEST_EXAMPLE).collect();
        Self {
            name: plain(header),
            words: words(header),
            unit: unit_in(header),
            part: part_of_list(header),
            values: cells
                .iter()
                .map(|cell| number(cell, decimal).unwrap_or(f64::NAN))
                .collect(),
            examples: cells.iter().take(EXAMPLES).map(example).collect(),
            taken: false,
        }
    }

    fn drafted(&self) -> DraftedColumn {
        let (low, high) = self.range();
        let numbers = self.values.iter().filter(|value| value.is_finite()).count();
        DraftedColumn {
            name: self.name.clone(),
            unit: self.unit.map(str::to_owned),
            examples: self.examples.clone(),
            low: (numbers > 0).then_some(low),
            high: (numbers > 0).then_some(high),
            numbers,
            cells: self.values.len(),
        }
    }

    /// `[0.1, 0.2, 0.3]` in one cell, as in tables whose lists differ in length.
    fn holds_lists(&self) -> bool {
        let list = |cell: &String| cell.trim_start().starts_with(['[', '(']) && cell.contains([',', ' ']);
        !self.examples.is_empty() && self.examples.iter().all(list)
    }

    /// A set point, not a measurement: by a word of its name, or by `d` or `r` at its end (`v_d[0]`, desired; a
    /// reference).
    fn is_wanted(&self) -> bool {
        let ends = self
            .words
            .last()
            .is_some_and(|word| ["d", "r"].contains(&word.as_str()));
        self.has(&WANTED) || (self.words.len() > 1 && ends)
    }

    fn has(&self, any: &[&str]) -> bool {
        self.words.iter().any(|word| any.contains(&word.as_str()))
    }

    fn largest(&self) -> f64 {
        self.values
            .iter()
            .filter(|v| v.is_finite())
            .fold(0.0, |most, v| v.abs().max(most))
    }

    fn range(&self) -> (f64, f64) {
        let finite = self.values.iter().filter(|v| v.is_finite());
        finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (v.min(a), v.max(b)))
    }

    fn median(&self) -> f64 {
        let mut values: Vec<f64> = self.values.iter().copied().filter(|v| v.is_finite()).collect();
        super::resample::median(&mut values).unwrap_or(0.0)
    }
}

/// The index of a list element, `v[2]`; none for a name with a unit, `Acc [g]`.
fn part_of_list(header: &str) -> Option<usize> {
    let (stem, rest) = header.rsplit_once('[')?;
    let number = rest.strip_suffix(']')?;
    (!stem.is_empty() && number.bytes().all(|digit| digit.is_ascii_digit()))
        .then(|| number.parse().ok())
        .flatten()
}

/// Lower-case words of a name: split at punctuation, at capitals, and between letters and digits.
fn words(header: &str) -> Vec<String> {
    let header = header.split(['(', '[']).next().unwrap_or(header);
    let mut words: Vec<String> = Vec::new();
    let mut last = ' ';
    for character in header.chars() {
        let joins = match (last, character) {
            (a, b) if a.is_ascii_digit() && b.is_ascii_digit() => true,
            (a, b) if a.is_alphabetic() && b.is_alphabetic() => !(a.is_lowercase() && b.is_uppercase()),
            _ => false,
        };
        if character.is_alphanumeric() {
            match words.last_mut().filter(|_| joins) {
                Some(word) => word.extend(character.to_lowercase()),
                None => words.push(character.to_lowercase().collect()),
            }
        }
        last = character;
    }
    // `gyrox`, `accy`: an axis appended to a known word.
    let glued: Vec<String> = words
        .iter()
        .flat_map(|word| {
            let stem = ["gyro", "gyr", "accel", "acc", "vel", "pos", "omega", "rate", "imu"];
            let parts = stem.iter().find_map(|stem| {
                word.strip_prefix(stem)
                    .filter(|axis| ["x", "y", "z"].contains(axis))
                    .map(|axis| (*stem, axis))
            });
            match parts {
                Some((stem, axis)) => vec![stem.to_owned(), axis.to_owned()],
                None => vec![word.clone()],
            }
        })
        .collect();
    glued
}

/// The unit that a header states: in brackets after the name, or as its suffix.
fn unit_in(header: &str) -> Option<&'static str> {
    const SPELLINGS: [(&str, &str); 43] = [
        ("deg/s", "deg/s"),
        ("°/s", "deg/s"),
        ("dps", "deg/s"),
        ("degpersec", "deg/s"),
        ("deg_s", "deg/s"),
        ("rad/s", "rad/s"),
        ("rad_s", "rad/s"),
        ("rads", "rad/s"),
        ("rpm", "rpm"),
        ("m/s^2", "m/s2"),
        ("m/s²", "m/s2"),
        ("m/s2", "m/s2"),
        ("m/s/s", "m/s2"),
        ("m_s2", "m/s2"),
        ("mss", "m/s2"),
        ("cm/s", "cm/s"),
        ("mm/s", "mm/s"),
        ("km/h", "km/h"),
        ("kmh", "km/h"),
        ("kph", "km/h"),
        ("cv", "cV"),
        ("m/s", "m/s"),
        ("m_s", "m/s"),
        ("mps", "m/s"),
        ("mg", "mg"),
        ("g", "g"),
        ("cdeg", "cdeg"),
        ("degrees", "deg"),
        ("deg", "deg"),
        ("°", "deg"),
        ("radians", "rad"),
        ("rad", "rad"),
        ("mv", "mV"),
        ("volts", "V"),
        ("volt", "V"),
        ("v", "V"),
        ("ma", "mA"),
        ("amps", "A"),
        ("a", "A"),
        ("mm", "mm"),
        ("cm", "cm"),
        ("ft", "ft"),
        ("m", "m"),
    ];
    let known = |text: &str| {
        let text = text.trim().to_lowercase();
        SPELLINGS
            .iter()
            .find(|(spelling, _)| *spelling == text)
            .map(|(_, unit)| *unit)
    };
    if let Some((_, rest)) = header.split_once(['(', '[']) {
        return known(rest.trim_end_matches([')', ']', ' ']));
    }
    // `roll_rate_deg_s`, `alt_m`: the longest suffix that is a unit. A single letter may be a name (`a`, `v`) and
    // counts only after `_`.
    let lower = header.to_lowercase();
    let ends = |spelling: &str| {
        lower
            .strip_suffix(spelling)
            .is_some_and(|front| front.ends_with(['_', ' ', '.']))
    };
    SPELLINGS
        .iter()
        .filter(|(spelling, _)| ends(spelling))
        .max_by_key(|(spelling, _)| spelling.len())
        .map(|(_, unit)| *unit)
        .or_else(|| {
            // `vbatMV`: two or more capitals after a small letter.
            let capitals = header.len() - header.trim_end_matches(|c: char| c.is_ascii_uppercase()).len();
            let (front, end) = header.split_at(header.len() - capitals);
            (capitals >= 2 && front.ends_with(|c: char| c.is_ascii_lowercase())).then(|| known(end))?
        })
}

/// The draft under construction.
#[derive(Default)]
struct Writer {
    text: String,
    rows: Vec<DraftedRow>,
    questions: Vec<DraftQuestion>,
}

impl Writer {
    fn ask(&mut self, about: &str, sentence: String) {
        self.text += &format!("\n# QUESTION: {sentence}");
        self.questions.push(DraftQuestion {
            about: about.to_owned(),
            sentence,
        });
    }

    fn row(&mut self, row: DraftedRow) {
        let quoted = |text: &str| toml::Value::String(text.to_owned()).to_string();
        self.text += &format!(
            "\n[[column]]\nto = {}\nfrom = {}\n",
            quoted(&row.to),
            quoted(&format!("csv:{}", row.from.join(",")))
        );
        if let Some(unit) = &row.unit {
            self.text += &format!("unit = {}\n", quoted(unit));
        }
        if let Some(frame) = &row.frame {
            self.text += &format!("frame = {}\n", quoted(frame));
        }
        if let Some((low, high)) = row.low.zip(row.high) {
            self.text += &format!("low = {low:?}\nhigh = {high:?}\n");
        }
        self.rows.push(row);
    }
}

/// The evidence for a unit: the header, otherwise a guess.
fn evidence(stated: bool, unit: &str, guess: &str) -> String {
    if stated {
        format!("by name; the header says {unit}")
    } else {
        format!("by name; {guess}")
    }
}

/// A clock that was recognised.
struct FoundClock {
    column: String,
    format: Clock,
    evidence: &'static str,
}

/// The table's layout and its columns.
struct Table {
    separator: char,
    decimal: char,
    skip_lines: usize,
    columns: Vec<Column>,
    clock: Option<FoundClock>,
    /// Columns whose lists are split.
    lists: Vec<String>,
}

/// Drafts the mapping of a CSV.
///
/// # Errors
/// The file is not a table of text: one sentence.
pub fn draft(path: &Path, bytes: &[u8]) -> Result<Draft, LogError> {
    let as_it_is = || {
        LogError::format(
            path,
            "this program reads the file as it is; a mapping is for a table with columns of its own",
        )
    };
    if super::sources::detect(bytes).is_some() {
        return Err(as_it_is());
    }
    let is_parquet = bytes.starts_with(parquet::MAGIC);
    let mut table = if is_parquet {
        let (read, _) = parquet::read(path, bytes.to_vec(), MOST_CELLS)?;
        if read.columns.iter().any(|column| column.name == names::TIME) {
            return Err(as_it_is());
        }
        of_numbers(&read)
    } else {
        text_of(bytes).and_then(|text| table(text.trim_start_matches('\u{feff}')))
    }
    .map_err(|reason| LogError::format(path, reason))?;
    let mut writer = Writer::default();
    let lists: Vec<&str> = table
        .columns
        .iter()
        .filter(|c| c.holds_lists())
        .map(|c| c.name.as_str())
        .collect();
    if !lists.is_empty() {
        let sentence = format!(
            "the cells of {} are lists of different lengths or of more than numbers, which no row can take: write each number into a column of its own \
             ({first}_x, {first}_y, {first}_z) and draft again",
            lists.join(", "),
            first = lists[0]
        );
        writer.ask("rates", sentence);
    }
    map_columns(&mut table.columns, &mut writer);
    let mut head = format!(
        "# Mapping of {}, drafted by `rotortwin log map`: check it, answer the questions, then\n#   rotortwin log import {} --mapping THIS.toml\n",
        path.display(),
        path.display()
    );
    head += "source = \"csv\"\n\n[csv]\n";
    let separator = match table.separator {
        '\t' => "tab".to_owned(),
        ' ' => "space".to_owned(),
        other => other.to_string(),
    };
    if is_parquet {
        head += "# A Parquet file: its columns are numbers, only the clock counts.\n";
    } else {
        head += &format!("separator = \"{separator}\"\ndecimal = \"{}\"\n", table.decimal);
    }
    if let Some(first) = table.lists.first() {
        head += &format!(
            "# The cells of {} are lists: their numbers are the columns {first}[0], {first}[1] and so on.\n",
            table.lists.join(", ")
        );
    }
    if table.skip_lines > 0 {
        head += &format!("skip_lines = {} # before the header\n", table.skip_lines);
    }
    let mut layout = DraftedLayout {
        separator,
        decimal: table.decimal.to_string(),
        skip_lines: table.skip_lines,
        clock: None,
        clock_format: None,
        rate_hz: None,
        evidence: String::new(),
    };
    match &table.clock {
        Some(found) => {
            let name = toml::Value::String(found.column.clone());
            head += &format!("clock = {name}\nclock_format = \"{}\"\n", found.format.name());
            layout.clock = Some(found.column.clone());
            layout.clock_format = Some(found.format.name().to_owned());
            layout.evidence = found.evidence.to_owned();
        }
        None => {
            let question = match rising(&table.columns)[..] {
                [] => "no column rises from row to row as a time does: how many rows are there per second? 100 is written here".to_owned(),
                ref names => format!(
                    "which column is the time? {} {} from row to row, but the name does not say so. Write it as `clock`, or else the rows per second: 100 is written here",
                    names.join(", "),
                    if names.len() == 1 { "rises" } else { "rise" }
                ),
            };
            head += &format!("# QUESTION: {question}\nrate_hz = {GUESSED_HZ:?}\n");
            layout.rate_hz = Some(GUESSED_HZ);
            layout.evidence = "no column is named as a time".to_owned();
            writer.questions.insert(
                0,
                DraftQuestion {
                    about: "clock".to_owned(),
                    sentence: question,
                },
            );
        }
    }
    let left_out: Vec<String> = table
        .columns
        .iter()
        .filter(|c| !c.taken)
        .map(|c| c.name.clone())
        .collect();
    let mut toml = head + &writer.text;
    if !left_out.is_empty() {
        toml += "\n# No row uses these columns:\n";
        for name in &left_out {
            toml += &format!("#   {name}\n");
        }
    }
    mapping::check_draft(&toml)?;
    Ok(Draft {
        toml,
        layout,
        columns: table.columns.iter().map(Column::drafted).collect(),
        rows: writer.rows,
        questions: writer.questions,
        left_out,
    })
}

/// Text of a table; an import reads bytes that are not UTF-8, such as the degree sign of an old logger, in the same way.
fn text_of(bytes: &[u8]) -> Result<Cow<'_, str>, String> {
    match std::str::from_utf8(bytes) {
        Ok(text) => Ok(Cow::Borrowed(text)),
        // No text table contains a zero byte, but most binary formats do.
        Err(bad) if bytes.contains(&0) => Err(format!("not UTF-8 text ({bad}); a table in CSV was expected")),
        Err(_) => Ok(String::from_utf8_lossy(bytes)),
    }
}

/// The lines that are examined: the beginning, and lines from all over the rest.
fn lines_of(text: &str) -> Vec<&str> {
    const REST: usize = ROWS / 4;
    let mut lines: Vec<&str> = text.lines().take(MOST_PREAMBLE + ROWS).collect();
    let rest = text.lines().skip(lines.len());
    let every = (rest.clone().count() / REST).max(1);
    lines.extend(rest.step_by(every));
    lines
}

/// Separator, decimal sign and columns of the layout in which most cells are numbers; none if no layout has two columns.
fn layout(body: &[&str]) -> Option<(char, char, usize)> {
    let numbers = |separator: char, decimal: char| {
        let middle = body.first().map_or(0, |line| cells(line, separator).len());
        let (mut alike, mut found) = (0, 0);
        for line in body {
            let cells = cells(line, separator);
            if cells.len() == middle {
                alike += 1;
                let counts = |cell: &&&str| number(cell, decimal).is_some() || list_parts(cell, decimal).is_some();
                found += cells.iter().filter(counts).count();
            }
        }
        (middle >= 2 && 2 * alike > body.len()).then_some((found, middle))
    };
    [
        (',', '.'),
        (';', '.'),
        (';', ','),
        ('\t', '.'),
        ('\t', ','),
        (' ', '.'),
        (' ', ','),
    ]
    .into_iter()
    .filter_map(|(separator, decimal)| {
        let (found, width) = numbers(separator, decimal)?;
        Some((found, (separator, decimal, width)))
    })
    // The first of equals.
    .fold(None, |best: Option<(usize, _)>, one| match best {
        Some(best) if best.0 >= one.0 => Some(best),
        _ => Some(one),
    })
    .map(|(_, layout)| layout)
}

/// Separator, header and numbers of the examined rows.
fn table(text: &str) -> Result<Table, String> {
    let lines = lines_of(text);
    let body = &lines[lines.len() / 2..];
    let Some((separator, decimal, width)) = layout(body) else {
        return Err(
            "no separator (comma, semicolon, tab, space) parts the lines into columns; a table was expected".to_owned(),
        );
    };
    let is_header = |line: &&str| -> bool {
        let cells = cells(line.trim_start_matches('#'), separator);
        cells.len() == width
            && cells
                .iter()
                .filter(|cell| number(cell, decimal).is_none() && !cell.is_empty())
                .count()
                * 2
                > width
    };
    let place = lines
        .iter()
        .take(MOST_PREAMBLE)
        .position(is_header)
        .ok_or("no line at the beginning holds names of the columns; a header line was expected")?;
    let names = cells(lines[place].trim_start_matches('#'), separator);
    if names.len() > MAX_COLUMNS {
        return Err(format!(
            "more than {MAX_COLUMNS} columns in the header; a flight log was expected"
        ));
    }
    let parted = Lists::of(lines[place + 1..].iter().copied(), width, separator, decimal);
    let names: Vec<String> = names.into_iter().map(str::to_owned).collect();
    let lists = parted.parted(&names).into_iter().map(plain).collect();
    let names = parted.names(&names);
    if names.len() > MAX_COLUMNS {
        return Err(format!(
            "more than {MAX_COLUMNS} columns with the numbers of lists; a flight log was expected"
        ));
    }
    let mut raw: Vec<Vec<&str>> = vec![Vec::new(); names.len()];
    for line in &lines[place + 1..] {
        let cells = cells(line, separator);
        if cells.len() == width {
            for (column, cell) in raw.iter_mut().zip(parted.cells(cells, decimal)) {
                column.push(cell);
            }
        }
    }
    if raw[0].len() < 2 {
        return Err("fewer than two rows below the header; a flight log was expected".to_owned());
    }
    let mut columns: Vec<Column> = names
        .iter()
        .zip(&raw)
        .map(|(name, cells)| Column::new(name, cells, decimal))
        .collect();
    let clock = clock(&mut columns, &raw, decimal);
    Ok(Table {
        separator,
        decimal,
        skip_lines: place,
        columns,
        clock,
        lists,
    })
}

/// A table whose columns are numbers already; rows from the beginning and from all over the rest are examined, as in a
/// text.
fn of_numbers(read: &super::table::Table) -> Result<Table, String> {
    let rows = read.columns.first().map_or(0, |column| column.values.len());
    if rows < 2 {
        return Err("fewer than two rows; a flight log was expected".to_owned());
    }
    let every = (rows.saturating_sub(ROWS) / (ROWS / 4)).max(1);
    let places: Vec<usize> = (0..rows.min(ROWS)).chain((ROWS..rows).step_by(every)).collect();
    let text = |value: f64| {
        if value.is_finite() {
            value.to_string()
        } else {
            String::new()
        }
    };
    let written: Vec<Vec<String>> = read
        .columns
        .iter()
        .map(|column| places.iter().map(|row| text(column.values[*row])).collect())
        .collect();
    let raw: Vec<Vec<&str>> = written
        .iter()
        .map(|column| column.iter().map(String::as_str).collect())
        .collect();
    let mut columns: Vec<Column> = read
        .columns
        .iter()
        .zip(&raw)
        .map(|(column, cells)| Column::new(&column.name, cells, '.'))
        .collect();
    let clock = clock(&mut columns, &raw, '.');
    Ok(Table {
        separator: ',',
        decimal: '.',
        skip_lines: 0,
        columns,
        clock,
        lists: Vec::new(),
    })
}

/// The column that holds the time, and how it is written.
fn clock(columns: &mut [Column], raw: &[Vec<&str>], decimal: char) -> Option<FoundClock> {
    let named = |column: &Column| {
        column.has(&[
            "time",
            "timestamp",
            "t",
            "timer",
            "clock",
            "timeus",
            "timems",
            "date",
            "datetime",
            "seconds",
            "secs",
            "zeit",
            "zeitstempel",
            "uhrzeit",
            "temps",
            "tiempo",
            "tempo",
        ])
    };
    let mut order: Vec<usize> = (0..columns.len()).collect();
    order.sort_by_key(|index| !named(&columns[*index]));
    for index in order {
        // A counter of rows increases as well; a column with another name is used only if it holds a time of day or a
        // date.
        let by_name = named(&columns[index]);
        for format in Clock::ALL {
            let of_day = !matches!(
                format,
                Clock::Seconds | Clock::Milliseconds | Clock::Microseconds | Clock::Nanoseconds
            );
            if !by_name && !of_day {
                continue;
            }
            let times: Vec<f64> = raw[index]
                .iter()
                .filter_map(|cell| format.seconds(cell, decimal))
                .collect();
            let rising = times.windows(2).filter(|pair| pair[1] > pair[0]).count();
            if times.len() * 10 < raw[index].len() * 9 || rising * 10 < times.len() * 9 {
                continue;
            }
            let format = if of_day {
                format
            } else {
                unit_of_time(&columns[index], &times)
            };
            columns[index].taken = true;
            return Some(FoundClock {
                column: columns[index].name.clone(),
                format,
                evidence: if by_name {
                    "its name says time, and it rises from row to row"
                } else {
                    "it holds times of day"
                },
            });
        }
    }
    // Under another name: the first column, if it increases like a clock. One that increases by 1 may count rows.
    let first = columns.first_mut()?;
    let times: Vec<f64> = raw[0].iter().filter_map(|cell| number(cell, decimal)).collect();
    let rises = times.len() == raw[0].len() && times.windows(2).all(|pair| pair[1] > pair[0]);
    // Rows from the rest of the file are some lines apart.
    let steps = times.windows(2).map(|pair| pair[1] - pair[0]);
    let counts =
        steps.clone().all(|step| step.fract() == 0.0) && 2 * steps.filter(|step| *step == 1.0).count() > times.len();
    if !rises || counts {
        return None;
    }
    first.taken = true;
    Some(FoundClock {
        column: first.name.clone(),
        format: unit_of_time(first, &times),
        evidence: "it is the first column, and rises from row to row as a time does",
    })
}

/// Columns that always increase, reported if no clock was recognised.
fn rising(columns: &[Column]) -> Vec<&str> {
    let rises = |column: &&Column| column.values.len() > 1 && column.values.windows(2).all(|pair| pair[1] > pair[0]);
    columns
        .iter()
        .filter(rises)
        .map(|column| column.name.as_str())
        .collect()
}

/// Seconds, or fractions of them, by the name, otherwise by the usual step; also by the step where seconds would be too far apart for any
/// flight.
fn unit_of_time(column: &Column, times: &[f64]) -> Clock {
    let mut steps: Vec<f64> = times
        .windows(2)
        .map(|pair| pair[1] - pair[0])
        .filter(|step| *step > 0.0)
        .collect();
    let step = super::resample::median(&mut steps).unwrap_or(1.0);
    let lower = column.name.to_lowercase();
    let ends = |any: &[&str]| any.iter().any(|end| lower.ends_with(end));
    if ends(&["us", "µs", "usec", "us)", "us]", "micros"]) {
        return Clock::Microseconds;
    }
    if ends(&["ms", "msec", "ms)", "ms]", "millis"]) {
        return Clock::Milliseconds;
    }
    if ends(&["ns", "ns)", "ns]", "nanos"]) {
        return Clock::Nanoseconds;
    }
    // Rows of a stand may be seconds apart, and a unit in brackets is one.
    if ends(&["(s)", "[s]"]) && step < 60.0 || ends(&["_s", "sec", "seconds", "secs"]) && step < 1.5 {
        return Clock::Seconds;
    }
    // Between 2 Hz and 2 kHz in whichever unit it is.
    if step < 0.6 {
        Clock::Seconds
    } else if step < 600.0 {
        Clock::Milliseconds
    } else if step < 600_000.0 {
        Clock::Microseconds
    } else {
        Clock::Nanoseconds
    }
}

const AXES: [[&str; 3]; 4] = [
    ["x", "y", "z"],
    ["roll", "pitch", "yaw"],
    ["p", "q", "r"],
    ["north", "east", "down"],
];

/// Three columns along axes whose other words identify them; claimed together.
fn triple(columns: &mut [Column], axes: &[[&str; 3]], what: &[&str], not: &[&str]) -> Option<[usize; 3]> {
    triple_of(columns, axes, |c| (what.is_empty() || c.has(what)) && !c.has(not))
}

/// Three matching columns along axes; claimed together.
///
/// Of several such triples, the one whose names have the fewest other words: `velocity x` before `user velocity x`. The
/// other words of the three are the same, unless there is no such triple.
fn triple_of(columns: &mut [Column], axes: &[[&str; 3]], fits: impl Fn(&Column) -> bool) -> Option<[usize; 3]> {
    let usable = |c: &Column, axis: &str| {
        !c.taken && c.part.is_none() && c.has(&[axis]) && fits(c) && c.values.iter().any(|v| v.is_finite())
    };
    let others = |c: &Column, axis: &str| {
        let mut words = c.words.clone();
        if let Some(place) = words.iter().position(|word| word == axis) {
            words.remove(place);
        }
        words
    };
    for names in axes {
        let like = |first: usize| {
            let words = others(&columns[first], names[0]);
            let find = |axis: &str| columns.iter().position(|c| usable(c, axis) && others(c, axis) == words);
            Some((words.len(), [first, find(names[1])?, find(names[2])?]))
        };
        let alike = (0..columns.len())
            .filter(|index| usable(&columns[*index], names[0]))
            .filter_map(like)
            .min_by_key(|(words, _)| *words)
            .map(|(_, found)| found);
        let find = |axis: &str| columns.iter().position(|c| usable(c, axis));
        let any = || Some([find(names[0])?, find(names[1])?, find(names[2])?]);
        if let Some(found) = alike.or_else(any) {
            for index in found {
                columns[index].taken = true;
            }
            return Some(found);
        }
    }
    None
}

/// The elements of a list of this length, whose name contains one of some words and is not a set point; claimed
/// together. Of several lists, the one whose name has the fewest words.
fn list_of(columns: &mut [Column], what: &[&str], not: &[&str], count: usize) -> Option<Vec<usize>> {
    let stem = |c: &Column| c.name.rsplit_once('[').map(|(stem, _)| stem.to_owned());
    let of = |first: usize| -> Option<Vec<usize>> {
        let name = stem(&columns[first]);
        let find = |part: usize| columns.iter().position(|c| c.part == Some(part) && stem(c) == name);
        let found: Vec<usize> = (0..count).map_while(find).collect();
        (found.len() == count && find(count).is_none()).then_some(found)
    };
    let found = (0..columns.len())
        .filter(|index| {
            let c = &columns[*index];
            !c.taken && c.part == Some(0) && c.has(what) && !c.has(not) && !c.is_wanted()
        })
        .filter_map(|index| Some((columns[index].words.len(), of(index)?)))
        .min_by_key(|(words, _)| *words)
        .map(|(_, found)| found)?;
    for index in &found {
        columns[*index].taken = true;
    }
    Some(found)
}

/// Three columns with one name and numbers from 0 or 1, as in PX4's `sensor_combined` (`gyro_rad[0]`, `gyro_rad_1`);
/// claimed together.
///
/// With the unit that the name states before the number.
fn numbered(columns: &mut [Column], what: &[&str]) -> Option<([usize; 3], Option<&'static str>)> {
    let split = |name: &str| -> Option<(String, usize)> {
        let open = name.trim_end_matches([']', ')']);
        let stem = open.trim_end_matches(|c: char| c.is_ascii_digit());
        let number = open[stem.len()..].parse().ok()?;
        Some((stem.trim_end_matches(['[', '(', '_', '.', ' ']).to_owned(), number))
    };
    let names: Vec<Option<(String, usize)>> = columns
        .iter()
        .map(|c| split(&c.name).filter(|_| !c.taken && c.has(what) && !c.has(&WANTED)))
        .collect();
    let find = |stem: &String, number: usize| {
        let same = |name: &Option<(String, usize)>| name.as_ref().is_some_and(|(s, n)| s == stem && *n == number);
        names.iter().position(same)
    };
    names.iter().flatten().find_map(|(stem, first)| {
        let alone = *first <= 1 && find(stem, first + 3).is_none() && (*first == 0 || find(stem, 0).is_none());
        let found = [find(stem, *first)?, find(stem, first + 1)?, find(stem, first + 2)?];
        alone.then(|| {
            for index in found {
                columns[index].taken = true;
            }
            (found, unit_in(stem))
        })
    })
}

/// As many as a vector has components.
fn three_of(found: Vec<usize>) -> Option<[usize; 3]> {
    found.try_into().ok()
}

/// Words of set points: commanded, not measured.
const WANTED: [&str; 21] = [
    "defined",
    "commanded",
    "demanded",
    "goal",
    "planned",
    "ref",
    "reference",
    "setpoint",
    "sp",
    "target",
    "des",
    "desired",
    "cmd",
    "command",
    "setp",
    "bias",
    "integral",
    "std",
    "var",
    "mag",
    "error",
];

/// Words of a measured or estimated state, which axes alone are then those of a position: `x_estimate`,
/// `stateEstimate.x`.
const STATES: [&str; 8] = [
    "state",
    "estimate",
    "estimated",
    "est",
    "kalman",
    "ekf",
    "vicon",
    "mocap",
];

fn map_columns(columns: &mut [Column], out: &mut Writer) {
    let name = |columns: &[Column], index: usize| columns[index].name.clone();
    let names = |columns: &[Column], found: [usize; 3]| found.map(|i| name(columns, i));
    // Quaternion before single axes, which its letters resemble.
    quaternion(columns, out);
    let mut body = None;
    let accel = ["acc", "accel", "acceleration", "accelerometer", "force", "a"];
    let by_axis =
        triple(columns, &AXES[..1], &accel, &WANTED).or_else(|| triple(columns, &[["ax", "ay", "az"]], &[], &WANTED));
    let found = by_axis
        .map(|found| (found, columns[found[0]].unit))
        .or_else(|| numbered(columns, &accel[..4]))
        .or_else(|| three_of(list_of(columns, &["a"], &[], 3)?).map(|found| (found, None)));
    if let Some((found, stated)) = found {
        let size = {
            let mut sizes: Vec<f64> = (0..columns[found[0]].values.len())
                .map(|row| found.map(|i| columns[i].values[row].powi(2)).iter().sum::<f64>().sqrt())
                .filter(|size| size.is_finite())
                .collect();
            super::resample::median(&mut sizes).unwrap_or(0.0)
        };
        let stated = stated.filter(|unit| ["m/s2", "g", "mg"].contains(unit));
        let unit = stated.or(match size {
            s if (4.0..25.0).contains(&s) => Some("m/s2"),
            s if (0.4..2.5).contains(&s) => Some("g"),
            s if (400.0..2500.0).contains(&s) => Some("mg"),
            _ => None,
        });
        let down = columns[found[2]].median();
        let upwards = down > 0.0;
        let frame = if upwards { "flu" } else { "frd" };
        // At rest an accelerometer reads gravity; an acceleration of the motion, or a commanded one, reads zero.
        let weight = match unit {
            Some("g") => 1.0,
            Some("mg") => 1000.0,
            Some(_) => 9.81,
            None => size,
        };
        let gravity = down.abs() > 0.4 * weight && size > 0.0;
        if gravity {
            body = Some(frame);
        } else {
            out.ask("accel", format!(
                "{} to {}: the median of the z axis is {down:.3} and that of their length {size:.3}: no gravity is in it. Is this what an accelerometer reads \
                 (9.81 at rest), or an acceleration of the motion or of a reference? Remove the row if it is not an accelerometer's",
                columns[found[0]].name, columns[found[2]].name
            ));
        }
        if unit.is_none() {
            out.ask("accel", format!(
                "{} to {}: what is the unit of the accelerometer (m/s2, g, mg)? Its median is {size:.3}; m/s2 is written here, and at rest it must read 9.81",
                columns[found[0]].name, columns[found[2]].name
            ));
        }
        let axes = match (gravity, upwards) {
            (false, _) => "the z axis shows no gravity: body axes forward, right, down are assumed",
            (true, true) => "the z axis reads upwards at rest: body axes forward, left, up",
            (true, false) => "the z axis reads downwards at rest: body axes forward, right, down",
        };
        let frame = if gravity { frame } else { "frd" };
        out.text += &format!("\n# In the accelerometer's columns {axes}.\n");
        let unit = unit.unwrap_or("m/s2");
        out.row(DraftedRow {
            to: "accel".to_owned(),
            from: names(columns, found).to_vec(),
            unit: Some(unit.to_owned()),
            frame: Some(frame.to_owned()),
            evidence: format!(
                "{}; {axes}",
                evidence(stated.is_some(), unit, &format!("its median length is {size:.3}"))
            ),
            ..DraftedRow::default()
        });
    }
    let gyro = [
        "gyro",
        "gyr",
        "gyroscope",
        "rate",
        "rates",
        "omega",
        "angvel",
        "angular",
        "w",
        "rollspeed",
        "bodyrate",
    ];
    let by_axis = triple(columns, &AXES[..3], &gyro, &WANTED)
        .or_else(|| triple(columns, &[["wx", "wy", "wz"]], &[], &WANTED))
        .or_else(|| triple(columns, &AXES[2..3], &[], &WANTED));
    let found = by_axis.map(|found| (found, columns[found[0]].unit)).or_else(|| {
        // A gyroscope whose name contains `rad` or `deg` means them per second.
        let (found, unit) = numbered(columns, &gyro[..3])?;
        Some((
            found,
            unit.map(|unit| match unit {
                "rad" => "rad/s",
                "deg" => "deg/s",
                other => other,
            }),
        ))
    });
    let found = found.or_else(|| three_of(list_of(columns, &gyro[3..], &[], 3)?).map(|found| (found, None)));
    if let Some((found, stated)) = found {
        let largest = found.map(|i| columns[i].largest()).into_iter().fold(0.0, f64::max);
        let stated = stated.filter(|unit| ["deg/s", "rad/s"].contains(unit));
        let unit = stated.unwrap_or(if largest > FAST_RAD_S { "deg/s" } else { "rad/s" });
        if stated.is_none() {
            out.ask(
                "rates",
                format!(
                    "{} to {}: degrees or radians per second? The largest is {largest:.2}, so {unit} is written here",
                    columns[found[0]].name, columns[found[2]].name
                ),
            );
        }
        if body.is_none() {
            out.ask("rates", "which way do the axes of the body point: forward, right, down (frd) or forward, left, up (flu)? frd is written here".to_owned());
        }
        out.row(DraftedRow {
            to: "rates".to_owned(),
            from: names(columns, found).to_vec(),
            unit: Some(unit.to_owned()),
            frame: Some(body.unwrap_or("frd").to_owned()),
            evidence: evidence(stated.is_some(), unit, &format!("the largest is {largest:.2}")),
            ..DraftedRow::default()
        });
    } else {
        out.ask("rates", "no columns for the body rates (gyroscope) were recognised: which ones are they? Without them no torque can be tested".to_owned());
    }
    attitude(columns, body, out);
    world(columns, out);
    rotors(columns, out);
    battery(columns, out);
}

fn quaternion(columns: &mut [Column], out: &mut Writer) {
    for axes in [["w", "x", "y", "z"], ["0", "1", "2", "3"]] {
        let find = |axis: &str| {
            columns.iter().position(|c| {
                !c.taken
                    && !c.has(&WANTED)
                    && (c.words.iter().any(|word| *word == format!("q{axis}"))
                        || (c.has(&["q", "quat", "quaternion"]) && c.has(&[axis])))
                    && c.largest() <= 1.001
            })
        };
        if let [Some(a), Some(b), Some(c), Some(d)] = axes.map(find) {
            let names: Vec<String> = [a, b, c, d].map(|i| columns[i].name.clone()).to_vec();
            for index in [a, b, c, d] {
                columns[index].taken = true;
            }
            out.ask(
                "quaternion",
                "the quaternion: from which body axes to which world axes (ned-frd, enu-flu, nwu-flu)? ned-frd is written here".to_owned(),
            );
            out.row(DraftedRow {
                to: "quaternion".to_owned(),
                from: names,
                frame: Some("ned-frd".to_owned()),
                evidence: "by name; no number is beyond 1".to_owned(),
                ..DraftedRow::default()
            });
            return;
        }
    }
    quaternion_of_list(columns, out);
}

/// A list of four numbers: the scalar is the first or the last, whichever is largest while a vehicle is upright and
/// heads about north.
fn quaternion_of_list(columns: &mut [Column], out: &mut Writer) {
    let what = ["q", "quat", "quaternion", "orientation", "attitude"];
    let Some(found) = list_of(columns, &what, &[], 4) else {
        return;
    };
    let size = |part: usize| {
        let mut values: Vec<f64> = columns[found[part]].values.iter().map(|v| v.abs()).collect();
        values.retain(|v| v.is_finite());
        super::resample::median(&mut values).unwrap_or(0.0)
    };
    let (first, last) = (size(0), size(3));
    let (order, words) = if last > first {
        ([3, 0, 1, 2], "x, y, z, w")
    } else {
        ([0, 1, 2, 3], "w, x, y, z")
    };
    let names: Vec<String> = order.map(|part| columns[found[part]].name.clone()).to_vec();
    out.ask(
        "quaternion",
        format!(
            "{}: which of its four numbers is the scalar w? The first has the median size {first:.2} and the last {last:.2}, so {words} is taken for \
             their order",
            columns[found[0]].name
        ),
    );
    out.ask(
        "quaternion",
        "the quaternion: from which body axes to which world axes (ned-frd, enu-flu, nwu-flu)? ned-frd is written here"
            .to_owned(),
    );
    out.row(DraftedRow {
        to: "quaternion".to_owned(),
        from: names,
        frame: Some("ned-frd".to_owned()),
        evidence: format!("a list of four; the order {words} by their sizes"),
        ..DraftedRow::default()
    });
}

/// * `body`: axes of the accelerometer, if gravity shows them
fn attitude(columns: &mut [Column], body: Option<&str>, out: &mut Writer) {
    let mut not = WANTED.to_vec();
    not.extend([
        "rate",
        "rates",
        "speed",
        "gyro",
        "vel",
        "rollspeed",
        "pid",
        "torque",
        "moment",
        "out",
    ]);
    let axes = [
        ["roll", "pitch", "yaw"],
        ["roll", "pitch", "heading"],
        ["bank", "pitch", "yaw"],
        ["bank", "pitch", "heading"],
        ["phi", "theta", "psi"],
    ];
    let found = triple(columns, &axes, &[], &not).or_else(|| triple(columns, &AXES[..1], &["euler"], &not));
    let Some(found) = found else {
        return;
    };
    let tilt = columns[found[0]].largest().max(columns[found[1]].largest());
    let turn = columns[found[2]].largest();
    let stated = columns[found[0]]
        .unit
        .filter(|unit| ["deg", "rad", "cdeg"].contains(unit));
    let unit = stated.unwrap_or(if tilt > 400.0 {
        "cdeg"
    } else if tilt > 1.6 || turn > 6.4 {
        "deg"
    } else {
        "rad"
    });
    if stated.is_none() {
        out.ask(
            "attitude",
            format!(
                "{}: degrees or radians? The largest of roll and pitch is {tilt:.2}, so {unit} is written here",
                columns[found[0]].name
            ),
        );
    }
    if body == Some("flu") {
        out.ask(
            "attitude",
            format!(
                "{} to {}: the accelerometer's axes are forward, left, up. Are the angles those of such axes (nwu-flu, enu-flu), or those of an autopilot \
                 (ned-frd: a positive pitch raises the nose)? ned-frd is written here",
                columns[found[0]].name, columns[found[2]].name
            ),
        );
    }
    out.row(DraftedRow {
        to: "attitude".to_owned(),
        from: found.map(|i| columns[i].name.clone()).to_vec(),
        unit: Some(unit.to_owned()),
        frame: Some("ned-frd".to_owned()),
        evidence: evidence(
            stated.is_some(),
            unit,
            &format!("the largest of roll and pitch is {tilt:.2}"),
        ),
        ..DraftedRow::default()
    });
}

fn world(columns: &mut [Column], out: &mut Writer) {
    let mut up_asked = false;
    for (to, stems, glued, default, units) in [
        (
            "velocity",
            ["vel", "velocity", "v", "speed"],
            ["vx", "vy", "vz"],
            "m/s",
            &["m/s", "cm/s", "mm/s", "km/h"][..],
        ),
        (
            "position",
            ["pos", "position", "loc", "local"],
            ["px", "py", "pz"],
            "m",
            &["m", "cm", "mm", "ft"][..],
        ),
    ] {
        let down = [["n", "e", "d"], ["north", "east", "down"]];
        let mut not = WANTED.to_vec();
        not.extend(["gyro", "acc", "accel", "rate", "angular", "rc"]);
        let found = triple(columns, &down, &stems, &not)
            .or_else(|| triple(columns, &[["vn", "ve", "vd"]], &[], &not).filter(|_| to == "velocity"))
            .map(|found| (found, "ned"))
            .or_else(|| {
                // North, east, down and nothing else.
                let bare = |c: &Column| c.words.len() == 1;
                let found = triple_of(columns, &down[1..], |c| to == "position" && bare(c))?;
                Some((found, "ned"))
            })
            .or_else(|| triple(columns, &[glued], &[], &not).map(|found| (found, "")))
            .or_else(|| triple(columns, &AXES[..1], &stems, &not).map(|found| (found, "")))
            .or_else(|| {
                let letter = if to == "position" { "p" } else { "v" };
                let names = [&stems[..], &[letter]].concat();
                Some((three_of(list_of(columns, &names, &not, 3)?)?, ""))
            })
            .or_else(|| {
                // x, y, z and at most a word for a state: the output of a motion capture or of an estimator.
                let bare =
                    |c: &Column| c.words.len() == 1 || c.words.iter().any(|word| STATES.contains(&word.as_str()));
                let found = triple_of(columns, &AXES[..1], |c| to == "position" && bare(c) && !c.has(&not))?;
                Some((found, ""))
            });
        let Some((found, frame)) = found else { continue };
        let stated = columns[found[0]].unit.filter(|unit| units.contains(unit));
        if stated.is_none() {
            out.ask(
                to,
                format!(
                    "{} to {}: what is the unit of the {to} ({})? {default} is written here",
                    columns[found[0]].name,
                    columns[found[2]].name,
                    units.join(", ")
                ),
            );
        }
        if frame.is_empty() && !up_asked {
            up_asked = true;
            let (low, high) = columns[found[2]].range();
            out.ask(to, format!(
                "which way do the axes of {to} point: north, east, down (ned), east, north, up (enu) or north, west, up (nwu)? {} is {low:.2} to {high:.2}; ned is written here",
                columns[found[2]].name
            ));
        }
        let unit = stated.unwrap_or(default);
        out.row(DraftedRow {
            to: to.to_owned(),
            from: found.map(|i| columns[i].name.clone()).to_vec(),
            unit: Some(unit.to_owned()),
            frame: Some("ned".to_owned()),
            evidence: evidence(stated.is_some(), unit, "no unit is stated"),
            ..DraftedRow::default()
        });
    }
}

/// Columns whose names differ only in a number, which counts up from the lowest.
#[derive(Debug, Clone, PartialEq)]
struct Run {
    columns: Vec<usize>,
    /// Which of the numbers in the names it is, from 0: of `m1_t0` the motor comes before the time.
    place: usize,
}

impl Run {
    /// What makes a run of outputs the one that drives the rotors: it moves, most of it keeps its sign (torques and
    /// sticks do not), the first number in its names is the one that counts, it is long, and its values are those of an
    /// output.
    fn rank(&self, columns: &[Column]) -> (bool, bool, bool, usize, bool) {
        let ranges = || self.columns.iter().map(|index| columns[*index].range());
        let moves = ranges().filter(|(low, high)| high > low).count() >= FEWEST;
        let keeps_sign = 2 * ranges().filter(|(low, high)| *low < 0.0 && *high > 0.0).count() < self.columns.len();
        let of_outputs = ranges().all(|(low, high)| (low >= 0.0 && high <= 1.001) || (low >= 800.0 && high <= 2200.0));
        (moves, keeps_sign, self.place == 0, self.columns.len(), of_outputs)
    }
}

/// Runs of columns whose names differ only in a number, each once, in the order of the file.
fn runs_of(columns: &[Column], fits: impl Fn(&Column) -> bool) -> Vec<Run> {
    /// Numbers of a name that are examined.
    const NUMBERS: usize = 4;
    let number = |c: &Column, place: usize| -> Option<(u32, Vec<String>)> {
        if let Some(part) = c.part {
            return (place == 0)
                .then(|| Some((u32::try_from(part).ok()?, c.words.clone())))
                .flatten();
        }
        let numbers = c.words.iter().enumerate();
        let (at, number) = numbers
            .filter_map(|(i, word)| Some((i, word.parse().ok()?)))
            .nth(place)?;
        let mut rest = c.words.clone();
        // The rest keeps its place, so that numbers at different places do not form one run.
        rest[at] = "#".to_owned();
        Some((number, rest))
    };
    let mut found: Vec<Run> = Vec::new();
    for place in 0..NUMBERS {
        let numbered: Vec<(u32, Vec<String>, usize)> = columns
            .iter()
            .enumerate()
            .filter(|(_, c)| !c.taken && fits(c) && c.values.iter().any(|v| v.is_finite()))
            .filter_map(|(i, c)| number(c, place).map(|(number, rest)| (number, rest, i)))
            .collect();
        let mut seen = BTreeSet::new();
        for (_, rest, _) in numbered.iter().filter(|column| seen.insert(&column.1)) {
            let of = || numbered.iter().filter(|column| column.1 == *rest);
            let first = of().map(|column| column.0).min().unwrap_or(0);
            let columns: Vec<usize> = (first..=u32::MAX)
                .map_while(|wanted| of().find(|column| column.0 == wanted).map(|column| column.2))
                .collect();
            let run = Run { columns, place };
            if run.columns.len() >= FEWEST && !found.contains(&run) {
                found.push(run);
            }
        }
    }
    found
}

/// The run that ranks highest, the first of equals.
fn best_of(columns: &[Column], runs: &[Run]) -> Option<Run> {
    let ranked = |best: Option<&Run>, run: &Run| best.is_none_or(|best| run.rank(columns) > best.rank(columns));
    let best = runs
        .iter()
        .fold(None, |best, run| if ranked(best, run) { Some(run) } else { best });
    best.cloned()
}

/// Motor outputs and rotor speeds: the run of numbered columns with one name that moves, the longest of several.
fn rotors(columns: &mut [Column], out: &mut Writer) {
    for (to, stems) in [
        ("rotor_speed", &["rpm", "erpm", "omega"][..]),
        (
            "duty",
            &[
                "motor", "motors", "mot", "m", "pwm", "esc", "servo", "rcou", "output", "out", "duty", "throttle",
                "actuator", "u",
            ][..],
        ),
    ] {
        let speeds = ["rpm", "erpm"];
        let fits = |c: &Column, stem: &str| match to {
            // `omega_x` is a body rate.
            "rotor_speed" => {
                let of_motors = c.unit == Some("rad/s") && c.has(&["m", "motor", "rotor"]);
                (c.has(&[stem]) || of_motors) && !c.has(&["x", "y", "z"]) && !c.has(&WANTED)
            }
            _ => c.has(&[stem]) && !c.has(&speeds),
        };
        let mut runs: Vec<Run> = Vec::new();
        for stem in stems {
            for run in runs_of(columns, |c| fits(c, stem)) {
                if !runs.contains(&run) {
                    runs.push(run);
                }
            }
        }
        if to == "duty" && runs.is_empty() {
            // The speeds that a controller commands are its outputs.
            runs = runs_of(columns, |c| c.has(&speeds) && c.has(&WANTED));
        }
        // Electrical speeds are the rotor's times the pole pairs of its motor, which no table states.
        let electrical = |run: &Run| columns[run.columns[0]].has(&["erpm"]);
        if to == "rotor_speed" && !runs.is_empty() && runs.iter().all(electrical) {
            if let Some(run) = best_of(columns, &runs) {
                let names: Vec<&str> = run.columns.iter().map(|i| columns[*i].name.as_str()).collect();
                out.ask("rotor_speed", format!(
                    "{}: electrical revolutions per minute: how many pairs of magnets has a motor? A rotor turns at this number over the pairs. With P of them \
                     the row is: to = \"rotor_speed\", from = \"csv:{}\", unit = \"rpm\", factor = 1/P as a decimal number; none is written here",
                    names[0],
                    names.join(",")
                ));
            }
            continue;
        }
        runs.retain(|run| to != "rotor_speed" || !electrical(run));
        let Some(Run { columns: best, .. }) = best_of(columns, &runs) else {
            if to == "duty" {
                out.ask("duty", "no columns for the motor outputs were recognised: which ones are they? Without them nothing can be predicted".to_owned());
            }
            continue;
        };
        for index in &best {
            columns[*index].taken = true;
        }
        let names: Vec<String> = best.iter().map(|i| columns[*i].name.clone()).collect();
        if to == "rotor_speed" {
            let stated = columns[best[0]].unit.filter(|unit| *unit == "rad/s");
            let unit = stated.unwrap_or("rpm");
            out.row(DraftedRow {
                to: "rotor_speed".to_owned(),
                from: names,
                unit: Some(unit.to_owned()),
                evidence: evidence(stated.is_some(), unit, "numbered columns of one name"),
                ..DraftedRow::default()
            });
            continue;
        }
        let (low, high) = best
            .iter()
            .map(|i| columns[*i].range())
            .fold((f64::INFINITY, f64::NEG_INFINITY), |a, b| (a.0.min(b.0), a.1.max(b.1)));
        let (from, until) = match high {
            most if most <= 1.001 => (0.0, 1.0),
            // No percent: the largest is as close to full as the rows show.
            most if most <= 2.0 => (0.0, most),
            most if most <= 100.5 => (0.0, 100.0),
            most if most <= 255.0 => (0.0, 255.0),
            most if most <= 1000.5 => (0.0, 1000.0),
            most if low >= 800.0 && most <= 2200.0 => (1000.0, 2000.0),
            most if most <= 2047.5 => (48.0, 2047.0),
            // A commanded speed: its largest is as close to full as the rows show.
            most if columns[best[0]].has(&["rpm", "erpm"]) => (0.0, most),
            _ => (0.0, 65_535.0),
        };
        out.ask("duty", format!(
            "{}: which number is zero throttle and which is full? They range from {low} to {high} in the rows read here, so {from} and {until} are written here",
            names.join(", ")
        ));
        let others: Vec<String> = runs
            .iter()
            .filter(|run| run.columns != best && run.columns.iter().all(|index| !best.contains(index)))
            .map(|run| {
                let name = |index: Option<&usize>| index.map_or("", |index| columns[*index].name.as_str());
                let range = |index: &usize| columns[*index].range();
                let low = run
                    .columns
                    .iter()
                    .map(|index| range(index).0)
                    .fold(f64::INFINITY, f64::min);
                let high = run
                    .columns
                    .iter()
                    .map(|index| range(index).1)
                    .fold(f64::NEG_INFINITY, f64::max);
                format!(
                    "{} to {} ({low} to {high})",
                    name(run.columns.first()),
                    name(run.columns.last())
                )
            })
            .take(MOST_GROUPS)
            .collect();
        if !others.is_empty() {
            out.ask(
                "duty",
                format!(
                    "which numbered columns drive the rotors? {} are taken; there are also {}",
                    names.join(", "),
                    others.join(", ")
                ),
            );
        }
        if best
            .iter()
            .any(|i| columns[*i].has(&["thrust", "thrusts", "force", "lift"]))
        {
            out.ask("duty", format!(
                "{}: by their name these are thrusts: a mapping takes a number for the duty in proportion, and a thrust grows by about the square of the \
                 duty: are they the thrusts that are commanded, or those that are estimated?",
                names[0]
            ));
        }
        let negative: Vec<&str> = best
            .iter()
            .map(|i| &columns[*i])
            .filter(|column| column.range().1 <= 0.0 && column.range().0 < 0.0)
            .map(|column| column.name.as_str())
            .collect();
        if !negative.is_empty() {
            out.ask("duty", format!(
                "{}: negative in all rows, as where the sign is the direction of rotation; a mapping has one range for all motors and would read \
                 these as standing still: write their magnitudes into the table",
                negative.join(", ")
            ));
        }
        out.row(DraftedRow {
            to: "duty".to_owned(),
            from: names,
            low: Some(from),
            high: Some(until),
            evidence: format!("numbered columns of one name; they range from {low} to {high}"),
            ..DraftedRow::default()
        });
    }
}

fn battery(columns: &mut [Column], out: &mut Writer) {
    for (to, words, units, plausible) in [
        (
            "battery_voltage_v",
            &["volt", "voltage", "vbat", "vbatt", "batteryvoltage", "v"][..],
            [("V", 1.0), ("cV", 0.01), ("mV", 0.001)],
            2.0..65.0,
        ),
        (
            "battery_current_a",
            &["curr", "current", "amp", "amps", "amperage", "ibat"][..],
            [("A", 1.0), ("cA", 0.01), ("mA", 0.001)],
            0.01..400.0,
        ),
    ] {
        let of = |unit: &str| units.iter().find(|(name, _)| *name == unit);
        // Its unit, if the header states one, is one of these, and its numbers are those of a battery in some unit.
        let fits = |c: &Column| match c.unit {
            Some(unit) => of(unit).is_some_and(|(_, factor)| plausible.contains(&(c.median() * factor))),
            None => units
                .iter()
                .any(|(_, factor)| plausible.contains(&(c.median() * factor))),
        };
        // "F_curr_y" is the current value of something with axes.
        let free =
            |c: &Column| !c.taken && c.part.is_none() && !c.has(&["cell", "tot", "ref", "x", "y", "z"]) && fits(c);
        let of_battery = ["bat", "batt", "battery", "pack", "akku", "supply", "lipo"];
        let Some(found) = columns.iter().position(|c| free(c) && c.has(words)).or_else(|| {
            columns
                .iter()
                .position(|c| free(c) && c.unit.is_some() && c.has(&of_battery))
        }) else {
            continue;
        };
        columns[found].taken = true;
        let median = columns[found].median();
        let stated = columns[found].unit.filter(|unit| of(unit).is_some());
        // 3848 is 38 V in hundredths, and a single cell in thousandths: of the two, the small vehicle is assumed.
        let cell = to == "battery_voltage_v" && (3000.0..4350.0).contains(&median);
        let likely = units
            .iter()
            .find(|(name, factor)| plausible.contains(&(median * factor)) && (!cell || *name == "mV"))
            .map_or(units[0].0, |(name, _)| *name);
        if stated.is_none() {
            out.ask(
                to,
                format!(
                    "{}: which unit ({})? Its median is {median:.3}, so {likely} is written here",
                    columns[found].name,
                    units.map(|(name, _)| name).join(", ")
                ),
            );
        }
        let unit = stated.unwrap_or(likely);
        out.row(DraftedRow {
            to: to.to_owned(),
            from: vec![columns[found].name.clone()],
            unit: Some(unit.to_owned()),
            evidence: evidence(stated.is_some(), unit, &format!("its median is {median:.3}")),
            ..DraftedRow::default()
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::log::{FlightLog, ReadOptions};

    /// A logger's file: semicolons, decimal commas, a clock of the day, degrees, axes forward, left, up, PWM.
    fn strangers() -> String {
        let mut text = "Logger v2\nTime;Gyro X (deg/s);Gyro Y (deg/s);Gyro Z (deg/s);AccX;AccY;AccZ;Roll;Pitch;Yaw;Motor1;Motor2;Motor3;Motor4;VBat;Mode\n".to_owned();
        for k in 0..400 {
            let t = 0.01 * f64::from(k);
            let roll = 10.0 * libm::sin(2.0 * t);
            let rate = 20.0 * libm::cos(2.0 * t);
            let row = format!(
                "12:00:{:06.3};{rate:.3};0;0;{:.3};0.05;9.79;{roll:.3};-1.0;90.0;{};1510;1490;1505;16.1;AUTO\n",
                30.0 + t,
                0.1 * rate.signum(),
                1500 + k % 40,
            );
            text += &row.replace('.', ",");
        }
        text
    }

    #[test]
    fn regress_axes_of_an_estimate_are_a_position_and_the_angles_beside_them_are_asked_about() {
        for names in [
            "x_estimate,y_estimate,z_estimate",
            "stateEstimate.x,stateEstimate.y,stateEstimate.z",
        ] {
            let mut text = format!("time,{names},acc.x,acc.y,acc.z,stabilizer.roll,stabilizer.pitch,stabilizer.yaw\n");
            for k in 0..50 {
                let t = 0.01 * f64::from(k);
                text += &format!("{t},{},1.0,0.4,{t},0.01,0.99,2.0,{t},-3.0\n", 0.1 * t);
            }
            let draft = draft(Path::new("cf.csv"), text.as_bytes()).unwrap();
            let row = draft.rows.iter().find(|row| row.to == "position").expect("a position");
            assert_eq!(row.from.join(","), names);
            let asked = |about: &str, word: &str| {
                draft
                    .questions
                    .iter()
                    .any(|one| one.about == about && one.sentence.contains(word))
            };
            assert!(asked("attitude", "nwu-flu"), "{:?}", draft.questions);
        }
    }

    /// As a motion capture writes it; the three columns were mistaken for the velocity, which has none.
    #[test]
    fn regress_three_bare_axes_are_a_position() {
        let rows: Vec<String> = (0..50)
            .map(|k| {
                format!(
                    "{},0.1,0.2,{},0,0,0,1",
                    1_724_429_288.0 + 0.02 * f64::from(k),
                    0.01 * f64::from(k)
                )
            })
            .collect();
        let text = format!("t,x,y,z,qx,qy,qz,qw\n{}\n", rows.join("\n"));
        let found = draft(Path::new("mocap.csv"), text.as_bytes()).unwrap();
        assert!(
            found.toml.contains("to = \"position\"\nfrom = \"csv:x,y,z\""),
            "{}",
            found.toml
        );
        assert!(!found.toml.contains("to = \"velocity\""), "{}", found.toml);
    }

    #[test]
    fn val_a_draft_is_taken_by_the_import_and_reads_the_log() {
        let folder = tempfile::tempdir().unwrap();
        let (file, map) = (folder.path().join("flight.csv"), folder.path().join("map.toml"));
        let text = strangers();
        let found = draft(&file, text.as_bytes()).unwrap();
        assert!(
            found
                .questions
                .iter()
                .any(|q| q.about == "duty" && q.sentence.contains("Motor1")),
            "{:?}",
            found.questions
        );
        assert_eq!(found.left_out, ["Mode"]);
        let layout = &found.layout;
        assert_eq!(
            (
                layout.skip_lines,
                layout.clock.as_deref(),
                layout.clock_format.as_deref()
            ),
            (1, Some("Time"), Some("hh:mm:ss"))
        );
        let duty = found.rows.iter().find(|row| row.to == "duty").unwrap();
        assert_eq!((duty.from.len(), duty.low, duty.high), (4, Some(1000.0), Some(2000.0)));
        let rates = found.rows.iter().find(|row| row.to == "rates").unwrap();
        assert_eq!(rates.unit.as_deref(), Some("deg/s"));
        assert!(rates.evidence.contains("the header says deg/s"), "{}", rates.evidence);
        let time = &found.columns[0];
        assert_eq!((time.examples[0].as_str(), time.low), ("12:00:30,000", None));
        let voltage = found.columns.iter().find(|column| column.name == "VBat").unwrap();
        assert_eq!((voltage.low, voltage.high), (Some(16.1), Some(16.1)));
        std::fs::write(&file, &text).unwrap();
        std::fs::write(&map, &found.toml).unwrap();
        let options = ReadOptions {
            mapping: Some(map),
            ..ReadOptions::default()
        };
        let log = FlightLog::read_with(&file, &options).unwrap();
        assert!((log.sample_rate_hz() - 100.0).abs() < 0.1);
        assert_eq!(log.rotor_count(), 4);
        let degree = std::f64::consts::PI / 180.0;
        assert!((log.column("roll_rate_rad_s").unwrap()[0] - 20.0 * degree).abs() < 1e-9);
        // Up in the file, down here.
        assert!((log.column("accel_z_m_s2").unwrap()[0] + 9.79).abs() < 1e-9);
        assert!((log.column("duty_1").unwrap()[0] - 0.5).abs() < 1e-9);
        assert!((log.column("battery_voltage_v").unwrap()[0] - 16.1).abs() < 1e-9);
    }

    /// As spreadsheets of half of Europe write it: no cell is a number with a point, and a comma parts more cells than the separator.
    #[test]
    fn regress_semicolons_and_decimal_commas_everywhere() {
        let mut text = "Zeit [ms];P (deg/s);Q (deg/s);R (deg/s);M1 (us);M2 (us);M3 (us);M4 (us);V_N [km/h];V_E [km/h];V_D [km/h];Pack [mV]\n".to_owned();
        for k in 0..400 {
            let t = 2.5 * f64::from(k);
            let motors = [1500.25, 1510.5, 1490.25, 1505.75].map(|m| format!("{:.2}", m + f64::from(k % 7)));
            let row = format!(
                "{t:.4};{:.4};0.2500;-0.7500;{};-1.0940;0.5000;0.1250;15800.5",
                0.01 * f64::from(k),
                motors.join(";")
            );
            text += &(row.replace('.', ",") + "\n");
        }
        let found = draft(Path::new("akku.csv"), text.as_bytes()).unwrap();
        for part in [
            "separator = \";\"\ndecimal = \",\"",
            "clock = \"Zeit [ms]\"\nclock_format = \"ms\"",
            "to = \"velocity\"\nfrom = \"csv:V_N [km/h],V_E [km/h],V_D [km/h]\"\nunit = \"km/h\"",
            "to = \"battery_voltage_v\"\nfrom = \"csv:Pack [mV]\"\nunit = \"mV\"",
        ] {
            assert!(found.toml.contains(part), "{part}\n{}", found.toml);
        }
        assert_eq!(found.left_out, Vec::<String>::new());
    }

    #[test]
    fn regress_a_unit_in_capitals_counts_and_a_velocity_is_no_voltage() {
        let rows: Vec<String> = (0..50)
            .map(|k| format!("{},0.1,{},3520,0.2", 0.01 * f64::from(k), f64::from(k) - 25.3))
            .collect();
        let text = format!("t,V_N [km/h],V_E [km/h],pm.vbatMV,u\n{}\n", rows.join("\n"));
        let found = draft(Path::new("x.csv"), text.as_bytes()).unwrap();
        let part = "to = \"battery_voltage_v\"\nfrom = \"csv:pm.vbatMV\"\nunit = \"mV\"";
        assert!(found.toml.contains(part), "{}", found.toml);
        assert!(
            !found
                .questions
                .iter()
                .any(|question| question.sentence.contains("vbatMV")),
            "{:?}",
            found.questions
        );
    }

    /// A Parrot Mambo's: a force named "current" (of now), and motors whose sign is the direction in which they turn.
    #[test]
    fn regress_a_force_is_no_current_and_negative_motors_are_asked_about() {
        let rows: Vec<String> = (0..50)
            .map(|k| {
                format!(
                    "{},0.1,{},{},{},{}",
                    0.005 * f64::from(k),
                    290 + k,
                    -300 - k,
                    295,
                    -310 + k % 5
                )
            })
            .collect();
        let text = format!("t,F_curr_Y_N,motor1,motor2,motor3,motor4\n{}\n", rows.join("\n"));
        let found = draft(Path::new("x.csv"), text.as_bytes()).unwrap();
        assert!(!found.toml.contains("battery_current_a"), "{}", found.toml);
        assert!(
            found
                .questions
                .iter()
                .any(|question| question.sentence.starts_with("motor2, motor4: negative in all rows")),
            "{:?}",
            found.questions
        );
    }

    #[test]
    fn regress_a_first_column_that_rises_like_a_clock_is_one() {
        let table = |name: &str, step: f64| {
            let rows: Vec<String> = (0..50)
                .map(|k| format!("{},0.1,{}", step * f64::from(k), k % 3))
                .collect();
            draft(
                Path::new("x.csv"),
                format!("{name},p,m\n{}\n", rows.join("\n")).as_bytes(),
            )
            .unwrap()
        };
        assert!(
            table("Spalte", 2.5)
                .toml
                .contains("clock = \"Spalte\"\nclock_format = \"ms\"")
        );
        let counted = table("row", 1.0);
        assert!(counted.toml.contains("rate_hz = 100.0"), "{}", counted.toml);
        assert!(
            counted.questions[0]
                .sentence
                .contains("which column is the time? row rises"),
            "{:?}",
            counted.questions
        );
    }

    /// A table of PX4's `sensor_combined`, as its tools write it; a fourth number makes it something else.
    #[test]
    fn val_axes_that_are_numbered_are_taken() {
        let table = |names: [&str; 6]| {
            let rows: Vec<String> = (0..100)
                .map(|k| {
                    format!(
                        "{:.4},0.1,{:.2},-9.8,0.01,0.02,{:.3}",
                        0.005 * f64::from(k),
                        0.01 * f64::from(k),
                        1e-3 * f64::from(k)
                    )
                })
                .collect();
            let text = format!("timestamp,{}\n{}\n", names.join(","), rows.join("\n"));
            draft(Path::new("x.csv"), text.as_bytes()).unwrap().toml
        };
        let a = "accelerometer_m_s2";
        let from_one = table([
            &format!("{a}_1"),
            &format!("{a}_2"),
            &format!("{a}_3"),
            "gyro_rad_1",
            "gyro_rad_2",
            "gyro_rad_3",
        ]);
        let from_zero = table([
            &format!("{a}[0]"),
            &format!("{a}[1]"),
            &format!("{a}[2]"),
            "gyro_rad[0]",
            "gyro_rad[1]",
            "gyro_rad[2]",
        ]);
        for (toml, ends) in [(from_one, ["_1", "_2", "_3"]), (from_zero, ["[0]", "[1]", "[2]"])] {
            let of = |stem: &str| ends.map(|end| format!("{stem}{end}")).join(",");
            for (to, stem, unit, frame) in [("accel", a, "m/s2", "frd"), ("rates", "gyro_rad", "rad/s", "frd")] {
                let row = format!(
                    "to = \"{to}\"\nfrom = \"csv:{}\"\nunit = \"{unit}\"\nframe = \"{frame}\"",
                    of(stem)
                );
                assert!(toml.contains(&row), "{row}\n{toml}");
            }
            assert!(!toml.contains("radians per second"), "{toml}");
        }
        let four = table(["acc_1", "acc_2", "acc_3", "acc_4", "p", "m"]);
        assert!(!four.contains("to = \"accel\""), "{four}");
    }

    /// A broken propeller at 60 Hz: no sample is near gravity, but their mean is.
    #[test]
    fn regress_a_vehicle_that_shakes_by_more_than_gravity_is_read() {
        let rows: Vec<String> = (0..4000)
            .map(|k| {
                let t = 0.0045 * f64::from(k);
                let (sin, cos) = (377.0 * t).sin_cos();
                format!(
                    "{t:.4},{:.3},{:.3},{:.3},0,0,{:.4}",
                    40.0 * sin,
                    40.0 * cos,
                    10.0 * sin - 9.81,
                    0.1 * sin
                )
            })
            .collect();
        let text = format!(
            "timestamp,accelerometer_m_s2_1,accelerometer_m_s2_2,accelerometer_m_s2_3,gyro_rad_1,gyro_rad_2,gyro_rad_3\n{}\n",
            rows.join("\n")
        );
        let folder = tempfile::tempdir().unwrap();
        let (file, map) = (folder.path().join("shaken.csv"), folder.path().join("map.toml"));
        std::fs::write(&file, &text).unwrap();
        std::fs::write(&map, draft(&file, text.as_bytes()).unwrap().toml).unwrap();
        let options = ReadOptions {
            mapping: Some(map),
            ..ReadOptions::default()
        };
        let log = FlightLog::read_with(&file, &options).unwrap();
        assert!((log.column("accel_y_m_s2").unwrap()[0] - 40.0).abs() < 1e-3);
    }

    #[test]
    fn val_names_part_into_words_and_units() {
        assert_eq!(words("GyroX_raw [dps]"), ["gyro", "x", "raw"]);
        assert_eq!(words("gyrox"), ["gyro", "x"]);
        assert_eq!(words("motor12"), ["motor", "12"]);
        assert_eq!(unit_in("Acc (m/s^2)"), Some("m/s2"));
        assert_eq!(unit_in("roll_rate_deg_s"), Some("deg/s"));
        assert_eq!(unit_in("a"), None);
        assert_eq!(unit_in("pm.vbatMV"), Some("mV"));
        assert_eq!(unit_in("accelZ"), None);
    }

    #[test]
    fn regress_what_is_no_table_is_refused() {
        for (text, part) in [
            ("", "no separator"),
            ("just words\n", "two rows"),
            ("1,2\n3,4\n5,6\n", "header"),
            ("a,b\n1,2\n", "two rows"),
        ] {
            let reason = draft(Path::new("x.csv"), text.as_bytes()).unwrap_err().to_string();
            assert!(reason.contains(part), "{text:?}: {reason}");
        }
    }

    #[test]
    fn prop_no_text_breaks_the_draft() {
        let text = strangers();
        for end in (0..text.len()).step_by(211).filter(|end| text.is_char_boundary(*end)) {
            drop(draft(Path::new("x.csv"), &text.as_bytes()[..end]));
        }
        for text in [
            "\"",
            "a,\"b\n1,2\n3,4\n",
            "x=,']\n1,2\n2,3\n",
            "t;t;t\n1;2;3\n2;3;4\n",
            "\u{feff}a b\n1 2\n2 3\n",
        ] {
            drop(draft(Path::new("x.csv"), text.as_bytes()));
        }
    }

    #[test]
    fn val_a_row_number_is_no_clock_and_a_body_rate_no_rotor_speed() {
        // As pandas writes a frame of four time steps: an index without a name, which is shown in parts for a long
        // file.
        let mut text =
            ",omegax_0tx,omegax_1tx,omegax_2tx,omegax_3tx,m1pwm_0tu,m2pwm_0tu,m3pwm_0tu,m4pwm_0tu,vbat\n".to_owned();
        for row in 0..30_000 {
            text += &format!("{row},0.1,0.2,0.1,0.3,40000,41000,40500,40200,3848\n");
        }
        let draft = draft(Path::new("a.csv"), text.as_bytes()).unwrap();
        assert_eq!((draft.layout.clock, draft.layout.rate_hz), (None, Some(GUESSED_HZ)));
        assert!(draft.questions.iter().any(|question| question.about == "clock"));
        assert!(!draft.rows.iter().any(|row| row.to == "rotor_speed"), "{}", draft.toml);
        let duty = draft.rows.iter().find(|row| row.to == "duty").unwrap();
        assert_eq!(duty.from, ["m1pwm_0tu", "m2pwm_0tu", "m3pwm_0tu", "m4pwm_0tu"]);
        let voltage = draft.rows.iter().find(|row| row.to == "battery_voltage_v").unwrap();
        assert_eq!(voltage.unit.as_deref(), Some("mV"));
    }

    #[test]
    fn val_a_commanded_speed_is_an_output_and_the_observed_one_a_speed() {
        let mut text =
            "time,rpm_ref_1,rpm_ref_2,rpm_ref_3,rpm_ref_4,rpm_obs_1,rpm_obs_2,rpm_obs_3,rpm_obs_4\n".to_owned();
        for row in 0..200 {
            text += &format!("{},9000,9100,9050,12000,8990,9080,9040,10500\n", 0.002 * f64::from(row));
        }
        let draft = draft(Path::new("a.csv"), text.as_bytes()).unwrap();
        let row = |to: &str| draft.rows.iter().find(|row| row.to == to).unwrap();
        assert_eq!(row("rotor_speed").from[0], "rpm_obs_1");
        assert_eq!(row("duty").from[3], "rpm_ref_4");
        assert_eq!((row("duty").low, row("duty").high), (Some(0.0), Some(12_000.0)));
        assert!(draft.questions.iter().any(|question| question.about == "duty"));
    }

    #[test]
    fn val_bare_north_east_down_and_euler_angles_are_known_and_lists_are_named() {
        let mut text = "Time,North,East,Down,Euler_X,Euler_Y,Euler_Z,p\n".to_owned();
        for row in 0..200 {
            let s = 0.02 * f64::from(row);
            text += &format!("{s},{},2.0,-3.0,0.1,-0.05,{},\"[0.3, -0.1, {s}]\"\n", 0.1 * s, 0.2 * s);
        }
        let draft = draft(Path::new("a.csv"), text.as_bytes()).unwrap();
        let row = |to: &str| draft.rows.iter().find(|row| row.to == to).unwrap();
        assert_eq!(row("position").from, ["North", "East", "Down"]);
        assert_eq!(row("attitude").from, ["Euler_X", "Euler_Y", "Euler_Z"]);
        // There already is a position: the user is not asked which of the two is meant.
        assert_eq!(draft.left_out, ["p[0]", "p[1]", "p[2]"]);
        assert!(draft.toml.contains("# The cells of p are lists"), "{}", draft.toml);
    }

    /// As pandas writes arrays (a public data set of flights in wind): nothing of it could be read before each number had a column of its own.
    #[test]
    fn regress_lists_in_cells_are_drafted_and_imported() {
        let mut text = ",t,p,p_d,v,v_d,q,R,w,T_sp,q_sp,pwm\n".to_owned();
        for k in 0..400 {
            let t = 0.02 * f64::from(k);
            let (sin, cos) = t.sin_cos();
            text += &format!(
                "{k},{t:.2},\"[{sin}, 0.0, 2.1]\",\"[{sin}, 0.0, 2.0]\",\"[{cos}, -0.1, 0.0]\",\"[{cos}, 0.0, 0.0]\",\"[0.01, 0.02, 0.01, -0.9997]\",\
                 \"[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]\",\"[0.1, {:.3}, -0.2]\",[0.49],\"[0.0, 0.0, 0.0, -1.0]\",\
                 \"[{:.1}, 1080.5, 950.0, 1010.0]\"\n",
                0.3 * sin,
                1100.0 + 50.0 * sin
            );
        }
        let folder = tempfile::tempdir().unwrap();
        let (file, map) = (folder.path().join("lists.csv"), folder.path().join("map.toml"));
        let found = draft(&file, text.as_bytes()).unwrap();
        let row = |to: &str| &found.rows.iter().find(|row| row.to == to).unwrap().from;
        assert_eq!(*row("position"), ["p[0]", "p[1]", "p[2]"]);
        assert_eq!(*row("velocity"), ["v[0]", "v[1]", "v[2]"]);
        assert_eq!(*row("rates"), ["w[0]", "w[1]", "w[2]"]);
        assert_eq!(*row("quaternion"), ["q[3]", "q[0]", "q[1]", "q[2]"]);
        assert_eq!(row("duty").len(), 4);
        assert!(
            !found.rows.iter().any(|row| row.to.starts_with("battery")),
            "{}",
            found.toml
        );
        assert!(found.left_out.contains(&"v_d[2]".to_owned()) && found.left_out.contains(&"T_sp".to_owned()));
        std::fs::write(&file, &text).unwrap();
        std::fs::write(&map, &found.toml).unwrap();
        let options = ReadOptions {
            mapping: Some(map),
            ..ReadOptions::default()
        };
        let log = FlightLog::read_with(&file, &options).unwrap();
        assert_eq!((log.rotor_count(), log.time_s.len()), (4, 400));
        assert_eq!(log.column("velocity_east_m_s").unwrap()[7], -0.1);
        assert!((log.column("duty_2").unwrap()[0] - 0.0805).abs() < 1e-9);
    }

    /// A table of a data set of a small quadrotor: body rates `wx`, poses and set points next to the state, thrusts of
    /// the motors not in percent.
    #[test]
    fn regress_bare_body_rates_are_known_and_thrusts_are_asked_about() {
        let header = ",t,x,y,z,vx,vy,vz,wx,wy,wz,x_poses,y_poses,z_poses,m1_thrust,m2_thrust,m3_thrust,m4_thrust,wx_setpoint,wy_setpoint,wz_setpoint";
        let rows: Vec<String> = (0..100)
            .map(|k| {
                let t = 0.01 * f64::from(k);
                format!(
                    "{k},{t},0.1,0.2,{t},0,0.1,0.2,{},0.1,0.2,0.1,0.2,{t},1.076,{},0.5,0.6,0,0,0",
                    0.3 * t.sin(),
                    0.5 + t / 4.0
                )
            })
            .collect();
        let text = format!("{header}\n{}\n", rows.join("\n"));
        let found = draft(Path::new("x.csv"), text.as_bytes()).unwrap();
        let row = |to: &str| found.rows.iter().find(|row| row.to == to).unwrap();
        assert_eq!(row("rates").from, ["wx", "wy", "wz"]);
        assert_eq!(row("position").from, ["x", "y", "z"]);
        assert_eq!((row("duty").low, row("duty").high), (Some(0.0), Some(1.076)));
        let asks = |part: &str| found.questions.iter().any(|question| question.sentence.contains(part));
        assert!(asks("by their name these are thrusts"), "{:?}", found.questions);
        // The refusal of the table says what to do.
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("x.csv");
        std::fs::write(&file, &text).unwrap();
        let reason = FlightLog::read(&file).unwrap_err().to_string();
        assert!(
            reason.contains("column 1 has no name") && reason.contains("rotortwin log map"),
            "{reason}"
        );
    }

    /// A logger of a vehicle with eight rotors: set points were taken for the state, and the motors of another vehicle,
    /// all zero, for its own; then the thrust and torques that its controller commands, of which three change their
    /// sign.
    #[test]
    fn regress_the_state_goes_before_what_the_user_asks_for_and_motors_that_turn_before_those_that_do_not() {
        let mut names = vec!["Current time [s]".to_owned()];
        for what in ["User-defined velocity", "User-defined position", "Velocity", "Position"] {
            let unit = if what.to_lowercase().ends_with("position") {
                "m"
            } else {
                "m/s"
            };
            names.extend(["x", "y", "z"].map(|axis| format!("{what} {axis} [{unit}]")));
        }
        names.push("U control input U1 [N]".to_owned());
        names.extend((2..=4).map(|input| format!("U control input U{input} [Nm]")));
        names.extend((1..=4).map(|motor| format!("Thrust motors QUADCOPTER T{motor} [N]")));
        names.extend((1..=8).map(|motor| format!("Thrust motors X8COPTER T{motor} [N]")));
        names.extend((1..=8).map(|motor| format!("Thrust motors normalized X8COPTER T{motor} [-]")));
        let rows: Vec<String> = (0..100)
            .map(|k| {
                let t = 0.01 * f64::from(k);
                let mut cells = vec![format!("{t:.2}")];
                cells.extend((0..12).map(|column| format!("{:.3}", (t + f64::from(column)).sin())));
                cells.push(format!("{:.3}", 24.0 + t.sin()));
                cells.extend((0..3).map(|axis| format!("{:.3}", (9.0 * t + f64::from(axis)).sin())));
                cells.extend((0..4).map(|_| "0".to_owned()));
                cells.extend((0..8).map(|motor| format!("{:.3}", 3.0 + (t + f64::from(motor)).sin())));
                cells.extend((0..8).map(|motor| format!("{:.3}", 0.5 + 0.1 * (t + f64::from(motor)).sin())));
                cells.join(", ")
            })
            .collect();
        let text = format!("{}\n{}\n", names.join(", "), rows.join("\n"));
        let found = draft(Path::new("x.csv"), text.as_bytes()).unwrap();
        let row = |to: &str| &found.rows.iter().find(|row| row.to == to).unwrap().from;
        assert_eq!(row("velocity")[0], "Velocity x [m/s]");
        assert_eq!(row("position")[2], "Position z [m]");
        assert_eq!(row("duty").len(), 8);
        assert_eq!(row("duty")[7], "Thrust motors normalized X8COPTER T8 [-]");
        let asked = found
            .questions
            .iter()
            .find(|question| question.sentence.starts_with("which numbered columns"));
        let asked = &asked.unwrap().sentence;
        assert!(
            asked.contains("QUADCOPTER T1 [N] to Thrust motors QUADCOPTER T4 [N] (0 to 0)"),
            "{asked}"
        );
    }

    /// `log show` sent the owner of a Parquet file to `log map`, which sent them back.
    #[test]
    fn regress_a_parquet_file_of_another_program_is_drafted_and_imported() {
        let folder = tempfile::tempdir().unwrap();
        let (file, map) = (folder.path().join("foreign.parquet"), folder.path().join("map.toml"));
        let time: Vec<f64> = (0..200).map(|k| 0.01 * f64::from(k)).collect();
        let of = |f: &dyn Fn(f64) -> f64| -> Vec<f64> { time.iter().map(|t| f(*t)).collect() };
        let columns = [
            ("stamp_ns", of(&|t| 1.7e18 + 1e9 * t)),
            ("wx", of(&|t| t.sin())),
            ("wy", of(&|t| 0.2 * t.cos())),
            ("wz", of(&|_| 0.1)),
            ("motor1", of(&|t| 0.5 + 0.1 * t.sin())),
            ("motor2", of(&|t| 0.5 + 0.1 * t.cos())),
            ("motor3", of(&|t| 0.5 - 0.1 * t.sin())),
            ("motor4", of(&|t| 0.5 - 0.1 * t.cos())),
        ];
        // Written as a log, without the name of its clock.
        let fields = columns.iter().map(|(name, _)| rotortwin_store::column_file::Field {
            name: (*name).to_owned(),
            content: rotortwin_store::column_file::Content::OptionalF64,
            packing: rotortwin_store::column_file::Packing::ByteStreams,
        });
        let layout = rotortwin_store::column_file::Layout {
            name: "foreign",
            created_by: "another program".to_owned(),
            fields: fields.collect(),
            metadata: Vec::new(),
            coarse_statistics: false,
        };
        let out = std::fs::File::create(&file).unwrap();
        let mut writer = rotortwin_store::column_file::ColumnFileWriter::new(out, &layout).unwrap();
        writer
            .push(
                columns
                    .iter()
                    .map(|(_, values)| rotortwin_store::column_file::Values::F64(values.as_slice().into())),
            )
            .unwrap();
        writer.finish().unwrap();

        let reason = FlightLog::read(&file).unwrap_err().to_string();
        assert!(
            reason.contains("time_s is missing") && reason.contains("rotortwin log map"),
            "{reason}"
        );
        let found = draft(&file, &std::fs::read(&file).unwrap()).unwrap();
        assert_eq!(found.layout.clock_format.as_deref(), Some("ns"));
        std::fs::write(&map, &found.toml).unwrap();
        let options = ReadOptions {
            mapping: Some(map),
            ..ReadOptions::default()
        };
        let log = FlightLog::read_with(&file, &options).unwrap();
        assert_eq!((log.rotor_count(), log.time_s.len()), (4, 200));
        assert!((log.column("roll_rate_rad_s").unwrap()[50] - 0.5_f64.sin()).abs() < 1e-6);
        assert!((log.time_s[50] - 0.5).abs() < 1e-5);
        // Files written by this program itself are read as they are.
        let stored = folder.path().join("own.parquet");
        log.write_parquet(&stored).unwrap();
        let reason = draft(&stored, &std::fs::read(&stored).unwrap())
            .unwrap_err()
            .to_string();
        assert!(reason.contains("reads the file as it is"), "{reason}");
    }

    /// Electrical speeds were taken for the rotor's without a question; a reference's acceleration was an accelerometer
    /// that "reads downwards".
    #[test]
    fn regress_electrical_turns_and_an_acceleration_without_gravity_are_asked_about() {
        let table = |speeds: &str, z: f64| {
            let mut text = format!("t,ax,ay,az,{speeds}\n");
            for k in 0..200 {
                let t = 0.01 * f64::from(k);
                text += &format!("{t:.2},{:.3},{:.3},{z},9000,9100,9050,{}\n", t.sin(), t.cos(), 8990 + k);
            }
            draft(Path::new("x.csv"), text.as_bytes()).unwrap()
        };
        let asks = |draft: &Draft, part: &str| draft.questions.iter().any(|question| question.sentence.contains(part));
        let electrical = table("m1_erpm,m2_erpm,m3_erpm,m4_erpm", 0.0);
        assert!(
            !electrical.rows.iter().any(|row| row.to == "rotor_speed"),
            "{}",
            electrical.toml
        );
        assert!(asks(&electrical, "how many pairs of magnets"));
        assert!(asks(&electrical, "no gravity is in it") && !electrical.toml.contains("reads downwards"));
        let own = table("m1_rads,m2_rads,m3_rads,m4_rads", -9.81);
        let speeds = own.rows.iter().find(|row| row.to == "rotor_speed").unwrap();
        assert_eq!((speeds.from.len(), speeds.unit.as_deref()), (4, Some("rad/s")));
        assert!(
            own.toml.contains("reads downwards") && !asks(&own, "no gravity"),
            "{}",
            own.toml
        );
    }
}
