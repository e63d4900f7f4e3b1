//! Bytes and files that boards, autopilots and their plants may send, and those recorded of a run: through each decoder of services/bridge and
//! crates/board, and the reader of recorded commands.
//!
//! The first byte selects the decoder for the rest. Everything decoded is re-encoded to something that decodes to the
//! same.

#![no_main]

use libfuzzer_sys::fuzz_target;
use rotortwin_board::frame as board;
use rotortwin_board::message::{Begin, Reply, Report, Sensors};
use rotortwin_bridge::address::BoardAddress;
use rotortwin_bridge::autopilot::address::AutopilotAddress;
use rotortwin_bridge::autopilot::betaflight::decode_motors;
use rotortwin_bridge::autopilot::pilot::PilotAddress;
use rotortwin_bridge::autopilot::plant_check;
use rotortwin_bridge::autopilot::servo_packet::ServoPacket;
use rotortwin_bridge::mavlink::frame::{Decoder, Frame, encode};
use rotortwin_bridge::mavlink::messages::{HilActuatorControls, HilGps, HilSensor};
use rotortwin_bridge::mavlink::steering::{
    Acknowledgement, AutopilotVersion, Command, Heartbeat, LocalPosition, PositionTarget, StatusText,
};
use rotortwin_bridge::px4_file::Px4File;
use rotortwin_wire::autopilot_commands::{self, CommandReader};

fuzz_target!(|data: &[u8]| {
    let Some((&which, bytes)) = data.split_first() else {
        return;
    };
    match which % 8 {
        0 => servo_packet(bytes),
        1 => mavlink(bytes),
        2 => assert!(decode_motors(bytes).is_some() == (bytes.len() == 68)),
        3 => board_frames(bytes),
        4 => with_text(bytes, |text| drop(Px4File::parse(text))),
        5 => with_text(bytes, addresses),
        6 => plant_line(bytes),
        _ => recorded_commands(bytes),
    }
});

fn with_text(bytes: &[u8], take: impl FnOnce(&str)) {
    if let Ok(text) = std::str::from_utf8(bytes) {
        take(text);
    }
}

fn servo_packet(bytes: &[u8]) {
    if let Ok(packet) = ServoPacket::decode(bytes) {
        assert!(packet.encode() == bytes);
        for channels in [0, 6, 16, 32, 40] {
            drop(packet.impossible_pulse(channels));
        }
    }
}

/// The same frames come out whether the stream comes whole or in two pieces.
fn mavlink(bytes: &[u8]) {
    let frames = |pieces: [&[u8]; 2]| -> Vec<Frame> {
        let mut decoder = Decoder::default();
        let mut found = Vec::new();
        for piece in pieces {
            decoder.push(piece);
            found.extend(std::iter::from_fn(|| decoder.next_frame()));
        }
        found
    };
    let whole = frames([bytes, &[]]);
    drop(frames([&bytes[..bytes.len() / 3], &bytes[bytes.len() / 3..]]));
    for frame in &whole {
        let payload = &frame.payload[..frame.length];
        let again = frames([&encode(frame.sequence, frame.system, frame.component, frame.message, payload), &[]]);
        // A sender may keep zeros at the end, ours does not.
        let [again] = &again[..] else {
            panic!("{} frames", again.len());
        };
        assert!(again.length <= frame.length);
        let trimmed = Frame {
            length: again.length,
            ..frame.clone()
        };
        assert!(*again == trimmed);
        if let Some(text) = StatusText::read(frame) {
            assert!(text.text.chars().count() <= 50);
        }
        if let Some(version) = AutopilotVersion::read(frame) {
            drop(version.text());
        }
        drop((Heartbeat::read(frame), Command::read(frame), Acknowledgement::read(frame).map(|ack| ack.word())));
        drop((LocalPosition::read(frame), PositionTarget::read(frame)));
        drop((HilSensor::read(frame), HilGps::read(frame), HilActuatorControls::read(frame)));
    }
}

fn board_frames(bytes: &[u8]) {
    let mut decoder = board::Decoder::default();
    for &byte in bytes {
        if let Some((_, payload)) = decoder.push(byte) {
            messages(payload);
        }
    }
    // Bytes that the checksum would have kept out.
    messages(bytes);
}

fn messages(payload: &[u8]) {
    drop((Begin::read(payload), Sensors::read(payload), Report::read(payload), Reply::read(payload)));
}

/// The line of an unknown plant: what is read of it is finite.
fn plant_line(bytes: &[u8]) {
    if let Ok(answer) = plant_check::read(bytes) {
        let vectors = [answer.gyro, answer.accel, answer.position, answer.velocity, answer.attitude];
        assert!(answer.timestamp_s.is_finite() && vectors.as_flattened().iter().all(|x| x.is_finite()));
    }
}

/// The first byte is the number of the vehicle's rotors. What is read are fractions, and written again it is the same bytes.
fn recorded_commands(bytes: &[u8]) {
    let Some((&rotors, bytes)) = bytes.split_first() else {
        return;
    };
    let rotors = usize::from(rotors % 20);
    let Ok(mut reader) = CommandReader::open(bytes, rotors) else {
        return;
    };
    let mut written = autopilot_commands::header(reader.interval_parts(), rotors);
    // Without rotors an exchange has no bytes, and the recording no end.
    for _ in 0..=bytes.len() {
        let Ok(duties) = reader.next_exchange() else {
            break;
        };
        assert!(duties.iter().all(|duty| (0.0..=1.0).contains(duty)));
        written.extend(autopilot_commands::exchange(&duties[..rotors]));
    }
    assert!(bytes.starts_with(&written));
}

/// What is taken for an address is written so that it is taken again.
fn addresses(text: &str) {
    if let Ok(address) = text.parse::<AutopilotAddress>() {
        assert!(address.to_string().parse() == Ok(address));
    }
    if let Ok(address) = text.parse::<BoardAddress>() {
        let written = address.to_string();
        assert!(written.parse::<BoardAddress>().is_ok(), "{written}");
    }
    drop(text.parse::<PilotAddress>());
}
