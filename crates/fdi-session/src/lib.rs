//! FDI of flights that somebody else flies: measurements in, verdicts out.
//!
//! ```text
//!  HTTP chunk, WebSocket, zenoh topic, log file ─▶ Chunk ─▶ FdiSession ─▶ Answer{windows, notes} ─▶ back the same way
//! ```
//! * [`session`]: the engine of a run behind rules for what may come in: rate, order, gaps, repetition.
//! * [`message`]: chunks and answers as protobuf messages.
//! * [`validity`]: whether a verdict means anything.
//! * [`second_look`]: how large a loss is now, and what else would explain it.
//! * [`evidence`]: what the improved network says over time, in place of each window alone.
//! * [`learnt`]: what healthy flights say of the vehicle beyond its model.
//!
//! No vehicle file, no plant and no link is known here: a session takes the engine's configuration, as the FDI process of a run does.

pub mod evidence;
pub mod learnt;
pub mod message;
pub mod second_look;
pub mod session;
pub mod validity;

pub use evidence::NetworkOverTime;
pub use learnt::{Learner, Learnt};
pub use second_look::{Details, Explained, ExplanationKind, Interval, LoadChange, Motion};
pub use session::{Answer, Calibration, Chunk, FdiSession, Refusal, Sample, Window};
