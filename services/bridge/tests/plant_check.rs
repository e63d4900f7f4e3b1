//! Acting as ArduPilot towards plants: ours is right, and each deliberate error is identified.
#![expect(clippy::unwrap_used, reason = "a plant that cannot answer has failed its test")]

use rotortwin_bridge::autopilot::plant_check::{Observation, examine};
use rotortwin_bridge::autopilot::servo_packet::{RcChannels, write_answer};
use rotortwin_flight_core::MAX_ROTORS;
use rotortwin_plant::Simulation;
use rotortwin_plant::sensing::instruments::{InstrumentModel, Instruments};
use rotortwin_scenario::Scenario;
use rotortwin_wire::autopilot::Readings;
use std::net::UdpSocket;
use std::time::Duration;

/// Azimuths of ArduPilot's hexa X, and our rotors from 0.
const AZIMUTHS: [f64; 6] = [90.0, -90.0, -30.0, 150.0, 30.0, -150.0];
const ROTORS: [usize; 6] = [1, 4, 5, 2, 0, 3];

/// Error in a plant's readings, or in its line.
#[derive(Clone, Copy)]
enum Wrong {
    Nothing,
    Readings(fn(&mut Readings)),
    Line(fn(&str) -> String),
    Order([usize; 6]),
    /// Answers each packet, including repeated ones.
    Echo,
}

/// The F550 on its skids.
fn standing(seed: u64) -> Simulation {
    let text = "name = 'plant'\ndescription = 'plant'\nvehicle = '../vehicles/f550-skids.toml'\nduration_s = 5.0\n\
                [initial]\nstart = 'on-ground'\n[trajectory]\nkind = 'hover'\nposition_ned_m = [0.0, 0.0, -1.5]\n\
                [ground]\ndown_m = 0.0\n[ground.contact]\n";
    let folder = format!("{}/../../config/scenarios", env!("CARGO_MANIFEST_DIR"));
    let mut simulation = Scenario::parse(text, folder).unwrap().simulation(seed).unwrap();
    simulation.begin_prelude().unwrap();
    simulation
}

/// Frame and pulses, µs, of a packet of 16 channels, byte by byte as the protocol is described: not by the codec that wrote it.
fn frame_and_pulses(packet: &[u8]) -> (u32, [u16; 16]) {
    assert_eq!((packet.len(), &packet[..2]), (40, &[0x1a, 0x48][..]));
    let word = |at: usize| u16::from(packet[at]) + 256 * u16::from(packet[at + 1]);
    let frame = u32::from(word(4)) + 65_536 * u32::from(word(6));
    (frame, std::array::from_fn(|channel| word(8 + 2 * channel)))
}

/// Our plant behind the protocol, 1 ms per frame, until there is no request for 0.7 s.
fn serve(socket: &UdpSocket, wrong: Wrong, seed: u64) {
    let mut simulation = standing(seed);
    let mut instruments = Instruments::new(&InstrumentModel::default(), seed);
    socket.set_read_timeout(Some(Duration::from_millis(700))).unwrap();
    let (mut buffer, mut line, mut last) = ([0; 200], String::new(), None);
    let rotors = if let Wrong::Order(rotors) = wrong {
        rotors
    } else {
        ROTORS
    };
    while let Ok((length, from)) = socket.recv_from(&mut buffer) {
        let (frame, pulses_us) = frame_and_pulses(&buffer[..length]);
        if last == Some(frame) && !matches!(wrong, Wrong::Echo) {
            continue;
        }
        last = Some(frame);
        let mut duty = [0.0; MAX_ROTORS];
        for (channel, &rotor) in rotors.iter().enumerate() {
            duty[rotor] = (f64::from(pulses_us[channel]) - 1000.0) / 1000.0;
        }
        for _ in 0..2 {
            simulation.advance_part(&duty).unwrap();
        }
        let sample = simulation.measure(&mut instruments);
        let truth = simulation.truth();
        let mut readings = Readings {
            time_ns: sample.time_ns,
            specific_force_m_s2: sample.specific_force_m_s2,
            body_rates_rad_s: sample.body_rates_rad_s,
            position_ned_m: truth.position_ned_m,
            velocity_ned_m_s: truth.velocity_ned_m_s,
            attitude_rad: truth.attitude_rad,
            ..Readings::default()
        };
        if let Wrong::Readings(change) = wrong {
            change(&mut readings);
        }
        write_answer(&mut line, &readings, &RcChannels::default());
        let line = if let Wrong::Line(change) = wrong {
            change(&line)
        } else {
            line.clone()
        };
        socket.send_to(line.as_bytes(), from).unwrap();
    }
}

fn examined(wrong: Wrong, seed: u64) -> Result<Vec<Observation>, String> {
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    let plant = socket.local_addr().unwrap();
    std::thread::scope(|scope| {
        scope.spawn(move || serve(&socket, wrong, seed));
        examine(plant, &AZIMUTHS)
    })
}

#[test]
fn scenario_our_plant_is_right() {
    for seed in 0..5 {
        let seen = examined(Wrong::Nothing, seed).unwrap();
        let wrong: Vec<&Observation> = seen.iter().filter(|observation| !observation.right).collect();
        assert!(wrong.is_empty() && seen.len() >= 9, "{seen:?}");
    }
}

#[test]
fn scenario_wrong_plants_are_named() {
    let cases: [(&str, Wrong, &str, &str); 14] = [
        (
            "g",
            Wrong::Readings(|r| r.specific_force_m_s2 = r.specific_force_m_s2.map(|x| x / 9.80665)),
            "accel_body",
            "in g",
        ),
        (
            "FLU",
            Wrong::Readings(|r| r.specific_force_m_s2[2] *= -1.0),
            "accel_body",
            "points down",
        ),
        (
            "gravity",
            Wrong::Readings(|r| r.specific_force_m_s2 = [0.0; 3]),
            "accel_body",
            "specific force",
        ),
        (
            "z up",
            Wrong::Readings(|r| r.position_ned_m[2] *= -1.0),
            "position",
            "z points down",
        ),
        (
            "v up",
            Wrong::Readings(|r| r.velocity_ned_m_s[2] *= -1.0),
            "velocity",
            "sign",
        ),
        (
            "cm/s",
            Wrong::Readings(|r| r.velocity_ned_m_s = r.velocity_ned_m_s.map(|x| 100.0 * x)),
            "velocity",
            "cm/s",
        ),
        (
            "degrees",
            Wrong::Readings(|r| r.attitude_rad = r.attitude_rad.map(f64::to_degrees)),
            "attitude",
            "in degrees",
        ),
        (
            "degrees a second",
            Wrong::Readings(|r| r.body_rates_rad_s = r.body_rates_rad_s.map(f64::to_degrees)),
            "attitude",
            "rates are in degrees",
        ),
        (
            "roll",
            Wrong::Readings(|r| r.attitude_rad[0] *= -1.0),
            "attitude",
            "sign",
        ),
        (
            "q",
            Wrong::Readings(|r| r.body_rates_rad_s[1] *= -1.0),
            "gyro",
            "reversed",
        ),
        (
            "milliseconds",
            Wrong::Readings(|r| r.time_ns *= 1000),
            "timestamp",
            "milliseconds",
        ),
        ("order", Wrong::Order([4, 1, 2, 5, 3, 0]), "gyro", "expected"),
        (
            "all the same",
            Wrong::Readings(|r| r.position_ned_m[2] = 0.0),
            "position",
            "does not move",
        ),
        ("echo", Wrong::Echo, "answers", "answered again"),
    ];
    for (name, wrong, key, words) in cases {
        let seen = examined(wrong, 1).unwrap();
        let named = seen
            .iter()
            .any(|o| !o.right && o.key == key && o.sentence.contains(words));
        assert!(named, "{name}: {seen:?}");
    }
}

#[test]
fn scenario_lines_that_ardupilot_cannot_read_are_named() {
    let cases: [(Wrong, &str); 4] = [
        (Wrong::Line(|line| line.replace(":[", ": [")), "expected no space there"),
        (Wrong::Line(|line| line.trim_end().to_owned()), "newline"),
        (
            Wrong::Line(|line| line.replace("accel_body", "accel")),
            "without \"accel_body\"",
        ),
        (
            Wrong::Line(|line| line.replacen("\"gyro\":[", "\"gyro\":[NaN,", 1)),
            "'NaN' in \"gyro\"",
        ),
    ];
    for (wrong, words) in cases {
        let sentence = examined(wrong, 1).unwrap_err();
        assert!(
            sentence.contains(words) && sentence.starts_with("frame 0"),
            "{sentence}"
        );
    }
}
