//! Frames as iceoryx2 shares them between processes.

use iceoryx2::prelude::ZeroCopySend;
use rotortwin_wire::frames::{CommandFrame, FdiReport, SensorFrame};

/// A frame with the name by which processes identify its layout.
pub(crate) trait Named: Copy + std::fmt::Debug + 'static {
    /// The name; must change with the layout.
    const NAME: &'static str;
}

impl Named for SensorFrame {
    const NAME: &'static str = "rotortwin.v1.SensorFrame";
}

impl Named for CommandFrame {
    const NAME: &'static str = "rotortwin.v1.CommandFrame";
}

impl Named for FdiReport {
    const NAME: &'static str = "rotortwin.v1.FdiReport";
}

/// A frame in shared memory.
#[repr(transparent)]
#[derive(Clone, Copy, Debug)]
pub(crate) struct SharedFrame<T>(pub(crate) T);

#[expect(
    unsafe_code,
    reason = "the derive works only in the crate of the frames, which needs no transport"
)]
// SAFETY: `Named` is private to this crate and implemented for frames only: `repr(C)`, integers, floats and arrays of them, no pointers.
unsafe impl<T: Named> ZeroCopySend for SharedFrame<T> {
    unsafe fn type_name() -> &'static str {
        T::NAME
    }
}
