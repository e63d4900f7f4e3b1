//! Message definitions as ROS 2 bags carry them ("ros2msg"): the message, then every message that it is made of.
//!
//! ```text
//! std_msgs/Header header
//! float64[36] covariance      # a comment
//! uint8 LIMIT=4               # a constant takes no bytes
//! ================================================================================
//! MSG: std_msgs/Header
//! builtin_interfaces/Time stamp
//! string frame_id
//! ```
//! (<https://mcap.dev/spec/registry>, "ros2msg"; <https://docs.ros.org/en/rolling/Concepts/Basic/About-Interfaces.html>)

use super::super::Number;
use std::collections::BTreeMap;

/// Longest definition; real ones have some kilobytes.
const MOST_BYTES: usize = 1 << 20;
/// Most fields of a message with all that it is made of.
const MOST_FIELDS: usize = 1 << 14;

/// Content of a field.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Kind {
    Number(Number),
    Text,
    /// Text of wide characters: two or four bytes each, as the middleware likes; such messages are not read.
    WideText,
    /// Place in [`Definition::messages`].
    Message(usize),
}

/// How many of them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Count {
    One,
    Fixed(usize),
    /// The message says how many.
    Sequence,
}

/// One field of a message.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Field {
    pub(super) name: String,
    pub(super) kind: Kind,
    pub(super) count: Count,
}

/// A message and those that it is made of; the first is the message itself.
#[derive(Clone, Debug)]
pub(super) struct Definition {
    pub(super) messages: Vec<Vec<Field>>,
}

/// `package/msg/Name` and `package/Name` are the same.
pub(super) fn plain_name(name: &str) -> String {
    name.replace("/msg/", "/")
}

fn primitive(name: &str) -> Option<Kind> {
    Some(match name {
        "bool" | "byte" | "char" | "uint8" => Kind::Number(Number::U8),
        "int8" => Kind::Number(Number::I8),
        "int16" => Kind::Number(Number::I16),
        "uint16" => Kind::Number(Number::U16),
        "int32" => Kind::Number(Number::I32),
        "uint32" => Kind::Number(Number::U32),
        "int64" => Kind::Number(Number::I64),
        "uint64" => Kind::Number(Number::U64),
        "float32" => Kind::Number(Number::F32),
        "float64" => Kind::Number(Number::F64),
        "string" => Kind::Text,
        "wstring" => Kind::WideText,
        _ => return None,
    })
}

/// A field before its type is looked up.
struct Line<'a> {
    kind: &'a str,
    name: &'a str,
    count: Count,
}

/// A line of a definition; `None`: a constant, a comment, nothing.
fn line(text: &str) -> Result<Option<Line<'_>>, String> {
    let text = text.split('#').next().unwrap_or("").trim();
    let Some((kind, rest)) = text.split_once(char::is_whitespace) else {
        return if text.is_empty() {
            Ok(None)
        } else {
            Err(format!("'{text}': expected a type and a name"))
        };
    };
    let rest = rest.trim_start();
    let name = rest.split(char::is_whitespace).next().unwrap_or("");
    // `TYPE NAME=VALUE` and `TYPE NAME = VALUE`; a default value has no equals sign before it.
    if name.contains('=') || rest[name.len()..].trim_start().starts_with('=') {
        return Ok(None);
    }
    let (kind, count) = match kind.split_once('[') {
        None => (kind, Count::One),
        Some((kind, count)) => {
            let count = count.trim_end_matches(']');
            if count.is_empty() || count.starts_with("<=") {
                (kind, Count::Sequence)
            } else {
                let count = count.parse().ok().filter(|count| *count > 0);
                let count = count.ok_or_else(|| format!("'{text}': expected a number of elements"))?;
                (kind, Count::Fixed(count))
            }
        }
    };
    // `string<=10`: at most ten letters.
    let kind = kind.split("<=").next().unwrap_or(kind);
    Ok(Some(Line { kind, name, count }))
}

impl Definition {
    /// Parses a definition of the message `name`.
    pub(super) fn parse(name: &str, text: &str) -> Result<Self, String> {
        if text.len() > MOST_BYTES {
            return Err(format!(
                "a definition of {} bytes; at most {MOST_BYTES} are taken",
                text.len()
            ));
        }
        // Sections are parted by a line of equals signs.
        let mut sections: Vec<(String, Vec<Line<'_>>)> = vec![(plain_name(name), Vec::new())];
        let mut fields = 0_usize;
        let mut begins = false;
        for text in text.lines() {
            if text.len() >= 8 && text.bytes().all(|byte| byte == b'=') {
                begins = true;
            } else if let (true, Some(name)) = (begins, text.trim().strip_prefix("MSG:")) {
                sections.push((plain_name(name.trim()), Vec::new()));
                begins = false;
            } else if let Some(line) = line(text)? {
                fields += 1;
                if fields > MOST_FIELDS {
                    return Err(format!("a definition of more than {MOST_FIELDS} fields"));
                }
                if let Some((_, lines)) = sections.last_mut() {
                    lines.push(line);
                }
            }
        }
        for name in ["builtin_interfaces/Time", "builtin_interfaces/Duration"] {
            if !sections.iter().any(|(known, _)| known == name) {
                let part = |kind, name| Line {
                    kind,
                    name,
                    count: Count::One,
                };
                sections.push((name.to_owned(), vec![part("int32", "sec"), part("uint32", "nanosec")]));
            }
        }
        let places: BTreeMap<&str, usize> = sections
            .iter()
            .enumerate()
            .rev()
            .map(|(index, (name, _))| (name.as_str(), index))
            .collect();
        let messages = sections
            .iter()
            .map(|(owner, lines)| {
                let package = owner.split('/').next().unwrap_or("");
                let field = |line: &Line<'_>| {
                    let full = plain_name(line.kind);
                    let local = format!("{package}/{full}");
                    let place = || places.get(full.as_str()).or_else(|| places.get(local.as_str()));
                    let header = || (full == "Header").then(|| places.get("std_msgs/Header")).flatten();
                    let kind = primitive(&full)
                        .or_else(|| place().or_else(header).map(|index| Kind::Message(*index)))
                        .ok_or_else(|| format!("the definition of {owner} names {full}, which it does not hold"))?;
                    Ok(Field {
                        name: line.name.to_owned(),
                        kind,
                        count: line.count,
                    })
                };
                lines.iter().map(field).collect::<Result<Vec<_>, String>>()
            })
            .collect::<Result<Vec<_>, String>>()?;
        Ok(Self { messages })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const POSE: &str = "# A pose\nstd_msgs/Header header\nPoint position\nfloat64[36] covariance # row-major\nuint8 KIND=4\nstring \
        NAME = \"a=b\"\nint32[<=5] few\nstring<=10 label\nint32 with_default 7\n\
        ================================================================================\nMSG: std_msgs/Header\nbuiltin_interfaces/Time \
        stamp\nstring frame_id\n\
        ================================================================================\nMSG: geometry_msgs/Point\nfloat64 x\nfloat64 y\nfloat64 \
        z\n";

    #[test]
    fn val_a_definition_with_what_it_is_made_of() {
        let definition = Definition::parse("geometry_msgs/msg/Pose", POSE).unwrap();
        let root = &definition.messages[0];
        let names: Vec<&str> = root.iter().map(|field| field.name.as_str()).collect();
        assert_eq!(
            names,
            ["header", "position", "covariance", "few", "label", "with_default"]
        );
        assert_eq!(root[0].kind, Kind::Message(1));
        assert_eq!(root[1].kind, Kind::Message(2));
        assert_eq!(root[2].count, Count::Fixed(36));
        assert_eq!(
            (root[3].kind, root[3].count),
            (Kind::Number(Number::I32), Count::Sequence)
        );
        assert_eq!(root[4].kind, Kind::Text);
        // Time is known without its section.
        assert_eq!(definition.messages[3].len(), 2);
    }

    #[test]
    fn regress_what_is_no_definition_is_said() {
        let refused = |text: &str| Definition::parse("a/B", text).unwrap_err();
        assert!(refused("c/Unknown x").contains("c/Unknown, which it does not hold"));
        assert!(refused("float64").contains("a type and a name"));
        assert!(refused("float64[x] y").contains("number of elements"));
        assert!(refused("float64[0] y").contains("number of elements"));
    }
}
