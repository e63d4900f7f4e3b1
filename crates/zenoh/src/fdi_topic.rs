//! A session fed over zenoh, and its client.
//!
//! ```text
//!  key                                  from      to        payload
//!  rotortwin/fdi/SESSION/measurement    client    service   FdiMeasurements
//!  rotortwin/fdi/SESSION/report         service   client    FdiVerdicts, one per measurements message, in order of arrival
//! ```
//! Messages are small enough for one frame of the low-latency transport: at most [`LONGEST_MESSAGE`] bytes, some 600 samples of a
//! hexarotor. A client that loses an answer resends the same message.

use crate::topics::{LONGEST_MESSAGE, TopicPublisher, TopicSession, TopicSubscriber};
use prost::Message as _;
use rotortwin_fdi_session::message::{MessageRefusal, refusal_message};
use rotortwin_fdi_session::{Answer, Chunk, FdiSession};
use rotortwin_proto::{FdiMeasurements, FdiVerdicts};
use rotortwin_wire::convert::ConvertError;
use rotortwin_wire::link::LinkError;
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// Topic for measurements of a session.
pub fn measurement_topic(session: &str) -> String {
    format!("rotortwin/fdi/{session}/measurement")
}

/// Topic of its verdicts.
pub fn report_topic(session: &str) -> String {
    format!("rotortwin/fdi/{session}/report")
}

/// True for a valid part of a topic: 1 to 64 letters, digits, '-' and '_'.
pub fn is_session_name(name: &str) -> bool {
    (1..=64).contains(&name.len())
        && name
            .bytes()
            .all(|b| b.is_ascii_alphanumeric() || matches!(b, b'-' | b'_'))
}

/// Answers one encoded message.
pub fn answer_message(session: &mut FdiSession, bytes: &[u8]) -> (FdiVerdicts, Result<Answer, MessageRefusal>) {
    let rotors = session.rotor_count();
    let decoded = FdiMeasurements::decode(bytes).map_err(|error| ConvertError::Malformed {
        message: "FdiMeasurements",
        reason: error.to_string(),
    });
    let first_step = decoded.as_ref().map_or(0, |message| message.first_step);
    let answer = decoded
        .and_then(|message| Chunk::from_message(&message, rotors))
        .map_err(MessageRefusal::from)
        .and_then(|chunk| session.feed(&chunk).map_err(MessageRefusal::from));
    let message = match &answer {
        Ok(answer) => answer.to_message(rotors),
        Err(refusal) => refusal_message(first_step, session.next_step(), refusal),
    };
    (message, answer)
}

/// Feeds a session from its topic until it is dropped.
#[derive(Debug)]
pub struct TopicService {
    _subscriber: TopicSubscriber,
}

impl TopicService {
    /// * `topics`: must outlive it   * `heard`: called after each message with the result
    ///
    /// # Errors
    /// zenoh cannot subscribe or publish.
    pub fn start(
        topics: &TopicSession,
        name: &str,
        session: Arc<Mutex<FdiSession>>,
        heard: impl Fn(&Result<Answer, MessageRefusal>) + Send + Sync + 'static,
    ) -> Result<Self, LinkError> {
        let publisher = topics.publisher(&report_topic(name))?;
        let subscriber = topics.subscribe(&measurement_topic(name), move |bytes| {
            let (message, answer) = {
                let mut session = session.lock().unwrap_or_else(PoisonError::into_inner);
                answer_message(&mut session, bytes)
            };
            heard(&answer);
            if let Err(error) = publisher.put(message.encode_to_vec()) {
                tracing::warn!(%error, "verdicts cannot be published");
            }
        })?;
        Ok(Self {
            _subscriber: subscriber,
        })
    }
}

/// Why a client gets no verdicts.
#[derive(Debug, thiserror::Error)]
pub enum ClientError {
    /// zenoh fails.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// The message is too long.
    #[error("the message has {found} bytes, expected at most {LONGEST_MESSAGE}; send fewer samples at once")]
    TooLong {
        /// Bytes.
        found: usize,
    },
    /// No answer.
    #[error("no verdicts from {topic} within {waited:?}; expected a service with this session")]
    Silence {
        /// Topic where they were expected.
        topic: String,
        /// How long.
        waited: Duration,
    },
    /// The answer is invalid.
    #[error("a message from {topic} cannot be decoded: {reason}")]
    Malformed {
        /// Topic it came from.
        topic: String,
        /// The decoder's message.
        reason: String,
    },
}

/// A client: sends chunks, waits for verdicts.
#[derive(Debug)]
pub struct TopicClient {
    name: String,
    rotor_count: usize,
    publisher: TopicPublisher,
    answers: Receiver<Vec<u8>>,
    _subscriber: TopicSubscriber,
    _topics: TopicSession,
}

impl TopicClient {
    /// * `rotor_count`: of the session's vehicle
    ///
    /// # Errors
    /// zenoh cannot subscribe or publish.
    pub fn start(topics: TopicSession, name: &str, rotor_count: usize) -> Result<Self, LinkError> {
        let (sender, answers) = channel();
        let subscriber = topics.subscribe(&report_topic(name), move |bytes| {
            // The client may be gone already.
            drop(sender.send(bytes.to_vec()));
        })?;
        Ok(Self {
            name: name.to_owned(),
            rotor_count,
            publisher: topics.publisher(&measurement_topic(name))?,
            answers,
            _subscriber: subscriber,
            _topics: topics,
        })
    }

    /// Sends a chunk and waits for its verdicts.
    ///
    /// # Errors
    /// The message is too long, or no answer arrives in time.
    pub fn feed(&self, chunk: &Chunk, patience: Duration) -> Result<FdiVerdicts, ClientError> {
        self.publisher_put(chunk)?;
        let topic = || report_topic(&self.name);
        loop {
            let bytes = self.answers.recv_timeout(patience).map_err(|error| match error {
                RecvTimeoutError::Timeout | RecvTimeoutError::Disconnected => ClientError::Silence {
                    topic: topic(),
                    waited: patience,
                },
            })?;
            let verdicts = FdiVerdicts::decode(bytes.as_slice()).map_err(|error| ClientError::Malformed {
                topic: topic(),
                reason: error.to_string(),
            })?;
            // Skip the late answer to a message given up earlier.
            if verdicts.first_step == chunk.first_step {
                return Ok(verdicts);
            }
        }
    }

    fn publisher_put(&self, chunk: &Chunk) -> Result<(), ClientError> {
        let bytes = chunk.to_message(self.rotor_count).encode_to_vec();
        if bytes.len() > LONGEST_MESSAGE {
            return Err(ClientError::TooLong { found: bytes.len() });
        }
        Ok(self.publisher.put(bytes)?)
    }
}
