//! Numbers out of messages in CDR, as ROS 2 sends them.
//!
//! ```text
//! u16 representation, big endian (0: CDR big endian, 1: little; 6, 7: the same of version 2) │ u16 options │ fields
//! ```
//! A number stands at a multiple of its size, counted from behind these four bytes (version 2: at most of 4); texts and sequences have a
//! u32 length before them, a text's with its NUL. (OMG DDS-XTypes 1.3, §7.4; <https://www.omg.org/spec/DDS-XTYPES/1.3>)
//!
//! A [`Plan`] is made from the definition and the first message: it says which numbers become columns. Long arrays are
//! skipped; of covariances only the first number is kept (−1 means "unknown").

use super::super::{Cursor, Number};
use super::definition::{Count, Definition, Kind};

/// Longest array or sequence in the state of a vehicle.
const LONGEST: usize = 32;
/// Messages in an array whose length is fixed.
const MOST_ELEMENTS: usize = 4096;
/// Messages within messages.
const DEEPEST: usize = 16;
/// Parts of a message with all that it is made of.
const MOST_PARTS: usize = 1 << 14;
/// Bytes that may stay at the end of a message: middleware fills up.
const PADDING: usize = 7;
const HEAD: usize = 4;

/// A message, read from its front.
pub(super) struct Cdr<'a> {
    fields: &'a [u8],
    at: usize,
    big: bool,
    widest: usize,
}

impl<'a> Cdr<'a> {
    pub(super) fn new(message: &'a [u8]) -> Result<Self, String> {
        let (head, fields) = message
            .split_at_checked(HEAD)
            .ok_or_else(|| format!("{} bytes; a CDR message has four before its fields", message.len()))?;
        let representation = u16::from_be_bytes([head[0], head[1]]);
        let (big, widest) = match representation {
            0 => (true, 8),
            1 => (false, 8),
            6 => (true, 4),
            7 => (false, 4),
            other => {
                return Err(format!(
                    "representation {other:#06x}; plain CDR (0, 1, 6 or 7) was expected"
                ));
            }
        };
        Ok(Self {
            fields,
            at: 0,
            big,
            widest,
        })
    }

    fn take(&mut self, count: usize) -> Option<&'a [u8]> {
        let end = self.at.checked_add(count)?;
        let taken = self.fields.get(self.at..end)?;
        self.at = end;
        Some(taken)
    }

    /// To the place of a number.
    fn align(&mut self, bytes: usize) {
        self.at = self.at.next_multiple_of(bytes.min(self.widest));
    }

    fn number(&mut self, number: Number) -> Option<f64> {
        let bytes = number.bytes();
        self.align(bytes);
        let taken = self.take(bytes)?;
        let mut little = [0; 8];
        little[..bytes].copy_from_slice(taken);
        if self.big {
            little[..bytes].reverse();
        }
        number.read(&mut Cursor {
            bytes: &little[..bytes],
        })
    }

    fn pass(&mut self, number: Number, count: usize) -> Option<()> {
        if count > 0 {
            self.align(number.bytes());
            self.take(number.bytes().checked_mul(count)?)?;
        }
        Some(())
    }

    fn length(&mut self) -> Option<usize> {
        self.number(Number::U32).map(|length| length as usize)
    }

    fn text(&mut self) -> Option<&'a [u8]> {
        let length = self.length()?;
        let text = self.take(length)?;
        Some(text.strip_suffix(b"\0").unwrap_or(text))
    }

    fn left(&self) -> usize {
        self.fields.len().saturating_sub(self.at)
    }
}

/// How a part of a message is read.
#[derive(Clone, Debug)]
enum Node {
    /// A number that becomes a column.
    Kept(Number, usize),
    /// Numbers that are passed over.
    Passed(Number, usize),
    Text,
    Group(Vec<Node>),
    /// A sequence of numbers, of which the first become columns.
    Numbers(Number, Vec<Node>),
    /// A sequence of messages or texts: the first ones become columns, the others are passed over.
    Sequence(Vec<Node>, Box<Node>),
}

/// Which numbers of a message become columns.
#[derive(Clone, Debug)]
pub(super) struct Plan {
    root: Node,
    /// Names of the columns: `pose.pose.position.x`, `control[0]`.
    pub(super) fields: Vec<String>,
    /// Texts of the first message.
    pub(super) texts: Vec<(String, String)>,
}

struct Maker<'a, 'b> {
    definition: &'a Definition,
    cdr: Cdr<'b>,
    fields: Vec<String>,
    texts: Vec<(String, String)>,
    parts: usize,
}

fn short(kind: &str) -> String {
    format!("the message ends within {kind}")
}

impl Maker<'_, '_> {
    fn keep(&mut self, number: Number, path: String) -> Result<Node, String> {
        self.cdr.number(number).ok_or_else(|| short(&path))?;
        self.fields.push(path);
        Ok(Node::Kept(number, self.fields.len() - 1))
    }

    /// Counts the parts of a message, and how deep they stand: a definition may name itself.
    fn part(&mut self, parts: usize, depth: usize) -> Result<(), String> {
        self.parts += parts;
        if depth > DEEPEST {
            return Err(format!("messages within messages, deeper than {DEEPEST}"));
        }
        if self.parts > MOST_PARTS {
            return Err(format!("more than {MOST_PARTS} parts"));
        }
        Ok(())
    }

    /// The messages of a place, keeping their numbers.
    fn message(&mut self, place: usize, path: &str, depth: usize) -> Result<Node, String> {
        let definition = self.definition;
        let fields = &definition.messages[place];
        self.part(fields.len(), depth)?;
        if fields.is_empty() {
            return self.passed(Kind::Message(place), depth);
        }
        let mut nodes = Vec::with_capacity(fields.len());
        for field in fields {
            let path = if path.is_empty() {
                field.name.clone()
            } else {
                format!("{path}.{}", field.name)
            };
            nodes.push(match field.count {
                Count::One => self.one(field.kind, path, depth)?,
                Count::Fixed(count) => self.fixed(field.kind, count, &path, depth)?,
                Count::Sequence => self.sequence(field.kind, &path, depth)?,
            });
        }
        Ok(Node::Group(nodes))
    }

    fn one(&mut self, kind: Kind, path: String, depth: usize) -> Result<Node, String> {
        match kind {
            Kind::Number(number) => self.keep(number, path),
            Kind::Text => {
                let text = self.cdr.text().ok_or_else(|| short(&path))?;
                self.texts.push((path, String::from_utf8_lossy(text).into_owned()));
                Ok(Node::Text)
            }
            Kind::WideText => Err(format!("{path} is a wide text, which is not read")),
            Kind::Message(place) => self.message(place, &path, depth + 1),
        }
    }

    fn kept_of(path: &str, count: usize) -> usize {
        if path.ends_with("covariance") {
            count.min(1)
        } else if count > LONGEST {
            0
        } else {
            count
        }
    }

    fn fixed(&mut self, kind: Kind, count: usize, path: &str, depth: usize) -> Result<Node, String> {
        if let Kind::Number(number) = kind {
            let kept = Self::kept_of(path, count);
            let mut nodes = (0..kept)
                .map(|index| self.keep(number, format!("{path}[{index}]")))
                .collect::<Result<Vec<_>, _>>()?;
            self.cdr.pass(number, count - kept).ok_or_else(|| short(path))?;
            nodes.push(Node::Passed(number, count - kept));
            return Ok(Node::Group(nodes));
        }
        if count > MOST_ELEMENTS {
            return Err(format!("{path} has {count} elements; at most {MOST_ELEMENTS} are read"));
        }
        let nodes = (0..count)
            .map(|index| self.element(kind, path, index, depth))
            .collect::<Result<Vec<_>, _>>()?;
        Ok(Node::Group(nodes))
    }

    /// One of several messages or texts: the first ones are kept.
    fn element(&mut self, kind: Kind, path: &str, index: usize, depth: usize) -> Result<Node, String> {
        if index < LONGEST {
            return self.one(kind, format!("{path}[{index}]"), depth);
        }
        let node = self.passed(kind, depth)?;
        node.read(&mut self.cdr, &mut []).ok_or_else(|| short(path))?;
        Ok(node)
    }

    fn sequence(&mut self, kind: Kind, path: &str, depth: usize) -> Result<Node, String> {
        let count = self.cdr.length().ok_or_else(|| short(path))?;
        if let Kind::Number(number) = kind {
            let kept = Self::kept_of(path, count);
            let nodes = (0..kept)
                .map(|index| self.keep(number, format!("{path}[{index}]")))
                .collect::<Result<Vec<_>, _>>()?;
            self.cdr.pass(number, count - kept).ok_or_else(|| short(path))?;
            return Ok(Node::Numbers(number, nodes));
        }
        let other = self.passed(kind, depth)?;
        let nodes = (0..count.min(LONGEST))
            .map(|index| self.element(kind, path, index, depth))
            .collect::<Result<Vec<_>, _>>()?;
        for _ in nodes.len()..count {
            other.read(&mut self.cdr, &mut []).ok_or_else(|| short(path))?;
        }
        Ok(Node::Sequence(nodes, Box::new(other)))
    }

    /// The same without any column; needs no message.
    fn passed(&mut self, kind: Kind, depth: usize) -> Result<Node, String> {
        let place = match kind {
            Kind::Number(number) => return Ok(Node::Passed(number, 1)),
            Kind::Text => return Ok(Node::Text),
            Kind::WideText => return Err("wide texts are not read".to_owned()),
            Kind::Message(place) => place,
        };
        let definition = self.definition;
        let fields = &definition.messages[place];
        self.part(fields.len(), depth)?;
        if fields.is_empty() {
            // A message of nothing has one byte.
            return Ok(Node::Passed(Number::U8, 1));
        }
        let mut node = |field: &super::definition::Field| {
            Ok(match (field.kind, field.count) {
                (Kind::Number(number), Count::Fixed(count)) => Node::Passed(number, count),
                (Kind::Number(number), Count::Sequence) => Node::Numbers(number, Vec::new()),
                (kind, Count::One) => self.passed(kind, depth + 1)?,
                (kind, Count::Sequence) => Node::Sequence(Vec::new(), Box::new(self.passed(kind, depth + 1)?)),
                (kind, Count::Fixed(count)) => {
                    self.part(count, depth)?;
                    Node::Group(vec![self.passed(kind, depth + 1)?; count])
                }
            })
        };
        fields
            .iter()
            .map(&mut node)
            .collect::<Result<Vec<_>, String>>()
            .map(Node::Group)
    }
}

impl Node {
    /// `None`: the message is too short.
    fn read(&self, cdr: &mut Cdr<'_>, values: &mut [f64]) -> Option<()> {
        match self {
            Self::Kept(number, place) => values[*place] = cdr.number(*number)?,
            Self::Passed(number, count) => cdr.pass(*number, *count)?,
            Self::Text => drop(cdr.text()?),
            Self::Group(nodes) => nodes.iter().try_for_each(|node| node.read(cdr, values))?,
            Self::Numbers(number, nodes) => {
                let count = cdr.length()?;
                nodes.iter().take(count).try_for_each(|node| node.read(cdr, values))?;
                cdr.pass(*number, count.saturating_sub(nodes.len()))?;
            }
            Self::Sequence(nodes, other) => {
                let count = cdr.length()?;
                nodes.iter().take(count).try_for_each(|node| node.read(cdr, values))?;
                (nodes.len()..count).try_for_each(|_| other.read(cdr, values))?;
            }
        }
        Some(())
    }
}

impl Plan {
    /// A plan from a definition and a message of it.
    pub(super) fn new(definition: &Definition, message: &[u8]) -> Result<Self, String> {
        let mut maker = Maker {
            definition,
            cdr: Cdr::new(message)?,
            fields: Vec::new(),
            texts: Vec::new(),
            parts: 0,
        };
        let root = maker.message(0, "", 0)?;
        check_end(&maker.cdr)?;
        Ok(Self {
            root,
            fields: maker.fields,
            texts: maker.texts,
        })
    }

    /// A plan for numbers that are read by others.
    pub(super) fn of_names(fields: Vec<String>) -> Self {
        Self {
            root: Node::Group(Vec::new()),
            fields,
            texts: Vec::new(),
        }
    }

    /// The numbers of a message; NaN for elements that it does not have.
    pub(super) fn read(&self, message: &[u8], values: &mut Vec<f64>) -> Result<(), String> {
        let mut cdr = Cdr::new(message)?;
        values.clear();
        values.resize(self.fields.len(), f64::NAN);
        self.root
            .read(&mut cdr, values)
            .ok_or_else(|| format!("{} bytes are fewer than its definition takes", message.len()))?;
        check_end(&cdr)
    }

    pub(super) fn place(&self, field: &str) -> Option<usize> {
        self.fields.iter().position(|known| known == field)
    }

    pub(super) fn text(&self, field: &str) -> Option<&str> {
        self.texts
            .iter()
            .find(|(known, _)| known == field)
            .map(|(_, text)| text.as_str())
    }
}

fn check_end(cdr: &Cdr<'_>) -> Result<(), String> {
    match cdr.left() {
        ..=PADDING => Ok(()),
        left => Err(format!(
            "{left} bytes are left at {}, so its definition is of another version",
            HEAD + cdr.at
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plan(definition: &str, message: &[u8]) -> Result<Plan, String> {
        Plan::new(&Definition::parse("a/B", definition).unwrap(), message)
    }

    fn values(plan: &Plan, message: &[u8]) -> Vec<f64> {
        let mut values = Vec::new();
        plan.read(message, &mut values).unwrap();
        values
    }

    #[test]
    fn val_numbers_stand_at_multiples_of_their_size() {
        // uint8 1, padding to 8, float64 2.5, uint16 7, padding to 4, text "ab\0", padding to 4, sequence of two int16.
        let mut little = vec![0, 1, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0];
        little.extend(2.5_f64.to_le_bytes());
        little.extend([7, 0, 0, 0, 3, 0, 0, 0, b'a', b'b', 0, 0, 2, 0, 0, 0, 5, 0, 255, 255]);
        let definition = "uint8 a\nfloat64 b\nuint16 c\nstring d\nint16[] e\n";
        let plan = plan(definition, &little).unwrap();
        assert_eq!(plan.fields, ["a", "b", "c", "e[0]", "e[1]"]);
        assert_eq!(plan.text("d"), Some("ab"));
        assert_eq!(values(&plan, &little), [1.0, 2.5, 7.0, 5.0, -1.0]);
        // Version 2 has the eight bytes at a multiple of four.
        let mut second = vec![0, 7, 0, 0, 1, 0, 0, 0];
        second.extend(&little[12..]);
        assert_eq!(values(&plan, &second), [1.0, 2.5, 7.0, 5.0, -1.0]);
        let mut big = vec![0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0];
        big.extend(2.5_f64.to_be_bytes());
        big.extend([0, 7, 0, 0, 0, 0, 0, 3, b'a', b'b', 0, 0, 0, 0, 0, 1, 0, 5]);
        let read = values(&plan, &big);
        assert_eq!(read[..4], [1.0, 2.5, 7.0, 5.0]);
        assert!(read[4].is_nan(), "an element that is not there");
    }

    #[test]
    fn val_long_arrays_are_passed_over_and_of_a_covariance_the_first_stays() {
        let mut message = vec![0, 1, 0, 0];
        for value in 0..36 {
            message.extend(f64::from(value - 1).to_le_bytes());
        }
        message.extend([1, 0, 0, 0, 9, 0, 0, 0]);
        let plan = plan("float64[36] pose_covariance\nuint8[] data\n", &message).unwrap();
        assert_eq!(plan.fields, ["pose_covariance[0]", "data[0]"]);
        assert_eq!(values(&plan, &message), [-1.0, 9.0]);
    }

    #[test]
    fn regress_messages_that_do_not_fit_are_said() {
        let message = [0, 1, 0, 0, 1, 2, 3, 4];
        let refused = |definition: &str, message: &[u8]| plan(definition, message).unwrap_err();
        assert!(refused("float64 a", &message).contains("ends within a"));
        assert!(refused("uint8 a", &[&message[..], &[0; 8]].concat()).contains("11 bytes are left at 5"));
        assert!(refused("uint8 a", &[0, 3, 0, 0, 1]).contains("representation 0x0003"));
        assert!(refused("uint8 a", &[0]).contains("four before its fields"));
        // A sequence that says it has four billion elements.
        assert!(refused("float64[] a", &[0, 1, 0, 0, 255, 255, 255, 255]).contains("ends within a"));
        assert!(refused("B[] a", &[0, 1, 0, 0, 255, 255, 255, 255]).contains("deeper than"));
    }
}
