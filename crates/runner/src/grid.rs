//! Tables that fit the terminal: words are never broken, numbers never separated from their unit.
//!
//! If a table is too wide, its headings are wrapped first, then the longest texts; if that is not enough, it is printed in blocks of columns,
//! each repeating the first column.

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
        let needs = |column: usize| self.least(column) + PADDING;
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
        while widths.iter().map(|width| width + PADDING).sum::<usize>() > width {
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
            if let (true, Some(column)) = (self.numbers.contains(column), table.column_mut(place)) {
                column.set_cell_alignment(CellAlignment::Right);
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
    text.split_whitespace()
        .map(|word| word.chars().count())
        .max()
        .unwrap_or(0)
}

/// Lines of at most `width` characters, broken between words.
pub fn fold(text: &str, width: usize) -> String {
    let mut lines: Vec<String> = Vec::new();
    for line in text.lines() {
        if line.chars().count() <= width {
            lines.push(line.to_owned());
            continue;
        }
        let mut folded = String::new();
        for word in line.split_whitespace() {
            if !folded.is_empty() && folded.chars().count() + 1 + word.chars().count() > width {
                lines.push(std::mem::take(&mut folded));
            }
            if !folded.is_empty() {
                folded.push(' ');
            }
            folded.push_str(word);
        }
        lines.push(folded);
    }
    lines.join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid() -> Grid {
        let mut grid = Grid::new(["id", "what it is", "right windows", "false alarms"]).numbers_from(2);
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
        for width in 26..=90 {
            let text = grid().laid_out(width);
            assert!(widest(&text) <= width, "{width}:\n{text}");
        }
        let blocks = grid().laid_out(34);
        assert!(widest(&blocks) <= 34, "{blocks}");
        assert!(blocks.matches("rotor-drag").count() > 1, "{blocks}");
        for word in ["together", "windows", "alarms", "12"] {
            assert!(blocks.contains(word), "{word} is missing:\n{blocks}");
        }
    }

    #[test]
    fn val_lines_are_broken_between_words() {
        assert_eq!(fold("one two  three", 7), "one two\nthree");
        assert_eq!(fold("immovable", 3), "immovable");
        assert_eq!(fold("kept  as it is", 80), "kept  as it is");
        assert_eq!(fold("", 8), "");
    }
}
