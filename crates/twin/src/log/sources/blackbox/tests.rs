use super::super::{Asked, Format, detect, parse as parse_log};
use super::*;

fn asked() -> Asked<'static> {
    Asked {
        most_cells: 1 << 20,
        ..Asked::default()
    }
}

fn bytes(header: &str, frames: &[&[u8]]) -> Vec<u8> {
    let mut file = header.as_bytes().to_vec();
    for frame in frames {
        file.extend_from_slice(frame);
    }
    file
}

const HEADER: &str = "H Product:Blackbox flight data recorder by Nicholas Sherlock\nH Data version:2\n\
    H Field I name:loopIteration,time,gyroADC[0],gyroADC[1],gyroADC[2],motor[0],motor[1]\n\
    H Field I signed:0,0,1,1,1,0,0\nH Field I predictor:0,0,0,0,0,11,5\nH Field I encoding:1,1,0,0,0,1,0\n\
    H Field P predictor:6,2,1,1,1,3,3\nH Field P encoding:9,0,7,7,7,0,0\n\
    H Firmware revision:Betaflight 4.4.0\nH motorOutput:158,2047\nH gyro_scale:0x3f800000\nH I interval:4\nH P interval:1\n";

fn stream(file: &[u8]) -> SourceLog {
    assert_eq!(detect(file), Some(Format::Blackbox));
    parse_log(Format::Blackbox, file, &asked()).expect("a log")
}

fn column<'a>(log: &'a SourceLog, name: &str) -> &'a [f64] {
    let field = log.streams[0].fields.iter().find(|(field, _)| field == name);
    field.map(|(_, values)| values.as_slice()).expect(name)
}

#[test]
fn val_frames_are_read_against_their_predictors() {
    // I: iteration 4, time 1000, rates 1 −1 2, motors 158 + 42 and 200 + 5; P: time 2·1000 − 1000 + 250, differences 1, −2, 1 (two
    // bits each: 01 10 01), motors mean + 10, mean − 2.
    let whole: &[u8] = &[b'I', 4, 0xe8, 0x07, 2, 1, 4, 42, 10];
    let against: &[u8] = &[b'P', 0xf4, 0x03, 0b01_10_01, 20, 3];
    let end: &[u8] = b"E\xffEnd of log\0";
    let log = stream(&bytes(HEADER, &[whole, against, end]));
    assert!(
        log.notes.iter().all(|note| !note.contains("bytes are not")),
        "{:?}",
        log.notes
    );
    assert_eq!(log.streams[0].time_s, [0.001, 0.00125]);
    assert_eq!(column(&log, "loopIteration"), [4.0, 5.0]);
    assert_eq!(column(&log, "gyroADC[0]"), [1.0, 2.0]);
    assert_eq!(column(&log, "gyroADC[1]"), [-1.0, -3.0]);
    assert_eq!(column(&log, "gyroADC[2]"), [2.0, 3.0]);
    assert_eq!(column(&log, "motor[0]"), [200.0, 210.0]);
    assert_eq!(column(&log, "motor[1]"), [205.0, 203.0]);
}

#[test]
fn val_damage_costs_the_frames_up_to_the_next_whole_one() {
    let whole: &[u8] = &[b'I', 4, 0xe8, 0x07, 2, 1, 4, 42, 10];
    let later: &[u8] = &[b'I', 8, 0xd0, 0x0f, 2, 1, 4, 42, 10];
    let against: &[u8] = &[b'P', 0xf4, 0x03, 0b01_10_01, 20, 3];
    let log = stream(&bytes(HEADER, &[whole, &[0xff, 0xff, 7], against, later, against]));
    // The frame before the damage is lost, too: nothing says that it ended where it seems to.
    assert_eq!(log.streams[0].time_s, [0.002, 0.00225]);
    assert!(
        log.notes
            .iter()
            .any(|note| note.contains("bytes are not part of a frame")),
        "{:?}",
        log.notes
    );
}

#[test]
fn val_of_several_flights_the_longest_is_taken() {
    let first: &[u8] = &[b'I', 4, 0xe8, 0x07, 2, 1, 4, 42, 10];
    let second: &[u8] = &[b'I', 8, 0xd0, 0x0f, 2, 1, 4, 42, 10];
    let mut file = bytes(HEADER, &[first]);
    file.extend(bytes(HEADER, &[first, second]));
    let log = stream(&file);
    assert_eq!(log.streams[0].time_s.len(), 2);
    assert!(
        log.notes.iter().any(|note| note.contains("2 flights; number 2")),
        "{:?}",
        log.notes
    );
}

#[test]
fn val_groups_of_values() {
    let read = |encodings: &[i64], bytes: &[u8]| {
        let encodings: Vec<encoding::Encoding> = encodings
            .iter()
            .map(|number| encoding::Encoding::of(*number).expect("known"))
            .collect();
        let mut out = Vec::new();
        let mut cursor = Cursor { bytes };
        encoding::read(&mut cursor, &encodings, &mut out).expect("whole");
        assert!(cursor.bytes.is_empty());
        out
    };
    // 4, 8, 16 and 0 bits, nibble by nibble: −1, 0x12, 0x3456 and nothing.
    assert_eq!(
        read(&[8; 4], &[0b00_11_10_01, 0xf1, 0x23, 0x45, 0x60]),
        [-1, 0x12, 0x3456, 0]
    );
    assert_eq!(read(&[7; 3], &[0b0100_0111, 0xf8]), [7, -1, -8]);
    assert_eq!(read(&[7; 3], &[0b11_00_01_00, 0xff, 0x00, 0x80, 0x05]), [-1, -32768, 5]);
    assert_eq!(read(&[10; 3], &[0b0111_1110, 0b0001_0111]), [-1, 1, 7]);
    assert_eq!(read(&[6; 3], &[0b101, 3, 4]), [-2, 0, 2]);
    assert_eq!(read(&[6], &[3]), [-2]);
    assert_eq!(read(&[3], &[5]), [-5]);
}

#[test]
fn prop_no_bytes_panic() {
    let mut state = 1_u32;
    for _ in 0..2000 {
        let mut file = HEADER.as_bytes().to_vec();
        for _ in 0..200 {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let byte = (state >> 24) as u8;
            file.push(if byte < 60 {
                b"IPSGHE"[usize::from(byte) % 6]
            } else {
                byte
            });
        }
        drop(parse_log(Format::Blackbox, &file, &asked()));
    }
}

#[test]
fn val_electrical_turns_are_rotor_speeds_by_the_poles_of_the_header() {
    let header = HEADER
        .replace("motor[0],motor[1]\n", "motor[0],motor[1],eRPM[0],eRPM[1]\n")
        .replace("H Field I signed:0,0,1,1,1,0,0", "H Field I signed:0,0,1,1,1,0,0,0,0")
        .replace(
            "H Field I predictor:0,0,0,0,0,11,5",
            "H Field I predictor:0,0,0,0,0,11,5,0,0",
        )
        .replace(
            "H Field I encoding:1,1,0,0,0,1,0",
            "H Field I encoding:1,1,0,0,0,1,0,1,1",
        )
        .replace(
            "H Field P predictor:6,2,1,1,1,3,3",
            "H Field P predictor:6,2,1,1,1,3,3,1,1",
        )
        .replace(
            "H Field P encoding:9,0,7,7,7,0,0",
            "H Field P encoding:9,0,7,7,7,0,0,0,0",
        );
    // 700 and 7 counts; then 1 more and 1 less. 12 poles: 100/6 min⁻¹ a count; the firmware's 14 where the header does not say.
    let whole: &[u8] = &[b'I', 4, 0xe8, 0x07, 2, 1, 4, 42, 10, 0xbc, 0x05, 7];
    let against: &[u8] = &[b'P', 0xf4, 0x03, 0b01_10_01, 20, 3, 2, 1];
    let end: &[u8] = b"E\xffEnd of log\0";
    for (line, poles) in [("H motor_poles:12\n", 12.0), ("", 14.0)] {
        let log = stream(&bytes(&format!("{header}{line}"), &[whole, against, end]));
        let rpm = |counts: f64| counts * 100.0 / (poles / 2.0);
        for (name, counts) in [("rpm[0]", [700.0, 701.0]), ("rpm[1]", [7.0, 6.0])] {
            for (read, counts) in column(&log, name).iter().zip(counts) {
                assert!((read - rpm(counts)).abs() < 1e-9, "{name}: {read}");
            }
        }
        assert_eq!(
            log.notes.iter().any(|note| note.contains("magnet poles")),
            line.is_empty()
        );
    }
}

/// Header lines of three generations, and the rate of one count that each means, deg/s.
#[test]
fn regress_firmware_before_2016_writes_the_scale_of_its_gyroscope_under_another_key() {
    let whole: &[u8] = &[b'I', 4, 0xe8, 0x07, 2, 1, 4, 42, 10];
    let end: &[u8] = b"E\xffEnd of log\0";
    let later: &[u8] = &[b'I', 8, 0xd0, 0x0f, 2, 1, 4, 42, 10];
    for (line, deg_s) in [
        ("H gyro_scale:0x3f800000\n", 1.0),
        // 1/16.4, of Cleanflight.
        ("H gyro.scale:0x3d79c190\n", 1.0 / 16.4),
        // (1/16.4)·π/180·10⁻⁶, of Baseflight.
        ("H gyro.scale:0x30924418\n", 1.0 / 16.4),
        ("", 1.0),
    ] {
        let header = HEADER.replace("H gyro_scale:0x3f800000\n", line);
        let log = stream(&bytes(&header, &[whole, later, end]));
        let rate = column(&log, "gyro[0]")[0];
        assert!((rate / deg_s - 1.0).abs() < 1e-3, "{line}: {rate}");
    }
}
