//! Recordings of ROS 2, and the MCAP files of this program's own runs.
//!
//! ```text
//! .mcap (mcap) · .db3 (db3, sqlite) ─▶ topics with their types and definitions ─▶ Recording: numbers of what the mapping names (definition, cdr)
//!     ─▶ one clock (clock) ─▶ one vehicle, the best topic of each type (choose) ─▶ body axes turned to the world (derive) ─▶ SourceLog
//! ```
//! Messages are decoded by the definitions contained in the recording, so every version of `px4_msgs` and every
//! user-defined message can be read; the meaning of a type is given by the mapping (`config/log-mappings/ros2.toml`),
//! which names types (`nav_msgs/Odometry`) or topics (`/drone1/odom`).
//!
//! Limits: ROS 1 messages, encodings other than CDR, and files compressed as a whole are rejected.

mod cdr;
mod choose;
mod clock;
pub(super) mod db3;
mod definition;
mod derive;
mod known;
pub(super) mod mcap;
mod own;
pub(super) mod sqlite;

use super::{Asked, RawStream, Room, SourceLog, Unread};
use cdr::Plan;
use definition::{Definition, plain_name};
use std::collections::BTreeMap;

/// Samples that are left out are reported with the first of their kind.
#[derive(Clone, Debug, Default)]
struct Broken {
    count: usize,
    first: String,
}

/// A topic, or one of several types under one name.
struct Topic {
    name: String,
    /// `package/Name`.
    kind: String,
    /// Of this program's own runs; no definition is needed.
    own: bool,
    /// What its messages are made of, or why they are not read.
    definition: Result<Definition, String>,
    plan: Option<Plan>,
    /// Neither topic nor type is named by the mapping: its messages are counted.
    wanted: bool,
    messages: usize,
    broken: Broken,
    /// When each kept message was recorded, ns.
    recorded_ns: Vec<i64>,
    columns: Vec<Vec<f64>>,
}

/// What has been read so far.
pub(super) struct Recording<'a> {
    asked: &'a Asked<'a>,
    room: Room,
    topics: Vec<Topic>,
    notes: Vec<String>,
    /// Numbers of one message.
    values: Vec<f64>,
}

impl<'a> Recording<'a> {
    fn new(asked: &'a Asked<'a>) -> Self {
        Self {
            asked,
            room: Room::new(asked.most_cells),
            topics: Vec::new(),
            notes: Vec::new(),
            values: Vec::new(),
        }
    }

    /// Adds a topic and returns its index. The definition is that of the recording, or why there is none.
    fn topic(&mut self, name: &str, kind: &str, definition: Result<&str, String>) -> Result<usize, String> {
        self.room.format()?;
        let kind = plain_name(kind);
        let wanted = self.asked.wants(name) || self.asked.wants(&kind);
        let definition = match definition {
            // What is not read need not be understood.
            Ok(text) if wanted => Definition::parse(&kind, text),
            Ok(_) => Err(String::new()),
            Err(reason) => Err(reason),
        };
        self.topics.push(Topic {
            name: name.to_owned(),
            kind,
            own: false,
            definition,
            plan: None,
            wanted,
            messages: 0,
            broken: Broken::default(),
            recorded_ns: Vec::new(),
            columns: Vec::new(),
        });
        Ok(self.topics.len() - 1)
    }

    /// Adds a topic of a run of this program.
    fn own_topic(&mut self, name: &str, kind: &str) -> Result<usize, String> {
        let place = self.topic(name, kind, Ok(""))?;
        self.topics[place].own = true;
        Ok(place)
    }

    /// True where the mapping names a topic or its type.
    fn wants(&self, topic: usize) -> bool {
        self.topics[topic].wanted
    }

    /// Messages of a topic that is not read.
    fn count(&mut self, topic: usize, messages: usize) {
        self.topics[topic].messages += messages;
    }

    /// A message of a topic; `at`: the byte of the file where it, or its container, begins.
    fn message(&mut self, topic: usize, recorded_ns: i64, at: u64, bytes: &[u8]) -> Result<(), String> {
        let topic = &mut self.topics[topic];
        topic.messages += 1;
        let (true, Ok(definition)) = (topic.wanted, &topic.definition) else {
            return Ok(());
        };
        let planned = match &topic.plan {
            Some(_) => Ok(()),
            None if topic.own => own::read(&topic.kind, bytes)
                .map(|values| Plan::of_names(values.into_iter().map(|(name, _)| name).collect()))
                .map(|plan| topic.plan = Some(plan)),
            None => Plan::new(definition, bytes).map(|plan| topic.plan = Some(plan)),
        };
        let read = planned.and_then(|()| match &topic.plan {
            Some(plan) if topic.own => own::read(&topic.kind, bytes).and_then(|values| {
                self.values.clear();
                self.values.extend(values.iter().map(|(_, value)| *value));
                let expected = plan.fields.len();
                (values.len() == expected)
                    .then_some(())
                    .ok_or_else(|| format!("{} numbers; {expected} were expected as in the first", values.len()))
            }),
            Some(plan) => plan.read(bytes, &mut self.values),
            None => Ok(()),
        });
        if topic.columns.is_empty()
            && let Some(plan) = &topic.plan
        {
            self.room.stream(plan.fields.len())?;
            topic.columns = vec![Vec::new(); plan.fields.len()];
        }
        if let Err(reason) = read {
            if topic.broken.count == 0 {
                topic.broken.first = format!("message {} (byte {at} of the file): {reason}", topic.messages);
            }
            topic.broken.count += 1;
            return Ok(());
        }
        self.room.sample(1 + self.values.len())?;
        topic.recorded_ns.push(recorded_ns);
        for (column, value) in topic.columns.iter_mut().zip(&self.values) {
            column.push(*value);
        }
        Ok(())
    }

    /// Streams on one clock, of one vehicle; the error says why nothing is read.
    fn finish(mut self) -> Result<SourceLog, String> {
        let mut unread = Vec::new();
        for topic in &self.topics {
            if topic.messages == 0 {
                continue;
            }
            let reason = match &topic.definition {
                _ if !topic.wanted => format!(
                    "no row of the mapping uses this topic or its type, {} ({} messages)",
                    topic.kind, topic.messages
                ),
                Err(reason) => format!("{}: {reason}", topic.kind),
                Ok(_) if topic.recorded_ns.is_empty() => format!("{}: {}", topic.kind, topic.broken.first),
                Ok(_) => {
                    if topic.broken.count > 0 {
                        self.notes.push(format!(
                            "{}: {} of {} messages are left out, the first: {}",
                            topic.name, topic.broken.count, topic.messages, topic.broken.first
                        ));
                    }
                    continue;
                }
            };
            unread.push(Unread {
                name: topic.name.clone(),
                reason,
            });
        }
        if self.topics.iter().all(|topic| topic.recorded_ns.is_empty()) {
            let few: Vec<String> = unread
                .iter()
                .take(6)
                .map(|one| format!("{}: {}", one.name, one.reason))
                .collect();
            return Err(if few.is_empty() {
                "there is no message in it; the recording of a flight was expected".to_owned()
            } else {
                format!("none of its topics can be read ({})", few.join("; "))
            });
        }
        let mut topics = self.topics;
        topics.retain(|topic| !topic.recorded_ns.is_empty());
        if topics.iter().any(|topic| topic.kind == "rosgraph_msgs/Clock") {
            self.notes.push(
                "there is a topic of type rosgraph_msgs/Clock: time is simulated, or a recording was played again"
                    .to_owned(),
            );
        }
        let (times, clock_s) = clock::one_clock(&topics, &mut self.notes);
        let mut streams: Vec<RawStream> = topics
            .iter_mut()
            .zip(times)
            .filter_map(|(topic, time_s)| stream(topic, time_s, &mut self.notes))
            .collect();
        choose::choose(&mut streams, self.asked, &mut self.notes);
        Ok(SourceLog {
            parameter_changes: Vec::new(),
            streams,
            parameters: BTreeMap::new(),
            notes: self.notes,
            unread,
            clock_s,
            utc: None,
        })
    }
}

/// Why the messages of an encoding are not read.
fn refused_encoding(encoding: &str) -> String {
    let advice = if encoding == "ros1" {
        ", which ROS 1 has; 'rosbags-convert' makes a recording of ROS 2 of it"
    } else {
        ""
    };
    format!("messages are encoded as '{encoding}'{advice}; 'cdr', as ROS 2 has it, was expected")
}

/// The stream of a topic, with derived columns.
fn stream(topic: &mut Topic, time_s: Vec<f64>, notes: &mut Vec<String>) -> Option<RawStream> {
    let plan = topic.plan.take()?;
    let mut stream = RawStream {
        name: topic.name.clone(),
        kind: topic.kind.clone(),
        time_s,
        fields: plan
            .fields
            .iter()
            .cloned()
            .zip(std::mem::take(&mut topic.columns))
            .collect(),
        ..RawStream::default()
    };
    derive::derive(&mut stream, &plan, notes);
    Some(stream)
}
