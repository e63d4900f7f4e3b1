//! The few semihosting calls that the board needs (Arm, "Semihosting for AArch32 and AArch64", operations 0x01 to 0x18).

use core::arch::asm;

const SYS_OPEN: u32 = 0x01;
const SYS_WRITE: u32 = 0x05;
const SYS_READ: u32 = 0x06;
const SYS_GET_CMDLINE: u32 = 0x15;
const SYS_EXIT: u32 = 0x18;
/// "r" and "wb" unbuffered.
const MODE_READ: u32 = 1;
const MODE_WRITE: u32 = 5;
const APPLICATION_EXIT: u32 = 0x2_0026;
const RUN_TIME_ERROR: u32 = 0x2_0023;

#[expect(unsafe_code, reason = "the break point is what the emulator listens to")]
fn call(operation: u32, argument: u32) -> u32 {
    let result;
    // SAFETY: every caller passes the block of numbers and the memory that the operation requires.
    unsafe {
        asm!("bkpt 0xAB", inlateout("r0") operation => result, in("r1") argument, options(nostack));
    }
    result
}

/// The value of `arg=` in QEMU's semihosting options.
pub fn command_line(buffer: &mut [u8; 512]) -> &[u8] {
    let mut block = [buffer.as_mut_ptr() as u32, buffer.len() as u32];
    if call(SYS_GET_CMDLINE, block.as_mut_ptr() as u32) != 0 {
        return &[];
    }
    let end = buffer.iter().position(|byte| *byte == 0).unwrap_or(buffer.len());
    &buffer[..end]
}

/// Ends the emulator with exit code 0 or 1.
pub fn exit(good: bool) -> ! {
    let reason = if good { APPLICATION_EXIT } else { RUN_TIME_ERROR };
    loop {
        call(SYS_EXIT, reason);
    }
}

/// An open file of the host.
pub struct Pipe(u32);

impl Pipe {
    pub fn open_to_read(path: &[u8]) -> Option<Self> {
        Self::open(path, MODE_READ)
    }

    pub fn open_to_write(path: &[u8]) -> Option<Self> {
        Self::open(path, MODE_WRITE)
    }

    fn open(path: &[u8], mode: u32) -> Option<Self> {
        let mut name = [0; 256];
        name.get_mut(..path.len())
            .filter(|_| path.len() < 255)?
            .copy_from_slice(path);
        let block = [name.as_ptr() as u32, mode, path.len() as u32];
        let handle = call(SYS_OPEN, block.as_ptr() as u32);
        (handle != u32::MAX).then_some(Self(handle))
    }

    /// Waits for bytes; an empty slice if the other side has closed.
    pub fn read<'a>(&self, buffer: &'a mut [u8]) -> &'a [u8] {
        let block = [self.0, buffer.as_mut_ptr() as u32, buffer.len() as u32];
        let missing = call(SYS_READ, block.as_ptr() as u32) as usize;
        &buffer[..buffer.len().saturating_sub(missing)]
    }

    pub fn write(&self, bytes: &[u8]) -> bool {
        let block = [self.0, bytes.as_ptr() as u32, bytes.len() as u32];
        call(SYS_WRITE, block.as_ptr() as u32) == 0
    }
}
