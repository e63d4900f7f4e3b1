//! FDI for third-party flights: measurements in, verdicts out.
//!
//! ```text
//!  HTTP chunk, WebSocket, zenoh topic, log file ─▶ Chunk ─▶ FdiSession ─▶ Answer{windows, notes} ─▶ back the same way
//! ```
//! * [`session`]: the engine of a run behind rules for its input: rate, order, gaps, repetition.
//! * [`message`]: chunks and answers as protobuf messages.
//! * [`validity`]: whether a verdict means anything.
//! * [`second_look`]: the current size of a loss, and its alternative explanations.
//! * [`evidence`]: verdicts of the improved network over time, instead of window by window.
//! * [`words`]: a verdict in plain words.
//! * [`learnt`]: what healthy flights reveal about the vehicle beyond its model.
//!
//! This crate knows no vehicle file, plant or link: a session takes the engine's configuration, as the FDI process of a
//! run does.

pub mod evidence;
pub mod learnt;
pub mod message;
pub mod second_look;
pub mod session;
pub mod validity;
pub mod words;

pub use evidence::NetworkOverTime;
pub use learnt::{Learner, Learnt};
pub use second_look::{Details, Explained, ExplanationKind, Interval, LoadChange, Motion};
pub use session::{Answer, Calibration, Chunk, FdiSession, Refusal, Sample, Window};
