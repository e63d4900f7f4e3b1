//! PX4's boot loader: flashing a board over its serial or USB port.
//!
//! ```text
//!  host ── GET_SYNC ──▶   ── GET_DEVICE (revision, board, flash) ──▶   ── CHIP_ERASE ──▶
//!       ── PROG_MULTI, 252 bytes each … ──▶   ── GET_CRC ──▶   ── REBOOT ──▶
//! ```
//! Every command ends with EOC; every answer ends with INSYNC and a status (facts from PX4-Bootloader `bl.c` and PX4 `px_uploader.py`,
//! protocol revision 5). The boot loader writes the first word last, when the CRC has been requested and the board is told to start:
//! an interrupted flash leaves a board that stays in its boot loader, and can be flashed again.
//!
//! Rejected before anything is erased: a file for another board, one that does not fit, a boot loader of an unknown revision.

use crate::line::Line;
use crate::px4_file::Px4File;
use crc::Crc;
use std::time::Duration;

const INSYNC: u8 = 0x12;
const EOC: u8 = 0x20;
const OK: u8 = 0x10;
const FAILED: u8 = 0x11;
const INVALID: u8 = 0x13;
const GET_SYNC: u8 = 0x21;
const GET_DEVICE: u8 = 0x22;
const CHIP_ERASE: u8 = 0x23;
const PROG_MULTI: u8 = 0x27;
const GET_CRC: u8 = 0x29;
const REBOOT: u8 = 0x30;

const DEVICE_REVISION: u8 = 1;
const DEVICE_BOARD: u8 = 2;
const DEVICE_FLASH: u8 = 4;

/// Supported protocol revisions; revision 2 has no CRC.
const REVISIONS: core::ops::RangeInclusive<u32> = 3..=5;

/// Maximum bytes of one `PROG_MULTI`: whole words below 256.
const PIECE: usize = 252;

/// Answers to simple commands.
const SHORT: Duration = Duration::from_secs(2);

/// Erasing 15 sectors of 128 KiB takes an STM32H7 up to 2 s each by its data sheet.
const ERASE: Duration = Duration::from_secs(40);

/// The boot loader reads back the whole flash for its CRC.
const CHECK: Duration = Duration::from_secs(15);

/// Board information from a boot loader.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Device {
    /// Of the protocol.
    pub revision: u32,
    /// 56 is the Pixhawk 6C.
    pub board_id: u32,
    /// Space for a program, bytes.
    pub flash: u32,
}

/// Progress of flashing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Progress {
    /// The board has answered.
    Found(Device),
    /// Erasing.
    Erasing,
    /// Bytes written, of all.
    Writing(usize, usize),
    /// Comparing the CRC.
    Checking,
    /// Starting the program.
    Starting,
}

/// A board in its boot loader.
pub struct BootLoader<L> {
    line: L,
    received: Vec<u8>,
}

impl<L: Line> BootLoader<L> {
    /// Waits for a boot loader to answer, at most for `patience`.
    pub fn find(line: L, patience: Duration) -> Result<Self, String> {
        let mut found = Self {
            line,
            received: Vec::new(),
        };
        let end = found.line.now() + patience;
        loop {
            found.forget_input()?;
            let asked = found.line.now();
            if found.command(&[GET_SYNC], 0, Duration::from_millis(300)).is_ok() {
                return Ok(found);
            }
            if found.line.now() >= end {
                return Err(format!(
                    "no boot loader answered within {:.0} s: replug the board's USB (its boot loader listens for 5 s), or start the boot loader \
                     with 'rotortwin board boot-loader'",
                    patience.as_secs_f64()
                ));
            }
            // A missing port fails at once.
            let spent = found.line.now().saturating_sub(asked);
            std::thread::sleep(Duration::from_millis(100).saturating_sub(spent));
        }
    }

    /// Identifies the board.
    pub fn device(&mut self) -> Result<Device, String> {
        let mut field = |which: u8| {
            let answer = self.command(&[GET_DEVICE, which], 4, SHORT)?;
            Ok::<u32, String>(word(&answer))
        };
        Ok(Device {
            revision: field(DEVICE_REVISION)?,
            board_id: field(DEVICE_BOARD)?,
            flash: field(DEVICE_FLASH)?,
        })
    }

    /// Erases, writes, verifies and starts.
    pub fn flash(mut self, file: &Px4File, mut progress: impl FnMut(Progress)) -> Result<(), String> {
        let device = self.device()?;
        progress(Progress::Found(device));
        if !REVISIONS.contains(&device.revision) {
            return Err(format!(
                "the boot loader uses revision {} of its protocol, expected {} to {}; nothing was erased",
                device.revision,
                REVISIONS.start(),
                REVISIONS.end()
            ));
        }
        if device.board_id != file.board_id {
            return Err(format!(
                "the file is for boards {}, this is a board {}; nothing was erased",
                file.board_id, device.board_id
            ));
        }
        if file.image.len() > device.flash as usize {
            return Err(format!(
                "the program has {} bytes, the board's flash takes {}; nothing was erased",
                file.image.len(),
                device.flash
            ));
        }
        progress(Progress::Erasing);
        self.command(&[CHIP_ERASE], 0, ERASE)
            .map_err(|error| format!("erasing: {error}"))?;
        let mut written = 0;
        for piece in file.image.chunks(PIECE) {
            progress(Progress::Writing(written, file.image.len()));
            let mut command = vec![PROG_MULTI, piece.len() as u8];
            command.extend(piece);
            self.command(&command, 0, SHORT)
                .map_err(|error| format!("writing at byte {written}: {error}; flash the board again"))?;
            written += piece.len();
        }
        progress(Progress::Writing(written, file.image.len()));
        progress(Progress::Checking);
        let answer = self
            .command(&[GET_CRC], 4, CHECK)
            .map_err(|error| format!("comparing: {error}"))?;
        let (found, expected) = (word(&answer), crc(&file.image, device.flash as usize));
        if found != expected {
            return Err(format!(
                "the board's flash has the CRC {found:08x}, the program's is {expected:08x}: writing failed; flash the board again"
            ));
        }
        progress(Progress::Starting);
        self.command(&[REBOOT], 0, SHORT)
            .map_err(|error| format!("starting the program: {error}"))?;
        Ok(())
    }

    fn forget_input(&mut self) -> Result<(), String> {
        self.received.clear();
        let mut buffer = [0; 256];
        while self.line.receive(&mut buffer, Duration::ZERO)? > 0 {}
        Ok(())
    }

    /// Sends a command; returns the `length` bytes before the status.
    fn command(&mut self, command: &[u8], length: usize, wait: Duration) -> Result<Vec<u8>, String> {
        let mut bytes = command.to_vec();
        bytes.push(EOC);
        self.line.send(&bytes)?;
        let end = self.line.now() + wait;
        let mut buffer = [0; 256];
        while self.received.len() < length + 2 {
            let now = self.line.now();
            if now >= end {
                return Err(format!("no answer within {:.1} s", wait.as_secs_f64()));
            }
            let count = self.line.receive(&mut buffer, end - now)?;
            self.received.extend(&buffer[..count]);
            // An error carries no data.
            if let [INSYNC, status @ (FAILED | INVALID)] = self.received[..] {
                self.received.clear();
                return Err(refusal(status));
            }
        }
        let rest = self.received.split_off(length + 2);
        let mut answer = std::mem::replace(&mut self.received, rest);
        match answer[length..] {
            [INSYNC, OK] => {
                answer.truncate(length);
                Ok(answer)
            }
            [INSYNC, status] => Err(refusal(status)),
            _ => Err(format!("not a reply of a boot loader: {:02x?}", &answer)),
        }
    }
}

fn refusal(status: u8) -> String {
    match status {
        FAILED => "the boot loader reports a failure".to_owned(),
        INVALID => "the boot loader does not know the command".to_owned(),
        other => format!("the boot loader replies with status {other:#04x}"),
    }
}

fn word(bytes: &[u8]) -> u32 {
    bytes
        .first_chunk()
        .map_or(0, |bytes: &[u8; 4]| u32::from_le_bytes(*bytes))
}

/// As computed by the boot loader: Ethernet polynomial, initial value 0, not inverted.
const CRC_OF_FLASH: Crc<u32> = Crc::<u32>::new(&crc::Algorithm {
    init: 0,
    xorout: 0,
    check: 0x2DFD_2D88,
    residue: 0,
    ..crc::CRC_32_ISO_HDLC
});

/// CRC-32 of the program and of the erased flash after it.
pub fn crc(image: &[u8], flash: usize) -> u32 {
    let mut digest = CRC_OF_FLASH.digest();
    digest.update(image);
    for _ in image.len()..flash {
        digest.update(&[0xFF]);
    }
    digest.finalize()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_crc_against_python() {
        // zlib.crc32(b'123456789\xff\xff\xff', 0xffffffff) ^ 0xffffffff starts from 0 and is not inverted.
        assert_eq!(crc(b"123456789", 12), CRC_OF_PYTHON);
    }

    const CRC_OF_PYTHON: u32 = 0x0CBE_B849;
}
