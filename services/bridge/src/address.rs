//! Board addresses, as written on the command line.
//!
//! | Text | Board |
//! |---|---|
//! | `serial:/dev/ttyACM0`, `serial:/dev/ttyUSB0@921600` | behind a serial port |
//! | `pty` | a virtual one behind a pseudo-terminal of this host |
//! | `qemu`, `qemu:PROGRAM`, `qemu-uart`, `qemu-uart:PROGRAM` | on the emulated Cortex-M7, over semihosting or over its UART |
//! | `virtual`, `virtual:corruption=0.01,seed=3` | a virtual one behind a virtual line, in virtual time; see [`LineModel`] |

use crate::line::{Channel, FileLine, Line};
use crate::virtual_line::{LineModel, Unplugged, VirtualLine};
use std::path::PathBuf;
use std::time::Duration;

/// Default baud rate of a serial port.
pub const DEFAULT_BAUD: u32 = 921_600;

/// Path of the emulated board's program built by `cargo xtask firmware`.
pub const QEMU_PROGRAM: &str = "target/firmware/thumbv7em-none-eabihf/release/mps2-an500";

/// See the module documentation.
#[derive(Clone, Debug, PartialEq)]
pub enum BoardAddress {
    /// A serial port and its baud rate.
    Serial(PathBuf, u32),
    /// A pseudo-terminal.
    Pty,
    /// The emulator.
    Qemu(PathBuf, Channel),
    /// A virtual line.
    Virtual(LineModel),
}

impl std::str::FromStr for BoardAddress {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (scheme, rest) = match text.split_once(':') {
            Some((scheme, rest)) => (scheme, Some(rest)),
            None => (text, None),
        };
        match (scheme, rest) {
            ("serial", Some(rest)) if !rest.is_empty() => {
                let (path, baud) = match rest.rsplit_once('@') {
                    Some((path, baud)) => (
                        path,
                        baud.parse()
                            .ok()
                            .filter(|baud| (9_600..=12_000_000).contains(baud))
                            .ok_or_else(|| format!("baud rate '{baud}': expected 9600 to 12000000"))?,
                    ),
                    None => (rest, DEFAULT_BAUD),
                };
                Ok(Self::Serial(path.into(), baud))
            }
            ("pty", None) => Ok(Self::Pty),
            ("qemu", rest) => Ok(Self::Qemu(rest.unwrap_or(QEMU_PROGRAM).into(), Channel::Semihosting)),
            ("qemu-uart", rest) => Ok(Self::Qemu(rest.unwrap_or(QEMU_PROGRAM).into(), Channel::Uart)),
            ("virtual", rest) => line_model(rest.unwrap_or_default()).map(Self::Virtual),
            _ => Err(format!(
                "'{text}': expected serial:PORT[@BAUD], pty, qemu[:PROGRAM], qemu-uart[:PROGRAM] or virtual[:KEY=NUMBER,...]"
            )),
        }
    }
}

impl std::fmt::Display for BoardAddress {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Serial(path, baud) => write!(out, "serial:{}@{baud}", path.display()),
            Self::Pty => out.write_str("pty"),
            Self::Qemu(_, Channel::Semihosting) => out.write_str("qemu"),
            Self::Qemu(_, Channel::Uart) => out.write_str("qemu-uart"),
            Self::Virtual(_) => out.write_str("virtual"),
        }
    }
}

fn line_model(text: &str) -> Result<LineModel, String> {
    let mut model = LineModel::default();
    let mut plug = Unplugged {
        at_s: f64::INFINITY,
        for_s: 0.5,
        power: false,
    };
    for setting in text.split(',').filter(|setting| !setting.is_empty()) {
        let number = |text: &str| {
            text.parse::<f64>()
                .ok()
                .filter(|number| *number >= 0.0 && number.is_finite())
        };
        let (key, value) = setting
            .split_once('=')
            .and_then(|(key, value)| Some((key, number(value)?)))
            .ok_or_else(|| format!("virtual line, '{setting}': expected KEY=NUMBER, the number not negative"))?;
        let share = |place: &mut f64| {
            *place = value;
            if value < 1.0 {
                Ok(())
            } else {
                Err(format!("virtual line, {key} is {value}: expected a share below 1"))
            }
        };
        match key {
            "baud" if value >= 1.0 => model.baud = value,
            "latency_ms" => model.latency_s = value / 1e3,
            "jitter_ms" => model.jitter_s = value / 1e3,
            "loss" => share(&mut model.loss)?,
            "corruption" => share(&mut model.corruption)?,
            "duplication" => share(&mut model.duplication)?,
            "burst" => share(&mut model.burst)?,
            "burst_length" => model.burst_length = value as u32,
            "unplug_at_s" => plug.at_s = value,
            "unplug_for_s" => plug.for_s = value,
            "unplug_power" => plug.power = value > 0.0,
            "retry_ms" if value > 0.0 => model.retry_s = value / 1e3,
            "seed" => model.seed = value as u64,
            _ => {
                return Err(format!(
                    "virtual line, '{setting}': expected baud, latency_ms, jitter_ms, loss, corruption, duplication, burst, \
                     burst_length, unplug_at_s, unplug_for_s, unplug_power, retry_ms or seed"
                ));
            }
        }
    }
    if plug.at_s.is_finite() {
        model.unplugged.push(plug);
    }
    Ok(model)
}

/// An open line of any kind.
pub enum AnyLine {
    /// Over file descriptors.
    File(FileLine),
    /// In virtual time.
    Virtual(VirtualLine),
}

impl BoardAddress {
    /// Opens the line; an error message if there is no board.
    pub fn open(&self) -> Result<AnyLine, String> {
        Ok(match self {
            Self::Serial(path, baud) => AnyLine::File(FileLine::serial(path, *baud)?),
            Self::Pty => AnyLine::File(FileLine::pty()?),
            Self::Qemu(program, channel) => AnyLine::File(FileLine::qemu(program, *channel)?),
            Self::Virtual(model) => AnyLine::Virtual(VirtualLine::new(model.clone())),
        })
    }

    /// Bits per second of the line, if applicable.
    pub fn baud(&self) -> Option<f64> {
        match self {
            // CDC-ACM accepts any number and runs at USB speed.
            Self::Serial(path, _) if path.to_string_lossy().contains("ACM") => None,
            Self::Serial(_, baud) => Some(f64::from(*baud)),
            Self::Virtual(model) => Some(model.baud),
            Self::Pty | Self::Qemu(..) => None,
        }
    }
}

impl Line for AnyLine {
    fn send(&mut self, bytes: &[u8]) -> Result<(), String> {
        match self {
            Self::File(line) => line.send(bytes),
            Self::Virtual(line) => line.send(bytes),
        }
    }
    fn receive(&mut self, buffer: &mut [u8], wait: Duration) -> Result<usize, String> {
        match self {
            Self::File(line) => line.receive(buffer, wait),
            Self::Virtual(line) => line.receive(buffer, wait),
        }
    }
    fn now(&self) -> Duration {
        match self {
            Self::File(line) => line.now(),
            Self::Virtual(line) => line.now(),
        }
    }
    fn retry(&self) -> Duration {
        match self {
            Self::File(line) => line.retry(),
            Self::Virtual(line) => line.retry(),
        }
    }
}
