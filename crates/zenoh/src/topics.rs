//! zenoh topics other than those of a run: plain bytes, for services that are not part of a flight.
//!
//! The same endpoints and settings as a run's link ([`ZenohOptions`]); no discovery, one side listens.

use crate::endpoint::{failed, open};
use rotortwin_links::security::Runs;
use rotortwin_links::zenoh::ZenohOptions;
use rotortwin_wire::link::LinkError;
use std::fmt;
use zenoh::Wait as _;
use zenoh::pubsub::{Publisher, Subscriber};
use zenoh::qos::CongestionControl;

pub use crate::endpoint::LONGEST_MESSAGE;

/// A connection that subscribes and publishes; ends when it is dropped.
pub struct TopicSession {
    session: zenoh::Session,
    name: String,
}

/// Subscription to a topic until it is dropped.
pub struct TopicSubscriber(Subscriber<()>);

/// Publishes to one topic.
pub struct TopicPublisher(Publisher<'static>);

impl fmt::Debug for TopicSession {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "TopicSession at {}", self.name)
    }
}

impl fmt::Debug for TopicSubscriber {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "TopicSubscriber to {}", self.0.key_expr())
    }
}

impl fmt::Debug for TopicPublisher {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "TopicPublisher to {}", self.0.key_expr())
    }
}

impl TopicSession {
    /// Listens or connects.
    ///
    /// # Errors
    /// The endpoint is invalid or in use, or nothing answers there.
    pub fn open(options: &ZenohOptions) -> Result<Self, LinkError> {
        Ok(Self {
            session: open(options, Runs::All)?,
            name: options.endpoint.clone(),
        })
    }

    /// Calls `heard` with each message of a topic, on a zenoh thread, one at a time.
    ///
    /// # Errors
    /// zenoh rejects the topic.
    pub fn subscribe(
        &self,
        topic: &str,
        heard: impl Fn(&[u8]) + Send + Sync + 'static,
    ) -> Result<TopicSubscriber, LinkError> {
        self.session
            .declare_subscriber(topic.to_owned())
            .callback(move |sample| heard(&sample.payload().to_bytes()))
            .wait()
            .map(TopicSubscriber)
            .map_err(|error| failed(&format!("subscribing to {topic}"), error))
    }

    /// A publisher; blocks on slow receivers.
    ///
    /// # Errors
    /// zenoh rejects the topic.
    pub fn publisher(&self, topic: &str) -> Result<TopicPublisher, LinkError> {
        self.session
            .declare_publisher(topic.to_owned())
            .congestion_control(CongestionControl::Block)
            .express(true)
            .wait()
            .map(TopicPublisher)
            .map_err(|error| failed(&format!("publishing {topic}"), error))
    }
}

impl TopicPublisher {
    /// Sends a message.
    ///
    /// # Errors
    /// It is longer than [`LONGEST_MESSAGE`], or the connection is gone.
    pub fn put(&self, bytes: Vec<u8>) -> Result<(), LinkError> {
        if bytes.len() > LONGEST_MESSAGE {
            let reason = format!("it has {} bytes, at most {LONGEST_MESSAGE} can be sent", bytes.len());
            return Err(failed(&format!("sending to {}", self.0.key_expr()), reason));
        }
        self.0
            .put(bytes)
            .wait()
            .map_err(|error| failed(&format!("sending to {}", self.0.key_expr()), error))
    }
}
