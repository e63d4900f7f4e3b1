//! Flashing an emulated boot loader behind a pseudo-terminal: exercises the code of a real port.
//!
//! The emulation follows PX4-Bootloader's `bl.c`, not the code under test: commands are parsed byte by byte, the first word is withheld
//! until the board is told to start, and the CRC covers the whole flash.

#[expect(unreachable_pub, reason = "public in the crate that the file is of")]
#[path = "../../../tests/src/skip.rs"]
mod skip;

use rotortwin_bridge::boot_loader::{BootLoader, Device, Progress, crc};
use rotortwin_bridge::line::{FileLine, Terminal};
use rotortwin_bridge::px4_file::Px4File;
use std::sync::mpsc;
use std::time::Duration;

/// Flash of a Pixhawk 6C after its boot loader, bytes.
const FLASH: u32 = 1_966_080;
const PATIENCE: Duration = Duration::from_secs(5);

/// Misbehaviour of the emulated board.
#[derive(Clone, Copy, Debug, Default)]
struct Fault {
    /// Ignores the first bytes, like a board that is still starting.
    deaf_bytes: usize,
    /// This byte of flash cannot be written.
    stuck_byte: Option<usize>,
    /// Answers the erase with FAILED.
    no_erase: bool,
    /// Stops answering after this many `PROG_MULTI`.
    dies_after: Option<usize>,
    /// Starts with output of a program that has just ended.
    garbage: bool,
}

/// Final state of the board.
#[derive(Debug, Default)]
struct Board {
    flash: Vec<u8>,
    erased: bool,
    started: bool,
}

/// Serves one terminal until it closes or the program starts.
fn boot_loader(terminal: &Terminal, board_id: u32, revision: u32, fault: Fault) -> Board {
    let mut board = Board {
        flash: vec![0xAA; FLASH as usize],
        ..Board::default()
    };
    let mut deaf = fault.deaf_bytes;
    let mut next = || loop {
        let byte = terminal.read_byte()?;
        if deaf == 0 {
            return Some(byte);
        }
        deaf -= 1;
    };
    if fault.garbage {
        terminal.write(&[0x00, 0x12, 0x11, 0x41]);
    }
    let (mut address, mut first_word, mut pieces) = (0, [0xFF; 4], 0);
    while let Some(command) = next() {
        let ok = [0x12, 0x10];
        let mut answer = Vec::new();
        match command {
            0x22 => {
                let Some(which) = next() else { break };
                let value = match which {
                    1 => revision,
                    2 => board_id,
                    4 => FLASH,
                    _ => 0,
                };
                answer.extend(value.to_le_bytes());
            }
            0x23 => {
                board.erased = true;
                board.flash.fill(0xFF);
                address = 0;
            }
            0x27 => {
                let Some(length) = next() else { break };
                let piece: Vec<u8> = (0..length).map_while(|_| next()).collect();
                pieces += 1;
                if fault.dies_after.is_some_and(|count| pieces > count) {
                    while next().is_some() {}
                    break;
                }
                for byte in piece {
                    if address < 4 {
                        first_word[address] = byte;
                    } else if Some(address) != fault.stuck_byte {
                        board.flash[address] = byte;
                    }
                    address += 1;
                }
            }
            0x29 => {
                let mut flash = board.flash.clone();
                flash[..4].copy_from_slice(&first_word);
                answer.extend(crc(&flash, flash.len()).to_le_bytes());
            }
            0x21 | 0x30 => {}
            _ => {
                terminal.write(&[0x12, 0x13]);
                continue;
            }
        }
        if next() != Some(0x20) {
            terminal.write(&[0x12, 0x13]);
            continue;
        }
        if command == 0x23 && fault.no_erase {
            terminal.write(&[0x12, 0x11]);
            continue;
        }
        if command == 0x30 {
            board.flash[..4].copy_from_slice(&first_word);
            board.started = true;
        }
        answer.extend(ok);
        terminal.write(&answer);
        if board.started {
            break;
        }
    }
    board
}

fn program(board_id: u32, length: usize) -> Px4File {
    Px4File {
        board_id,
        summary: "test".to_owned(),
        image: (0..length).map(|k| (k * 7 % 251) as u8).collect(),
    }
}

/// Flashes; returns the host's result, its progress reports, and the final state of the board.
fn flash(file: &Px4File, revision: u32, fault: Fault) -> (Result<(), String>, Vec<Progress>, Board) {
    let terminal = Terminal::open().expect("a terminal");
    let line = FileLine::serial(terminal.path(), 115_200).expect("a port");
    let (send, receive) = mpsc::channel();
    let board = std::thread::spawn(move || {
        let board = boot_loader(&terminal, 56, revision, fault);
        // The terminal lives until the host has finished.
        receive.recv().expect("the host is done");
        board
    });
    let mut steps = Vec::new();
    let result = BootLoader::find(line, PATIENCE).and_then(|found| found.flash(file, |step| steps.push(step)));
    send.send(()).expect("the board waits");
    (result, steps, board.join().expect("the board ends"))
}

#[test]
fn val_program_arrives_and_starts() {
    for fault in [
        Fault::default(),
        Fault {
            deaf_bytes: 5,
            ..Fault::default()
        },
        Fault {
            garbage: true,
            ..Fault::default()
        },
    ] {
        // Not a multiple of 252 bytes.
        let file = program(56, 10_004);
        let (result, steps, board) = flash(&file, 5, fault);
        assert_eq!(result, Ok(()), "{fault:?}");
        assert_eq!(board.flash[..10_004], file.image);
        assert!(board.flash[10_004..].iter().all(|byte| *byte == 0xFF));
        assert!(board.started);
        let device = Device {
            revision: 5,
            board_id: 56,
            flash: FLASH,
        };
        assert_eq!(steps[..2], [Progress::Found(device), Progress::Erasing]);
        assert_eq!(
            steps[steps.len() - 3..],
            [
                Progress::Writing(10_004, 10_004),
                Progress::Checking,
                Progress::Starting
            ]
        );
    }
}

#[test]
fn val_what_does_not_fit_the_board_is_refused_before_anything_is_erased() {
    for (file, revision, expected) in [
        (program(57, 1000), 5, "the file is for boards 57, this is a board 56"),
        (
            program(56, 1_966_084),
            5,
            "the program has 1966084 bytes, the board's flash takes 1966080",
        ),
        (program(56, 1000), 9, "uses revision 9 of its protocol, expected 3 to 5"),
    ] {
        let (result, _, board) = flash(&file, revision, Fault::default());
        let error = result.expect_err(expected);
        assert!(
            error.contains(expected) && error.contains("nothing was erased"),
            "{error}"
        );
        assert!(!board.erased && !board.started);
    }
}

#[test]
fn val_what_goes_wrong_is_named_and_nothing_starts() {
    for (fault, expected) in [
        (
            Fault {
                stuck_byte: Some(777),
                ..Fault::default()
            },
            "flash the board again",
        ),
        (
            Fault {
                no_erase: true,
                ..Fault::default()
            },
            "erasing: the boot loader reports a failure",
        ),
        (
            Fault {
                dies_after: Some(3),
                ..Fault::default()
            },
            "writing at byte 756: no answer within 2.0 s; flash the board again",
        ),
    ] {
        let (result, _, board) = flash(&program(56, 2000), 5, fault);
        let error = result.expect_err(expected);
        assert!(error.contains(expected), "{error}");
        assert!(!board.started);
    }
}

/// The output of `cargo xtask firmware`; if missing, the test is counted as skipped.
#[test]
fn val_program_of_this_repository_goes_in() {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../target/firmware/pixhawk6c.px4");
    if !path.is_file() {
        let sentence = "flashing pixhawk6c.px4: it was not built (cargo xtask firmware)";
        skip::skip(sentence);
        return;
    }
    let file = Px4File::load(&path).expect("as the boot loader takes it");
    assert_eq!(file.board_id, 56);
    let (result, _, board) = flash(&file, 5, Fault::default());
    assert_eq!(result, Ok(()));
    assert_eq!(board.flash[..file.image.len()], file.image);
    // Start address after the boot loader's sector, in Thumb code.
    let start = u32::from_le_bytes([board.flash[4], board.flash[5], board.flash[6], board.flash[7]]);
    assert!(
        (0x0802_0000..0x0802_0000 + FLASH).contains(&start) && start & 1 == 1,
        "{start:#x}"
    );
}

#[test]
fn val_nobody_there_is_named() {
    let terminal = Terminal::open().expect("a terminal");
    let line = FileLine::serial(terminal.path(), 115_200).expect("a port");
    let error = BootLoader::find(line, Duration::from_millis(400))
        .err()
        .expect("nobody answers");
    assert!(error.contains("no boot loader answered within"), "{error}");
}
