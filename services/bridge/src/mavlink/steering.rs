//! Messages between an autopilot and its commander, with their fields in wire order. Units and frames are those of the common dialect.

use super::catalogue::{
    AUTOPILOT_VERSION, BATTERY_STATUS, COMMAND_ACK, COMMAND_LONG, HEARTBEAT, LOCAL_POSITION_NED,
    SET_POSITION_TARGET_LOCAL_NED, STATUSTEXT,
};
use super::frame::Frame;
use super::reader::Reader;

/// HEARTBEAT.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Heartbeat {
    /// Mode, in the autopilot's numbering.
    pub custom_mode: u32,
    /// 6: ground station; 13: hexarotor.
    pub vehicle: u8,
    /// 3: ArduPilot; 12: PX4; 8: none.
    pub autopilot: u8,
    /// Bit 7: armed.
    pub base_mode: u8,
    /// 4: active.
    pub system_status: u8,
}

impl Heartbeat {
    /// Bit of `base_mode`.
    const ARMED: u8 = 128;

    /// Heartbeat of a ground station.
    pub fn of_ground_station() -> Self {
        Self {
            vehicle: 6,
            autopilot: 8,
            system_status: 4,
            ..Self::default()
        }
    }

    /// True if its motors may turn.
    pub fn armed(&self) -> bool {
        self.base_mode & Self::ARMED != 0
    }

    /// The payload.
    pub fn encode(&self) -> Vec<u8> {
        let mut bytes = self.custom_mode.to_le_bytes().to_vec();
        bytes.extend([self.vehicle, self.autopilot, self.base_mode, self.system_status, 3]);
        bytes
    }

    /// Decodes a frame.
    pub fn read(frame: &Frame) -> Option<Self> {
        let mut reader = (frame.message == HEARTBEAT).then_some(Reader::of(frame))?;
        let custom_mode = u32::from_le_bytes(reader.take());
        let [vehicle, autopilot, base_mode, system_status] = reader.take();
        Some(Self {
            custom_mode,
            vehicle,
            autopilot,
            base_mode,
            system_status,
        })
    }
}

/// COMMAND_LONG.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Command {
    /// Parameters 1 to 7; their meaning depends on the command.
    pub params: [f32; 7],
    /// MAV_CMD.
    pub command: u16,
    /// System, component.
    pub target: [u8; 2],
}

impl Command {
    /// MAV_CMD_NAV_TAKEOFF; param 7: height, m.
    pub const TAKE_OFF: u16 = 22;
    /// MAV_CMD_DO_SET_MODE; param 1: 1, param 2 and 3: the mode.
    pub const SET_MODE: u16 = 176;
    /// MAV_CMD_COMPONENT_ARM_DISARM; param 1: 1 arms.
    pub const ARM: u16 = 400;
    /// MAV_CMD_SET_MESSAGE_INTERVAL; param 1: message, param 2: µs.
    pub const MESSAGE_INTERVAL: u16 = 511;
    /// MAV_CMD_REQUEST_MESSAGE; param 1: message.
    pub const REQUEST_MESSAGE: u16 = 512;

    /// The payload.
    pub fn encode(&self) -> Vec<u8> {
        let mut bytes: Vec<u8> = self.params.iter().flat_map(|param| param.to_le_bytes()).collect();
        bytes.extend(self.command.to_le_bytes());
        bytes.extend(self.target);
        bytes.push(0);
        bytes
    }

    /// Decodes a frame.
    pub fn read(frame: &Frame) -> Option<Self> {
        let mut reader = (frame.message == COMMAND_LONG).then_some(Reader::of(frame))?;
        Some(Self {
            params: std::array::from_fn(|_| f32::from_le_bytes(reader.take())),
            command: u16::from_le_bytes(reader.take()),
            target: reader.take(),
        })
    }
}

/// COMMAND_ACK.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Acknowledgement {
    /// MAV_CMD.
    pub command: u16,
    /// 0: accepted.
    pub result: u8,
}

impl Acknowledgement {
    /// The catalogue's name of the result.
    pub fn word(&self) -> &'static str {
        match self.result {
            0 => "ACCEPTED",
            1 => "TEMPORARILY_REJECTED",
            2 => "DENIED",
            3 => "UNSUPPORTED",
            4 => "FAILED",
            5 => "IN_PROGRESS",
            6 => "CANCELLED",
            _ => "another result",
        }
    }

    /// The payload.
    pub fn encode(&self) -> Vec<u8> {
        let mut bytes = self.command.to_le_bytes().to_vec();
        bytes.push(self.result);
        bytes
    }

    /// Decodes a frame.
    pub fn read(frame: &Frame) -> Option<Self> {
        let mut reader = (frame.message == COMMAND_ACK).then_some(Reader::of(frame))?;
        Some(Self {
            command: u16::from_le_bytes(reader.take()),
            result: u8::from_le_bytes(reader.take()),
        })
    }
}

/// STATUSTEXT.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct StatusText {
    /// 0: emergency, 7: debugging.
    pub severity: u8,
    /// At most 50 bytes of it.
    pub text: String,
}

impl StatusText {
    /// Least urgent severity of a warning.
    pub const WARNING: u8 = 4;
    /// Bytes of a text.
    pub const LONGEST: usize = 50;

    /// The payload.
    pub fn encode(&self) -> Vec<u8> {
        let text = &self.text.as_bytes()[..self.text.len().min(Self::LONGEST)];
        let mut bytes = vec![self.severity];
        bytes.extend(text);
        bytes.resize(1 + Self::LONGEST, 0);
        bytes
    }

    /// Decodes a frame. Control characters are removed.
    pub fn read(frame: &Frame) -> Option<Self> {
        let mut reader = (frame.message == STATUSTEXT).then_some(Reader::of(frame))?;
        let [severity] = reader.take();
        let bytes: [u8; Self::LONGEST] = reader.take();
        let end = bytes.iter().position(|byte| *byte == 0).unwrap_or(bytes.len());
        let text = String::from_utf8_lossy(&bytes[..end]);
        Some(Self {
            severity,
            text: text
                .chars()
                .filter(|c| !c.is_control())
                .collect::<String>()
                .trim()
                .to_owned(),
        })
    }
}

/// LOCAL_POSITION_NED: the autopilot's position estimate, from its own origin.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LocalPosition {
    /// Since it booted, ms.
    pub time_boot_ms: u32,
    /// m, NED.
    pub position: [f32; 3],
    /// m/s, NED.
    pub velocity: [f32; 3],
}

impl LocalPosition {
    /// The payload.
    pub fn encode(&self) -> Vec<u8> {
        let mut bytes = self.time_boot_ms.to_le_bytes().to_vec();
        let floats = self.position.iter().chain(&self.velocity);
        bytes.extend(floats.flat_map(|float| float.to_le_bytes()));
        bytes
    }

    /// Decodes a frame.
    pub fn read(frame: &Frame) -> Option<Self> {
        let mut reader = (frame.message == LOCAL_POSITION_NED).then_some(Reader::of(frame))?;
        let time_boot_ms = u32::from_le_bytes(reader.take());
        let mut vector = || std::array::from_fn(|_| f32::from_le_bytes(reader.take()));
        Some(Self {
            time_boot_ms,
            position: vector(),
            velocity: vector(),
        })
    }
}

/// SET_POSITION_TARGET_LOCAL_NED with position, velocity and yaw; accelerations and yaw rate are left to the autopilot.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PositionTarget {
    /// Time since its sender started, ms.
    pub time_boot_ms: u32,
    /// m, NED from the autopilot's origin.
    pub position: [f32; 3],
    /// m/s, NED.
    pub velocity: [f32; 3],
    /// rad.
    pub yaw: f32,
    /// System, component.
    pub target: [u8; 2],
}

impl PositionTarget {
    /// Ignored: the three accelerations and the yaw rate.
    const MASK: u16 = 0x1c0 | 0x800;
    /// MAV_FRAME_LOCAL_NED.
    const FRAME: u8 = 1;

    /// The payload.
    pub fn encode(&self) -> Vec<u8> {
        let mut bytes = self.time_boot_ms.to_le_bytes().to_vec();
        let floats = self.position.iter().chain(&self.velocity).chain(&[0.0; 3]);
        bytes.extend(floats.chain([&self.yaw, &0.0]).flat_map(|float| float.to_le_bytes()));
        bytes.extend(Self::MASK.to_le_bytes());
        bytes.extend(self.target);
        bytes.push(Self::FRAME);
        bytes
    }

    /// Decodes a frame with the same mask and frame.
    pub fn read(frame: &Frame) -> Option<Self> {
        let mut reader = (frame.message == SET_POSITION_TARGET_LOCAL_NED).then_some(Reader::of(frame))?;
        let time_boot_ms = u32::from_le_bytes(reader.take());
        let mut vector = || std::array::from_fn(|_| f32::from_le_bytes(reader.take()));
        let (position, velocity, _) = (vector(), vector(), vector());
        let [yaw, _] = [reader.take(), reader.take()].map(f32::from_le_bytes);
        let mask = u16::from_le_bytes(reader.take());
        let [system, component, frame] = reader.take();
        (mask == Self::MASK && frame == Self::FRAME).then_some(Self {
            time_boot_ms,
            position,
            velocity,
            yaw,
            target: [system, component],
        })
    }
}

/// The part of AUTOPILOT_VERSION needed for the record of a run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct AutopilotVersion {
    /// Major, minor, patch, kind of release (255: a release).
    pub version: [u8; 4],
    /// Eight characters of a commit (ArduPilot), or three bytes of a vendor's version and the first five of a commit, last first (PX4).
    pub commit: [u8; 8],
}

impl AutopilotVersion {
    /// "4.7.0 dev (2598e9d4)".
    pub fn text(&self) -> String {
        let [major, minor, patch, kind] = self.version;
        let kind = match kind {
            255 => "",
            192.. => " rc",
            128.. => " beta",
            64.. => " alpha",
            _ => " dev",
        };
        let commit = match self.commit {
            [0, 0, 0, 0, 0, 0, 0, 0] => String::new(),
            commit if commit.iter().all(u8::is_ascii_graphic) => format!(" ({})", String::from_utf8_lossy(&commit)),
            // PX4: the commit's first bytes, last first; the three lowest are a vendor's version, 0 in public releases.
            [_, _, _, commit @ ..] => {
                let digits: Vec<String> = commit.iter().rev().map(|byte| format!("{byte:02x}")).collect();
                format!(" ({})", digits.concat())
            }
        };
        format!("{major}.{minor}.{patch}{kind}{commit}")
    }

    /// The payload; unknown fields are 0.
    pub fn encode(&self) -> Vec<u8> {
        let [major, minor, patch, kind] = self.version;
        let mut bytes = vec![0; 60];
        bytes[16..20].copy_from_slice(&[kind, patch, minor, major]);
        bytes[36..44].copy_from_slice(&self.commit);
        bytes
    }

    /// Decodes a frame.
    pub fn read(frame: &Frame) -> Option<Self> {
        let mut reader = (frame.message == AUTOPILOT_VERSION).then_some(Reader::of(frame))?;
        // Capabilities and identity.
        let _: [u8; 16] = reader.take();
        let [kind, patch, minor, major] = reader.take();
        // Versions of other parts, vendor and product.
        let _: [u8; 16] = reader.take();
        Some(Self {
            version: [major, minor, patch, kind],
            commit: reader.take(),
        })
    }
}

/// BATTERY_STATUS of a pack without individual cell voltages.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Battery {
    /// At the terminals, V; resolution 1 mV, at most twice 65.534 V.
    pub voltage_v: f64,
    /// Discharge positive, A; resolution 10 mA, at most 327.67 A.
    pub current_a: f64,
}

impl Battery {
    /// Component id of a vehicle's battery.
    pub const COMPONENT: u8 = 180;
    /// An absent cell.
    const NO_CELL: u16 = u16::MAX;

    /// The payload. Charge, energy and temperature are unknown; voltage beyond the range of one field goes into the second one.
    pub fn encode(&self) -> Vec<u8> {
        let millivolts = (1e3 * self.voltage_v)
            .round()
            .clamp(0.0, 2.0 * f64::from(Self::NO_CELL - 1)) as u32;
        let first = millivolts.min(u32::from(Self::NO_CELL - 1));
        let mut cells = [Self::NO_CELL; 10];
        cells[0] = first as u16;
        if millivolts > first {
            cells[1] = (millivolts - first) as u16;
        }
        // −1 A would mean "not measured".
        let centiamperes = (100.0 * self.current_a).round().clamp(0.0, f64::from(i16::MAX)) as i16;
        let mut bytes = [-1_i32; 2].map(i32::to_le_bytes).concat();
        bytes.extend(i16::MAX.to_le_bytes());
        bytes.extend(cells.iter().flat_map(|cell| cell.to_le_bytes()));
        bytes.extend(centiamperes.to_le_bytes());
        // The first battery; of all that the vehicle has; lithium polymer; charge not known.
        bytes.extend([0, 1, 1, u8::MAX]);
        bytes
    }

    /// Decodes a frame.
    pub fn read(frame: &Frame) -> Option<Self> {
        let mut reader = (frame.message == BATTERY_STATUS).then_some(Reader::of(frame))?;
        // Charge, energy and temperature.
        let _: [u8; 10] = reader.take();
        let cells: [u16; 10] = std::array::from_fn(|_| u16::from_le_bytes(reader.take()));
        let cells = cells.iter().take_while(|cell| **cell != Self::NO_CELL);
        Some(Self {
            voltage_v: cells.map(|cell| f64::from(*cell) * 1e-3).sum(),
            current_a: f64::from(i16::from_le_bytes(reader.take())) * 0.01,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::frame::{Decoder, encode};
    use super::super::hex::{bytes, frame};
    use super::*;

    // Encoding of the same messages by pymavlink 2.4.49, from system 1, component 1, with the sequence numbers 7 to 13; the battery is
    // component 180, number 14, by pymavlink 2.4.50.
    const BATTERY_BYTES: &str =
        "fd2400000e01b4930000ffffffffffffffffff7f483cffffffffffffffffffffffffffffffffffffd204000101ff66f9";
    const HEARTBEAT_BYTES: &str = "fd090000070101000000040000000d03890403113c";
    const COMMAND_BYTES: &str =
        "fd2100000801014c00000000803f0000003f0000000000000000000000000000000000005040900101010220b4";
    const FAILED_BYTES: &str = "fd0300000901014d00009001046af1";
    const ACCEPTED_BYTES: &str = "fd0a00000901014d00001600000700000000ffbe5814";
    const TEXT_BYTES: &str = "fd1b00000a0101fd00000250726541726d3a204779726f7320696e636f6e73697374656e747a89";
    const LOCAL_BYTES: &str = "fd1c00000b010120000087d612000000003f000080be000040c00000003e0000803e000000bf0ab9";
    const TARGET_BYTES: &str = "fd3500000c010154000087d612000000003f000080be000040c00000003e0000803e000000bf0000000000000000000000000000c03f00000000c009010101ec89";
    const VERSION_BYTES: &str = "fd2c00000d010194000001000000000000000700000000000000c00007040200000003000000040000000500060032353938653964348b4a";

    #[test]
    fn val_what_is_sent_is_pymavlink_s() {
        let command = Command {
            params: [1.0, 0.5, 0.0, 0.0, 0.0, 0.0, 3.25],
            command: Command::ARM,
            target: [1, 1],
        };
        // Ours is sent first, so its confirmation is 0; theirs says 2.
        let mut payload = command.encode();
        payload[32] = 2;
        assert_eq!(encode(8, 1, 1, COMMAND_LONG, &payload), bytes(COMMAND_BYTES));
        assert_eq!(Command::read(&frame(COMMAND_BYTES)), Some(command));
        let target = PositionTarget {
            time_boot_ms: 1_234_567,
            position: [0.5, -0.25, -3.0],
            velocity: [0.125, 0.25, -0.5],
            yaw: 1.5,
            target: [1, 1],
        };
        assert_eq!(
            encode(12, 1, 1, SET_POSITION_TARGET_LOCAL_NED, &target.encode()),
            bytes(TARGET_BYTES)
        );
        assert_eq!(PositionTarget::read(&frame(TARGET_BYTES)), Some(target));
        let heartbeat = Heartbeat {
            custom_mode: 4,
            vehicle: 13,
            autopilot: 3,
            base_mode: 0x89,
            system_status: 4,
        };
        assert_eq!(encode(7, 1, 1, HEARTBEAT, &heartbeat.encode()), bytes(HEARTBEAT_BYTES));
    }

    #[test]
    fn val_what_comes_is_read_as_pymavlink_wrote_it() {
        let heartbeat = Heartbeat::read(&frame(HEARTBEAT_BYTES)).unwrap();
        assert!(heartbeat.armed() && heartbeat.custom_mode == 4 && heartbeat.autopilot == 3);
        let failed = Acknowledgement::read(&frame(FAILED_BYTES)).unwrap();
        assert_eq!((failed.command, failed.word()), (Command::ARM, "FAILED"));
        assert_eq!(encode(9, 1, 1, COMMAND_ACK, &failed.encode()), bytes(FAILED_BYTES));
        let accepted = Acknowledgement::read(&frame(ACCEPTED_BYTES)).unwrap();
        assert_eq!((accepted.command, accepted.word()), (Command::TAKE_OFF, "ACCEPTED"));
        let text = StatusText::read(&frame(TEXT_BYTES)).unwrap();
        assert_eq!((text.severity, text.text.as_str()), (2, "PreArm: Gyros inconsistent"));
        assert_eq!(encode(10, 1, 1, STATUSTEXT, &text.encode()), bytes(TEXT_BYTES));
        let local = LocalPosition::read(&frame(LOCAL_BYTES)).unwrap();
        assert_eq!(
            (local.position, local.velocity),
            ([0.5, -0.25, -3.0], [0.125, 0.25, -0.5])
        );
        assert_eq!(
            encode(11, 1, 1, LOCAL_POSITION_NED, &local.encode()),
            bytes(LOCAL_BYTES)
        );
        let version = AutopilotVersion::read(&frame(VERSION_BYTES)).unwrap();
        assert_eq!(version.text(), "4.7.0 rc (2598e9d4)");
        let again = encode(1, 1, 1, AUTOPILOT_VERSION, &version.encode());
        let mut decoder = Decoder::default();
        decoder.push(&again);
        assert_eq!(AutopilotVersion::read(&decoder.next_frame().unwrap()), Some(version));
        assert_eq!(LocalPosition::read(&frame(TEXT_BYTES)), None);
    }

    #[test]
    fn regress_the_commit_of_a_published_px4_is_shown() {
        // Version reported by PX4 6a1c5329838729823ba03a28d550a9437018b6d7: no vendor's version in the three lowest bytes.
        let version = AutopilotVersion {
            version: [1, 18, 0, 0],
            commit: [0, 0, 0, 0x83, 0x29, 0x53, 0x1c, 0x6a],
        };
        assert_eq!(version.text(), "1.18.0 dev (6a1c532983)");
        let vendor = AutopilotVersion {
            version: [1, 18, 0, 255],
            commit: [3, 2, 1, 0x83, 0x29, 0x53, 0x1c, 0x6a],
        };
        assert_eq!(vendor.text(), "1.18.0 (6a1c532983)");
        assert_eq!(AutopilotVersion::default().text(), "0.0.0 dev");
    }

    #[test]
    fn val_a_battery_is_told_as_pymavlink_tells_it() {
        let battery = Battery {
            voltage_v: 15.432,
            current_a: 12.34,
        };
        let theirs = encode(14, 1, Battery::COMPONENT, BATTERY_STATUS, &battery.encode());
        assert_eq!(theirs, bytes(BATTERY_BYTES));
        assert_eq!(Battery::read(&frame(BATTERY_BYTES)), Some(battery));
        // 24 cells exceed one field, and charging is encoded as 0 A: −0.01 A would be "not measured".
        let mut decoder = Decoder::default();
        let high = Battery {
            voltage_v: 100.8,
            current_a: -0.01,
        };
        decoder.push(&encode(1, 1, Battery::COMPONENT, BATTERY_STATUS, &high.encode()));
        let read = Battery::read(&decoder.next_frame().unwrap()).unwrap();
        assert!(
            (read.voltage_v - 100.8).abs() < 1e-9 && read.current_a == 0.0,
            "{read:?}"
        );
    }

    #[test]
    fn val_texts_move_no_terminal() {
        let hostile = StatusText {
            severity: 4,
            text: "\u{1b}[2Jgone\r\n".to_owned(),
        };
        let mut decoder = Decoder::default();
        decoder.push(&encode(1, 1, 1, STATUSTEXT, &hostile.encode()));
        let read = StatusText::read(&decoder.next_frame().unwrap()).unwrap();
        assert_eq!(read.text, "[2Jgone");
    }
}
