//! Tables of an SQLite database, row by row: the file format alone, without SQL (<https://www.sqlite.org/fileformat2.html>).
//!
//! ```text
//! header of 100 bytes │ pages;   page 1: table of the tables
//! interior page ─▶ pages ─▶ leaf page: rows (rowid, record);   record: serial types, values;   what does not fit ─▶ overflow pages
//! ```
//! Accepts any bytes. Each page is read once: a page with two references is damage, so a file cannot expand beyond its
//! length. Damaged pages cost the rows on them; the rows of the others are read.
//!
//! Limits: indexes, views and tables WITHOUT ROWID are not read, nor is a separate write-ahead log.

/// What every such file begins with.
pub(in super::super) const MAGIC: &[u8] = b"SQLite format 3\0";
/// Bytes of the header.
const HEADER: usize = 100;
/// Deepest tree: 2^31 pages of the smallest size with two children each are fewer levels than this.
const DEEPEST: usize = 40;
const INTERIOR: u8 = 0x05;
const LEAF: u8 = 0x0d;

/// A value of a row.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Value<'a> {
    Null,
    Integer(i64),
    Real(f64),
    /// Text or bytes; text is UTF-8 ([`Database::open`] refuses others).
    Bytes(&'a [u8]),
}

impl<'a> Value<'a> {
    pub(super) fn integer(self) -> Option<i64> {
        match self {
            Self::Integer(value) => Some(value),
            _ => None,
        }
    }

    pub(super) fn bytes(self) -> Option<&'a [u8]> {
        match self {
            Self::Bytes(bytes) => Some(bytes),
            _ => None,
        }
    }

    pub(super) fn text(self) -> Option<&'a str> {
        std::str::from_utf8(self.bytes()?).ok()
    }
}

/// A table: its first page and the names of its columns.
#[derive(Clone, Debug)]
pub(super) struct Table {
    root: usize,
    columns: Vec<String>,
    /// Column that holds the row number, which is not stored in the record.
    rowid: Option<usize>,
}

impl Table {
    /// Place of a column.
    pub(super) fn column(&self, name: &str) -> Option<usize> {
        self.columns.iter().position(|column| column == name)
    }
}

/// A row of a table.
pub(super) struct Row<'a> {
    table: &'a Table,
    number: i64,
    record: &'a [u8],
    /// Byte of the file where its cell begins.
    pub(super) at: u64,
}

impl<'a> Row<'a> {
    /// Value of a column; `None`: the record is damaged or has no such column.
    pub(super) fn value(&self, column: Option<usize>) -> Option<Value<'a>> {
        let wanted = column?;
        if self.table.rowid == Some(wanted) {
            return Some(Value::Integer(self.number));
        }
        let (head, mut types) = varint(self.record)?;
        let head = usize::try_from(head).ok()?;
        let mut left = head.checked_sub(self.record.len() - types.len())?;
        let mut values = self.record.get(head..)?;
        let mut place = 0;
        while left > 0 {
            let (serial, rest) = varint(types)?;
            left = left.checked_sub(types.len() - rest.len())?;
            types = rest;
            let length = match serial {
                0 | 8 | 9 => 0,
                1..=4 => serial,
                5 => 6,
                6 | 7 => 8,
                12.. => (serial - 12) / 2,
                _ => return None,
            };
            let (value, rest) = values.split_at_checked(usize::try_from(length).ok()?)?;
            values = rest;
            if place == wanted {
                return Some(match serial {
                    0 => Value::Null,
                    8 => Value::Integer(0),
                    9 => Value::Integer(1),
                    1..=6 => Value::Integer(integer(value)),
                    7 => Value::Real(f64::from_be_bytes(value.try_into().ok()?)),
                    _ => Value::Bytes(value),
                });
            }
            place += 1;
        }
        None
    }
}

/// Big endian, with its sign.
fn integer(bytes: &[u8]) -> i64 {
    let negative = bytes.first().is_some_and(|first| first & 0x80 != 0);
    bytes.iter().fold(if negative { -1 } else { 0 }, |value, byte| {
        (value << 8) | i64::from(*byte)
    })
}

/// Seven bits per byte, the highest first, eight in a ninth; returns the number and the remaining bytes.
fn varint(bytes: &[u8]) -> Option<(u64, &[u8])> {
    let mut value = 0_u64;
    for (place, byte) in bytes.iter().take(9).enumerate() {
        if place == 8 {
            return Some(((value << 8) | u64::from(*byte), &bytes[9..]));
        }
        value = (value << 7) | u64::from(byte & 0x7f);
        if byte & 0x80 == 0 {
            return Some((value, &bytes[place + 1..]));
        }
    }
    None
}

fn u16_at(bytes: &[u8], at: usize) -> Option<usize> {
    Some(usize::from(u16::from_be_bytes(bytes.get(at..at + 2)?.try_into().ok()?)))
}

fn u32_at(bytes: &[u8], at: usize) -> Option<usize> {
    usize::try_from(u32::from_be_bytes(bytes.get(at..at + 4)?.try_into().ok()?)).ok()
}

/// A row as it stands on a leaf page.
struct Cell<'a> {
    number: i64,
    /// What of its record stands on this page.
    local: &'a [u8],
    /// The page where the rest begins, and the length of the whole record.
    rest: Option<(usize, usize)>,
}

/// A database in memory.
pub(super) struct Database<'a> {
    bytes: &'a [u8],
    page: usize,
    /// Bytes of a page that hold content.
    usable: usize,
    /// Pages that have been read.
    read: Vec<bool>,
    /// Pages that hold no rows though something points to them.
    pub(super) damaged: usize,
    /// Changes may be in a file `…-wal` next to this one.
    pub(super) has_write_ahead_log: bool,
}

impl<'a> Database<'a> {
    /// Reads the header.
    pub(super) fn open(bytes: &'a [u8]) -> Result<Self, String> {
        let header = bytes.get(..HEADER).ok_or_else(|| {
            format!(
                "an SQLite database of {} bytes; its header alone has {HEADER}",
                bytes.len()
            )
        })?;
        let page = match u16_at(header, 16) {
            Some(1) => 1 << 16,
            Some(size) if size.is_power_of_two() && size >= 512 => size,
            other => {
                return Err(format!(
                    "an SQLite database with pages of {} bytes; 512 to 65536 were expected",
                    other.unwrap_or(0)
                ));
            }
        };
        let usable = page - usize::from(header[20]);
        if usable < 480 {
            return Err(format!(
                "an SQLite database of which {} of {page} bytes a page are reserved",
                header[20]
            ));
        }
        if !matches!(u32_at(header, 56), Some(0 | 1)) {
            return Err("an SQLite database with text in UTF-16; UTF-8 was expected".to_owned());
        }
        Ok(Self {
            bytes,
            page,
            usable,
            read: vec![false; bytes.len().div_ceil(page)],
            damaged: 0,
            has_write_ahead_log: header[19] == 2,
        })
    }

    /// A page by its number, from 1, once; `None` for one that is not in the file, is cut, or was read before.
    fn take(&mut self, number: usize) -> Option<&'a [u8]> {
        let place = number.checked_sub(1)?;
        let read = self.read.get_mut(place)?;
        if std::mem::replace(read, true) {
            return None;
        }
        self.bytes.get(place * self.page..(place + 1) * self.page)
    }

    /// Tables by their names.
    pub(super) fn tables(&mut self) -> Result<Vec<(String, Table)>, String> {
        let named = |column: &str| column.to_owned();
        let schema = Table {
            root: 1,
            columns: ["type", "name", "tbl_name", "rootpage", "sql"].map(named).to_vec(),
            rowid: None,
        };
        let mut tables = Vec::new();
        self.rows(
            &schema,
            |_| true,
            |row| {
                let text = |place| row.value(Some(place)).and_then(Value::text);
                let root = row.value(Some(3)).and_then(Value::integer);
                if let (Some("table"), Some(name), Some(root), Some(sql)) = (
                    text(0),
                    text(1),
                    root.and_then(|root| usize::try_from(root).ok()),
                    text(4),
                ) {
                    let (columns, rowid) = columns_of(sql);
                    tables.push((name.to_owned(), Table { root, columns, rowid }));
                }
                Ok(())
            },
        )?;
        Ok(tables)
    }

    /// Calls `each` with every row of a table whose front `wanted` accepts: a row is whole for `each` only, as the rest of a large one
    /// stands on pages of its own. In the order of their numbers.
    ///
    /// # Errors
    /// That of `each`.
    pub(super) fn rows(
        &mut self,
        table: &Table,
        wanted: impl Fn(&Row<'_>) -> bool,
        mut each: impl FnMut(&Row<'_>) -> Result<(), String>,
    ) -> Result<(), String> {
        // Pages to read, the next one last, each with its depth.
        let mut pages = vec![(table.root, 0_usize)];
        let mut whole = Vec::new();
        while let Some((number, depth)) = pages.pop() {
            let Some(page) = self.take(number).filter(|_| depth < DEEPEST) else {
                self.damaged += 1;
                continue;
            };
            let start = (number - 1) * self.page;
            let head = if number == 1 { HEADER } else { 0 };
            let kind = page[head];
            let cells = u16_at(page, head + 3).unwrap_or(0);
            let pointers = head + if kind == INTERIOR { 12 } else { 8 };
            let usable = self.usable;
            let cell = |k: usize| u16_at(page, pointers + 2 * k).filter(|at| *at < usable);
            match kind {
                INTERIOR => {
                    let right = u32_at(page, head + 8);
                    let children = (0..cells).map(|k| u32_at(page, cell(k)?));
                    let mut children: Vec<Option<usize>> = children.chain([right]).collect();
                    children.reverse();
                    for child in children {
                        match child {
                            Some(child) => pages.push((child, depth + 1)),
                            None => self.damaged += 1,
                        }
                    }
                }
                LEAF => {
                    for k in 0..cells {
                        let read = cell(k).and_then(|at| Some((at, self.cell(page, at)?)));
                        let Some((at, Cell { number, local, rest })) = read else {
                            self.damaged += 1;
                            // A page whose pointers lead nowhere has no further rows.
                            break;
                        };
                        let at = (start + at) as u64;
                        let front = Row {
                            table,
                            number,
                            record: local,
                            at,
                        };
                        if !wanted(&front) {
                            continue;
                        }
                        let Some((first, length)) = rest else {
                            each(&front)?;
                            continue;
                        };
                        whole.clear();
                        whole.extend_from_slice(local);
                        if self.overflow(first, length, &mut whole) {
                            each(&Row {
                                table,
                                number,
                                record: &whole,
                                at,
                            })?;
                        } else {
                            self.damaged += 1;
                        }
                    }
                }
                _ => self.damaged += 1,
            }
        }
        Ok(())
    }

    /// The cell of a row; `None`: it is damaged.
    fn cell(&self, page: &'a [u8], at: usize) -> Option<Cell<'a>> {
        let (length, rest) = varint(page.get(at..self.usable)?)?;
        let (number, content) = varint(rest)?;
        let length = usize::try_from(length)
            .ok()
            .filter(|length| *length <= self.bytes.len())?;
        let most = self.usable - 35;
        let local = if length <= most {
            length
        } else {
            let least = (self.usable - 12) * 32 / 255 - 23;
            let fitting = least + (length - least) % (self.usable - 4);
            if fitting <= most { fitting } else { least }
        };
        let record = content.get(..local)?;
        let rest = if local < length {
            Some((u32_at(content, local)?, length))
        } else {
            None
        };
        Some(Cell {
            number: number as i64,
            local: record,
            rest,
        })
    }

    /// Appends overflow pages up to a length; false where they end before.
    fn overflow(&mut self, first: usize, length: usize, whole: &mut Vec<u8>) -> bool {
        let mut next = first;
        while whole.len() < length {
            let Some(page) = self.take(next) else { return false };
            next = u32_at(page, 0).unwrap_or(0);
            let count = (length - whole.len()).min(self.usable - 4);
            whole.extend_from_slice(&page[4..4 + count]);
        }
        true
    }
}

/// Names of the columns in a `CREATE TABLE` statement, and the one that is the row's number.
fn columns_of(sql: &str) -> (Vec<String>, Option<usize>) {
    let (mut columns, mut rowid) = (Vec::new(), None);
    let inner = sql.split_once('(').and_then(|(_, rest)| rest.rsplit_once(')'));
    let (mut depth, mut part) = (0_usize, String::new());
    let mut parts = Vec::new();
    for letter in inner.map_or("", |(inner, _)| inner).chars() {
        match letter {
            '(' => depth += 1,
            ')' => depth = depth.saturating_sub(1),
            ',' if depth == 0 => {
                parts.push(std::mem::take(&mut part));
                continue;
            }
            _ => {}
        }
        part.push(letter);
    }
    parts.push(part);
    for part in parts {
        let name = part.split_whitespace().next().unwrap_or("");
        let word = name.split('(').next().unwrap_or("");
        // Constraints of the whole table follow its columns.
        if ["PRIMARY", "UNIQUE", "CHECK", "FOREIGN", "CONSTRAINT"].contains(&word.to_uppercase().as_str()) {
            break;
        }
        if part.to_uppercase().contains("INTEGER PRIMARY KEY") {
            rowid = Some(columns.len());
        }
        columns.push(name.trim_matches(['"', '`', '[', ']', '\'']).to_lowercase());
    }
    (columns, rowid)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_columns_stand_in_the_statement_that_made_the_table() {
        let (columns, rowid) = columns_of(
            "CREATE TABLE messages(id INTEGER PRIMARY KEY,\"topic_id\" INTEGER NOT NULL, x DECIMAL(3,2), UNIQUE(x))",
        );
        assert_eq!(columns, ["id", "topic_id", "x"]);
        assert_eq!(rowid, Some(0));
    }

    #[test]
    fn val_numbers_of_seven_bits_a_byte() {
        assert_eq!(varint(&[0x7f, 1]), Some((127, &[1][..])));
        assert_eq!(varint(&[0x81, 0x00]), Some((128, &[][..])));
        assert_eq!(varint(&[0xff; 9]).map(|(value, _)| value as i64), Some(-1));
        assert_eq!(varint(&[0x80; 3]), None);
        assert_eq!((integer(&[0xff]), integer(&[0x01, 0x00]), integer(&[])), (-1, 256, 0));
    }
}
