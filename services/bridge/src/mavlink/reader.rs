//! Fields of a payload.

use super::frame::Frame;

/// Reads consecutive little-endian fields; past the end they are 0, like omitted bytes.
pub(super) struct Reader<'a>(&'a [u8]);

impl<'a> Reader<'a> {
    pub(super) fn of(frame: &'a Frame) -> Self {
        Self(&frame.payload)
    }

    pub(super) fn take<const N: usize>(&mut self) -> [u8; N] {
        let mut field = [0; N];
        let n = N.min(self.0.len());
        field[..n].copy_from_slice(&self.0[..n]);
        self.0 = &self.0[n..];
        field
    }
}
