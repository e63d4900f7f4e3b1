//! The container SQLite (`.db3`), which ROS 2 recorded in before Iron, and on request since.
//!
//! ```text
//! topics: id, name, type, serialization_format · messages: topic_id, timestamp (ns), data · message_definitions (since Iron): topic_type, encoding, …
//! ```
//! (<https://github.com/ros2/rosbag2>, `rosbag2_storage_sqlite3`)
//!
//! Recordings from before Iron hold no definitions: those of common messages are built in ([`super::known`]), others
//! are reported as not read.

use super::super::{Asked, SourceLog};
use super::sqlite::{Database, Table, Value};
use super::{Recording, known};
use std::collections::BTreeMap;

/// All texts of definitions together.
const MOST_DEFINITION_BYTES: usize = 1 << 26;
/// What a message begins with that was compressed by itself.
const ZSTD: &[u8] = &[0x28, 0xb5, 0x2f, 0xfd];

/// Definitions by type: encoding and text.
type Definitions = BTreeMap<String, (String, String)>;

fn definitions(database: &mut Database<'_>, table: Option<&Table>) -> Result<Definitions, String> {
    let mut found = Definitions::new();
    let Some(table) = table else { return Ok(found) };
    let places = ["topic_type", "encoding", "encoded_message_definition"].map(|name| table.column(name));
    let mut bytes = 0;
    database.rows(
        table,
        |_| true,
        |row| {
            let [kind, encoding, text] = places.map(|place| row.value(place).and_then(Value::text));
            if let (Some(kind), Some(encoding), Some(text)) = (kind, encoding, text) {
                bytes += kind.len() + text.len();
                if bytes > MOST_DEFINITION_BYTES {
                    return Err(format!(
                        "more than {MOST_DEFINITION_BYTES} bytes of message definitions"
                    ));
                }
                found.insert(kind.to_owned(), (encoding.to_owned(), text.to_owned()));
            }
            Ok(())
        },
    )?;
    Ok(found)
}

/// Reads a recording.
pub(in super::super) fn parse(bytes: &[u8], asked: &Asked<'_>) -> Result<SourceLog, String> {
    let mut database = Database::open(bytes)?;
    let tables = database.tables()?;
    let table = |name: &str| tables.iter().find(|(table, _)| table == name).map(|(_, table)| table);
    let (Some(topics), Some(messages)) = (table("topics"), table("messages")) else {
        let names: Vec<&str> = tables.iter().take(6).map(|(name, _)| name.as_str()).collect();
        return Err(format!(
            "an SQLite database with the tables '{}'; 'topics' and 'messages', as ROS 2 records them, were expected",
            names.join("', '")
        ));
    };
    let definitions = definitions(&mut database, table("message_definitions"))?;
    let mut recording = Recording::new(asked);
    let mut places: BTreeMap<i64, usize> = BTreeMap::new();
    let mut assumed: Vec<String> = Vec::new();
    let columns = ["id", "name", "type", "serialization_format"].map(|name| topics.column(name));
    database.rows(
        topics,
        |_| true,
        |row| {
            let id = row.value(columns[0]).and_then(Value::integer);
            let text = |place: usize| row.value(columns[place]).and_then(Value::text);
            let (Some(id), Some(name), Some(kind)) = (id, text(1), text(2)) else {
                return Ok(());
            };
            let definition = match (text(3).unwrap_or("cdr"), definitions.get(kind)) {
                ("cdr", Some((encoding, text))) if encoding == "ros2msg" => Ok(text.clone()),
                ("cdr", Some((other, _))) if !other.is_empty() && other != "unknown" => {
                    Err(format!("the definition of its messages is in '{other}', not in 'ros2msg'"))
                }
                ("cdr", _) => known::definition(kind).ok_or_else(|| {
                    "the recording holds no definition of its messages, as ROS 2 has written none before Iron; where the package is \
                     installed, 'ros2 bag convert' with 'storage_id: mcap' adds it"
                        .to_owned()
                }),
                (other, _) => Err(super::refused_encoding(other)),
            };
            let place = recording.topic(name, kind, definition.as_deref().map_err(Clone::clone))?;
            if definition.is_ok() && !definitions.contains_key(kind) && recording.wants(place) {
                assumed.push(kind.replace("/msg/", "/"));
            }
            places.insert(id, place);
            Ok(())
        },
    )?;
    let columns = ["topic_id", "timestamp", "data"].map(|name| messages.column(name));
    let topic_of = |row: &super::sqlite::Row<'_>| row.value(columns[0]).and_then(Value::integer);
    let wanted: BTreeMap<i64, bool> = places
        .iter()
        .map(|(id, place)| (*id, recording.wants(*place)))
        .collect();
    let (mut unread, mut odd, mut compressed) = (BTreeMap::<i64, usize>::new(), 0_usize, 0_usize);
    // Of topics that are not read not even the rest of a large message is looked for.
    let left_out = std::cell::RefCell::new(&mut unread);
    database.rows(
        messages,
        |row| {
            let topic = topic_of(row);
            let read = topic.is_none_or(|topic| wanted.get(&topic).copied().unwrap_or(true));
            if let (Some(topic), false) = (topic, read) {
                *left_out.borrow_mut().entry(topic).or_default() += 1;
            }
            read
        },
        |row| {
            let known = topic_of(row).and_then(|topic| places.get(&topic));
            let recorded = row.value(columns[1]).and_then(Value::integer);
            let data = row.value(columns[2]).and_then(Value::bytes);
            let (Some(place), Some(recorded), Some(data)) = (known, recorded, data) else {
                odd += 1;
                return Ok(());
            };
            if data.starts_with(ZSTD) {
                compressed += 1;
                return Ok(());
            }
            recording.message(*place, recorded, row.at, data)
        },
    )?;
    for (id, count) in unread {
        if let Some(place) = places.get(&id) {
            recording.count(*place, count);
        }
    }
    if compressed > 0 {
        return Err(format!(
            "{compressed} messages are compressed one by one; 'ros2 bag convert' without 'compression_mode' makes a recording that is read"
        ));
    }
    if !assumed.is_empty() {
        assumed.sort();
        assumed.dedup();
        recording.notes.push(format!(
            "the recording holds no definitions; those of the packages of ROS 2 are taken for {}",
            assumed.join(", ")
        ));
    }
    if odd > 0 {
        recording
            .notes
            .push(format!("{odd} messages without topic, time or data are left out"));
    }
    if database.damaged > 0 {
        recording.notes.push(format!(
            "{} pages or rows of the database are cut or damaged; what stood there is left out",
            database.damaged
        ));
    }
    if database.has_write_ahead_log {
        recording.notes.push(
            "the database has a write-ahead log: if there is a file with the ending -wal in the same folder, it holds the last messages; \
             'sqlite3 FILE \"PRAGMA wal_checkpoint\"' merges them"
                .to_owned(),
        );
    }
    recording.finish()
}
