//! Column metadata of a file.

use parquet::basic::Type as Physical;
use parquet::file::metadata::FileMetaData;
use serde::Serialize;
use std::collections::BTreeMap;

/// One column of a file.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Channel {
    /// Unique.
    pub name: String,
    /// Display unit (`m/s`), `1` for fractions and codes; empty if unknown.
    pub unit: String,
    /// Description; empty if unknown.
    pub description: String,
    /// Type of its values.
    pub kind: ChannelKind,
}

/// Type of the values of a channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum ChannelKind {
    /// Double precision.
    F64,
    /// Single precision.
    F32,
    /// 32-bit integers.
    I32,
    /// 64-bit integers; exact below 2⁵³.
    I64,
    /// Booleans, as 1 and 0.
    Bool,
    /// Text: listed, but not available in queries.
    Text,
    /// Lists and dates: listed, but not available in queries.
    Other,
}

impl From<crate::telemetry::Column> for Channel {
    fn from(column: crate::telemetry::Column) -> Self {
        Self {
            name: column.name,
            unit: column.unit,
            description: column.description,
            kind: match column.kind {
                crate::telemetry::Kind::F64 => ChannelKind::F64,
                crate::telemetry::Kind::F32 => ChannelKind::F32,
                crate::telemetry::Kind::I32 => ChannelKind::I32,
                crate::telemetry::Kind::U64 => ChannelKind::I64,
            },
        }
    }
}

impl ChannelKind {
    /// True if it can be queried.
    pub const fn is_number(self) -> bool {
        !matches!(self, Self::Text | Self::Other)
    }
}

#[derive(serde::Deserialize)]
struct Words {
    #[serde(default)]
    unit: String,
    #[serde(default)]
    description: String,
}

/// Columns of a file in their order.
pub(super) fn channels(metadata: &FileMetaData) -> Vec<Channel> {
    let mut words = words(metadata);
    let columns = metadata.schema_descr().columns().iter();
    columns
        .map(|column| {
            let name = column.path().string();
            let Words { unit, description } = words.remove(&name).unwrap_or(Words {
                unit: String::new(),
                description: String::new(),
            });
            let kind = match column.physical_type() {
                _ if column.max_rep_level() > 0 => ChannelKind::Other,
                Physical::DOUBLE => ChannelKind::F64,
                Physical::FLOAT => ChannelKind::F32,
                Physical::INT32 => ChannelKind::I32,
                Physical::INT64 => ChannelKind::I64,
                Physical::BOOLEAN => ChannelKind::Bool,
                Physical::BYTE_ARRAY => ChannelKind::Text,
                Physical::INT96 | Physical::FIXED_LEN_BYTE_ARRAY => ChannelKind::Other,
            };
            Channel {
                name,
                unit,
                description,
                kind,
            }
        })
        .collect()
}

/// Units and descriptions: of a run from `rotortwin.columns` (JSON), of a flight log from `rotortwin.units` (`name:
/// unit; …`).
fn words(metadata: &FileMetaData) -> BTreeMap<String, Words> {
    let entries = metadata.key_value_metadata().map_or(&[][..], Vec::as_slice);
    let value = |key: &str| {
        let entry = entries.iter().find(|entry| entry.key == key)?;
        entry.value.as_deref()
    };
    if let Some(columns) = value("rotortwin.columns").and_then(|text| serde_json::from_str(text).ok()) {
        return columns;
    }
    let units = value("rotortwin.units").unwrap_or_default().split("; ");
    units
        .filter_map(|entry| entry.split_once(": "))
        .map(|(name, unit)| {
            let words = Words {
                unit: unit.to_owned(),
                description: String::new(),
            };
            (name.to_owned(), words)
        })
        .collect()
}
