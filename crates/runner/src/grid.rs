//! Tables that fit the terminal: words are never broken, numbers never separated from their unit.
//!
//! If a table is too wide, its columns move closer together and the longest headings and texts are wrapped; if that is not enough, it is printed
//! in blocks of columns, each repeating the first column.

use crate::text;
use comfy_table::{CellAlignment, ContentLineStyle, LineStyle, Table, TableStyle};
use std::collections::BTreeSet;
use std::fmt::{Display, Formatter};

/// A line above, below and under the header; nothing else.
const STYLE: TableStyle = TableStyle::new()
    .top_border(LineStyle::new('─', '─', '─', '─'))
    .header_lines(ContentLineStyle::none())
    .header_separator(LineStyle::new('─', '─', '─', '─'))
    .content_lines(ContentLineStyle::none())
    .bottom_border(LineStyle::new('─', '─', '─', '─'));

/// Spaces next to a cell, both sides together, and the position of the following separator: the style draws none, but reserves its space.
const PADDING: usize = 3;

/// The same where the table would be too wide.
const TIGHT: usize = 2;

/// The position of the separator before the first column.
const EDGE: usize = 1;

/// A table: texts left-aligned, numbers right-aligned.
#[derive(Clone, Debug)]
pub struct Grid {
    header: Vec<String>,
    rows: Vec<Vec<String>>,
    numbers: BTreeSet<usize>,
}

impl Grid {
    /// A table without rows.
    pub fn new<T: Into<String>>(header: impl IntoIterator<Item = T>) -> Self {
        Self {
            header: header.into_iter().map(Into::into).collect(),
            rows: Vec::new(),
            numbers: BTreeSet::new(),
        }
    }

    /// Marks these columns as numeric.
    #[must_use]
    pub fn numbers(mut self, columns: impl IntoIterator<Item = usize>) -> Self {
        self.numbers.extend(columns);
        self
    }

    /// Marks these and all further columns as numeric.
    #[must_use]
    pub fn numbers_from(self, first: usize) -> Self {
        let columns = self.header.len();
        self.numbers(first..columns)
    }

    /// Adds a row below the others.
    pub fn add_row<T: Into<String>>(&mut self, cells: impl IntoIterator<Item = T>) {
        self.rows.push(cells.into_iter().map(Into::into).collect());
    }

    /// The cells of a column, below its heading.
    fn cells(&self, column: usize) -> impl Iterator<Item = &str> {
        self.rows
            .iter()
            .map(move |row| row.get(column).map_or("", String::as_str))
    }

    /// Width of an unwrapped column.
    fn whole(&self, column: usize) -> usize {
        self.cells(column)
            .chain([self.header[column].as_str()])
            .map(widest_line)
            .max()
            .unwrap_or(0)
    }

    /// Minimum width of a column.
    fn least(&self, column: usize) -> usize {
        let heading = widest_word(&self.header[column]);
        let cells = if self.numbers.contains(&column) {
            self.cells(column).map(widest_line).max()
        } else {
            self.cells(column).map(widest_word).max()
        };
        heading.max(cells.unwrap_or(0))
    }

    /// The table in lines of at most `width` characters, unless a single column is wider.
    fn laid_out(&self, width: usize) -> String {
        let width = width.saturating_sub(EDGE);
        let blocks = self.blocks(width);
        let blocks: Vec<String> = blocks.iter().map(|columns| self.block(columns, width)).collect();
        blocks.join("\n")
    }

    /// Groups of columns per block, each with the first one.
    fn blocks(&self, width: usize) -> Vec<Vec<usize>> {
        let needs = |column: usize| self.least(column) + TIGHT;
        let mut blocks = vec![vec![0]];
        let mut taken = needs(0);
        for column in 1..self.header.len() {
            if taken + needs(column) > width && blocks.last().is_some_and(|block| block.len() > 1) {
                blocks.push(vec![0]);
                taken = needs(0);
            }
            blocks.last_mut().expect("there is a block").push(column);
            taken += needs(column);
        }
        blocks
    }

    /// Some columns, the widest of them wrapped until all fit.
    fn block(&self, columns: &[usize], width: usize) -> String {
        let mut widths: Vec<usize> = columns.iter().map(|column| self.whole(*column)).collect();
        let taken = |widths: &[usize], padding: usize| widths.iter().map(|width| width + padding).sum::<usize>();
        let is_tight = taken(&widths, PADDING) > width;
        while taken(&widths, TIGHT) > width {
            let foldable = (0..columns.len()).filter(|place| widths[*place] > self.least(columns[*place]));
            let Some(widest) = foldable.max_by_key(|place| widths[*place]) else {
                break;
            };
            widths[widest] -= 1;
        }
        let folded = |row: &[String]| -> Vec<String> {
            let cells = columns.iter().zip(&widths);
            cells
                .map(|(column, width)| row.get(*column).map_or_else(String::new, |cell| fold(cell, *width)))
                .collect()
        };
        let mut table = Table::new();
        table.load_style(STYLE);
        table.set_header(folded(&self.header));
        for row in &self.rows {
            table.add_row(folded(row));
        }
        for (place, column) in columns.iter().enumerate() {
            let Some(drawn) = table.column_mut(place) else { continue };
            if is_tight {
                drawn.set_padding((0, 1));
            }
            if self.numbers.contains(column) {
                drawn.set_cell_alignment(CellAlignment::Right);
            }
        }
        table.to_string()
    }
}

impl Display for Grid {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.laid_out(text::width().unwrap_or(usize::MAX)))
    }
}

fn widest_line(text: &str) -> usize {
    text.lines().map(|line| line.chars().count()).max().unwrap_or(0)
}

fn widest_word(text: &str) -> usize {
    words(text).iter().map(|word| word.chars().count()).max().unwrap_or(0)
}

/// What stands next to a number.
const UNITS: [&str; 33] = [
    "%", "‰", "×", "°", "s", "ms", "µs", "min", "h", "m", "mm", "cm", "m/s", "m/s²", "rad", "rad/s", "mrad/s",
    "rad/s²", "Hz", "kHz", "kg", "g", "N", "mN", "N·m", "mN·m", "V", "mV", "A", "Ah", "Ω", "mΩ", "nats",
];

/// Words that stay in one piece: a number with its unit, both ends of an interval.
fn words(line: &str) -> Vec<String> {
    let mut words: Vec<String> = Vec::new();
    for word in line.split_whitespace() {
        match words.last_mut() {
            Some(last) if belong_together(last, word) => {
                last.push(' ');
                last.push_str(word);
            }
            _ => words.push(word.to_owned()),
        }
    }
    words
}

fn belong_together(last: &str, word: &str) -> bool {
    let is_unit = UNITS.contains(&word.trim_end_matches([',', '.', ';', ':', ')', ']']));
    let is_interval = last.starts_with('[') && last.ends_with(',') && !last.contains(' ') && word.contains(']');
    is_interval || (is_unit && last.ends_with(|c: char| c.is_ascii_digit()))
}

/// Lines of at most `width` characters, broken between words; a number stays with its unit.
pub fn fold(text: &str, width: usize) -> String {
    let mut lines: Vec<String> = Vec::new();
    for line in text.lines() {
        if line.chars().count() <= width {
            lines.push(line.to_owned());
            continue;
        }
        let mut folded = String::new();
        for word in words(line) {
            if !folded.is_empty() && folded.chars().count() + 1 + word.chars().count() > width {
                lines.push(std::mem::take(&mut folded));
            }
            if !folded.is_empty() {
                folded.push(' ');
            }
            folded.push_str(&word);
        }
        lines.push(folded);
    }
    lines.join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid() -> Grid {
        let mut grid = Grid::new(["id", "what it is", "correct windows", "false alarms"]).numbers_from(2);
        grid.add_row([
            "rotor-drag",
            "drag of all rotors together at hover speed per air speed",
            "99.9 %",
            "0",
        ]);
        grid.add_row(["wind", "constant wind", "100.0 %", "12"]);
        grid
    }

    #[test]
    fn val_a_wide_table_is_folded_then_cut_into_blocks() {
        let widest = |text: &str| widest_line(text);
        let free = grid().laid_out(usize::MAX);
        assert_eq!(free.lines().count(), 6);
        let folded = grid().laid_out(50);
        assert!(widest(&folded) <= 50, "{folded}");
        assert_eq!(folded.matches("rotor-drag").count(), 1, "one block:\n{folded}");
        assert!(folded.contains(" 100.0 % "), "numbers keep their unit:\n{folded}");
        for width in 25..=90 {
            let text = grid().laid_out(width);
            assert!(widest(&text) <= width, "{width}:\n{text}");
        }
        let blocks = grid().laid_out(30);
        assert!(widest(&blocks) <= 30, "{blocks}");
        assert!(blocks.matches("rotor-drag").count() > 1, "{blocks}");
        for word in ["together", "windows", "alarms", "12"] {
            assert!(blocks.contains(word), "{word} is missing:\n{blocks}");
        }
    }

    /// The columns of a flight's verdicts, which have to fit 80.
    #[test]
    fn val_numbers_of_texts_keep_their_unit_and_intervals_their_ends() {
        let mut grid = Grid::new([
            "interval",
            "truth",
            "evaluator",
            "verdict at end",
            "correct",
            "delay",
            "false alarms",
        ])
        .numbers_from(4);
        grid.add_row([
            "45.00–60.00 s",
            "rotor 3: −20 % thrust",
            "Sequential detector",
            "rotor 3, lost 19.3 % [18.0, 20.7]",
            "100.0 %",
            "0.188 s",
            "–",
        ]);
        let text = grid.laid_out(80);
        assert!(widest_line(&text) <= 80, "{text}");
        for piece in ["45.00–60.00 s", "−20 %", "19.3 %", "[18.0, 20.7]", "0.188 s"] {
            assert!(text.contains(piece), "'{piece}' is broken:\n{text}");
        }
        assert_eq!(text.matches("45.00–60.00 s").count(), 1, "one block:\n{text}");
        assert_eq!(fold("lost 3.6 % [3.4, 3.8] s", 11), "lost 3.6 %\n[3.4, 3.8]\ns");
        assert_eq!(fold("after 3 s it stands", 8), "after\n3 s it\nstands");
    }

    #[test]
    fn val_lines_are_broken_between_words() {
        assert_eq!(fold("one two  three", 7), "one two\nthree");
        assert_eq!(fold("immovable", 3), "immovable");
        assert_eq!(fold("kept  as it is", 80), "kept  as it is");
        assert_eq!(fold("", 8), "");
    }
}
