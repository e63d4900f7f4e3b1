//! Messages for a ground station that displays a flight: those of a vehicle without autopilot, sent to one address over UDP.
//!
//! ```text
//!  HEARTBEAT 1 Hz │ ATTITUDE, LOCAL_POSITION_NED, GLOBAL_POSITION_INT, SERVO_OUTPUT_RAW with each state │ SYS_STATUS, GPS_RAW_INT 2 Hz │ STATUSTEXT
//! ```
//! Send-only: replies are ignored. The encoding matches pymavlink's (see the tests).

use super::catalogue::{
    ATTITUDE, GLOBAL_POSITION_INT, GPS_RAW_INT, HEARTBEAT, LOCAL_POSITION_NED, SERVO_OUTPUT_RAW, STATUSTEXT, SYS_STATUS,
};
use super::frame::encode;
use super::steering::{Heartbeat, LocalPosition, StatusText};
use std::net::{SocketAddr, UdpSocket};

const SYSTEM: u8 = 1;
const COMPONENT: u8 = 1;
/// MAV_AUTOPILOT_GENERIC, MAV_TYPE_QUADROTOR, _HEXAROTOR, _OCTOROTOR.
const GENERIC: u8 = 0;
const VEHICLES: [(usize, u8); 3] = [(4, 2), (6, 13), (8, 14)];
/// MAV_MODE_FLAG: custom mode, armed.
const FLYING: u8 = 1 | 128;
/// MAV_STATE_ACTIVE.
const ACTIVE: u8 = 4;
/// Simulated time, s, between two of each.
const HEARTBEAT_S: f64 = 1.0;
const STATUS_S: f64 = 0.5;
/// Present and healthy sensors, as ground stations read SYS_STATUS: gyroscope, accelerometer, GPS, attitude and position control, motors, battery.
const SENSORS: u32 = 1 | 2 | 1 << 5 | 1 << 10 | 1 << 11 | 1 << 14 | 1 << 15 | 1 << 25;
/// One state of the vehicle.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Shown {
    /// Simulated time, s.
    pub time_s: f64,
    /// m, NED from home.
    pub position_ned_m: [f64; 3],
    /// Latitude and longitude, degrees, and altitude above mean sea level, m, of the same.
    pub geodetic: [f64; 3],
    /// m/s, NED.
    pub velocity_ned_m_s: [f64; 3],
    /// Roll, pitch, yaw, rad.
    pub attitude_rad: [f64; 3],
    /// rad/s, body.
    pub body_rates_rad_s: [f64; 3],
    /// Fractions, by our rotors.
    pub duty: Vec<f64>,
    /// V.
    pub battery_voltage_v: f64,
    /// A, discharge positive.
    pub battery_current_a: f64,
    /// Fraction; `None` if unknown.
    pub state_of_charge: Option<f64>,
}

/// Sends to one ground station.
#[derive(Debug)]
pub struct Broadcast {
    socket: UdpSocket,
    to: SocketAddr,
    vehicle: u8,
    sequence: u8,
    heartbeat_s: f64,
    status_s: f64,
}

impl Broadcast {
    /// Sends from a free port to `to`.
    ///
    /// # Errors
    /// No port can be opened.
    pub fn new(to: SocketAddr, rotors: usize) -> Result<Self, String> {
        let any: SocketAddr = if to.is_ipv4() {
            ([0, 0, 0, 0], 0).into()
        } else {
            ([0_u16; 8], 0).into()
        };
        let socket =
            UdpSocket::bind(any).map_err(|error| format!("cannot open UDP to send MAVLink to {to}: {error}"))?;
        let vehicle = VEHICLES
            .iter()
            .find(|(count, _)| *count == rotors)
            .map_or(0, |(_, kind)| *kind);
        Ok(Self {
            socket,
            to,
            vehicle,
            sequence: 0,
            heartbeat_s: f64::NEG_INFINITY,
            status_s: f64::NEG_INFINITY,
        })
    }

    /// Sends a state. A missing ground station costs nothing.
    pub fn show(&mut self, shown: &Shown) {
        if shown.time_s - self.heartbeat_s >= HEARTBEAT_S {
            self.heartbeat_s = shown.time_s;
            let heartbeat = Heartbeat {
                custom_mode: 0,
                vehicle: self.vehicle,
                autopilot: GENERIC,
                base_mode: FLYING,
                system_status: ACTIVE,
            };
            self.send(HEARTBEAT, &heartbeat.encode());
        }
        self.send(ATTITUDE, &attitude(shown));
        let local = LocalPosition {
            time_boot_ms: boot_ms(shown),
            position: shown.position_ned_m.map(|x| x as f32),
            velocity: shown.velocity_ned_m_s.map(|x| x as f32),
        };
        self.send(LOCAL_POSITION_NED, &local.encode());
        self.send(GLOBAL_POSITION_INT, &global_position(shown));
        self.send(SERVO_OUTPUT_RAW, &servo_output(shown));
        if shown.time_s - self.status_s >= STATUS_S {
            self.status_s = shown.time_s;
            self.send(SYS_STATUS, &system_status(shown));
            self.send(GPS_RAW_INT, &gps_raw(shown));
        }
    }

    /// Sends a text; `severity` from 0, emergency, to 7, debug. Texts longer than a message are split.
    pub fn say(&mut self, severity: u8, text: &str) {
        let mut piece = String::new();
        for character in text.chars().map(Some).chain([None]) {
            let full = character.is_none_or(|character| piece.len() + character.len_utf8() > StatusText::LONGEST);
            if full && !piece.is_empty() {
                let text = std::mem::take(&mut piece);
                self.send(STATUSTEXT, &StatusText { severity, text }.encode());
            }
            piece.extend(character);
        }
    }

    fn send(&mut self, message: u32, payload: &[u8]) {
        let bytes = encode(self.sequence, SYSTEM, COMPONENT, message, payload);
        self.sequence = self.sequence.wrapping_add(1);
        if let Err(error) = self.socket.send_to(&bytes, self.to) {
            tracing::debug!(%error, "MAVLink for a ground station");
        }
    }
}

fn boot_ms(shown: &Shown) -> u32 {
    (1e3 * shown.time_s) as u32
}

/// ATTITUDE.
fn attitude(shown: &Shown) -> Vec<u8> {
    let mut bytes = boot_ms(shown).to_le_bytes().to_vec();
    for value in shown.attitude_rad.into_iter().chain(shown.body_rates_rad_s) {
        bytes.extend((value as f32).to_le_bytes());
    }
    bytes
}

/// Latitude and longitude, 1e-7 degrees; height above the sea, and above home, mm.
fn geodetic(shown: &Shown) -> [i32; 4] {
    let [latitude, longitude, altitude] = shown.geodetic;
    [
        1e7 * latitude,
        1e7 * longitude,
        1e3 * altitude,
        -1e3 * shown.position_ned_m[2],
    ]
    .map(|x| x.round() as i32)
}

fn centi(value: f64) -> i16 {
    (100.0 * value).round() as i16
}

/// GLOBAL_POSITION_INT.
fn global_position(shown: &Shown) -> Vec<u8> {
    let mut bytes = boot_ms(shown).to_le_bytes().to_vec();
    for value in geodetic(shown) {
        bytes.extend(value.to_le_bytes());
    }
    for value in shown.velocity_ned_m_s {
        bytes.extend(centi(value).to_le_bytes());
    }
    let heading = shown.attitude_rad[2].to_degrees().rem_euclid(360.0);
    bytes.extend(((100.0 * heading).round() as u16 % 36_000).to_le_bytes());
    bytes
}

/// SERVO_OUTPUT_RAW: 1000 to 2000 µs by our rotors.
fn servo_output(shown: &Shown) -> Vec<u8> {
    let mut bytes = ((1e6 * shown.time_s) as u64 as u32).to_le_bytes().to_vec();
    for rotor in 0..8 {
        let pulse = shown
            .duty
            .get(rotor)
            .map_or(0, |duty| (1000.0 + 1000.0 * duty).round() as u16);
        bytes.extend(pulse.to_le_bytes());
    }
    bytes.push(0);
    bytes
}

/// SYS_STATUS.
fn system_status(shown: &Shown) -> Vec<u8> {
    let mut bytes = Vec::new();
    for _present_enabled_healthy in 0..3 {
        bytes.extend(SENSORS.to_le_bytes());
    }
    bytes.extend(0_u16.to_le_bytes());
    bytes.extend(((1e3 * shown.battery_voltage_v).round() as u16).to_le_bytes());
    bytes.extend(centi(shown.battery_current_a).to_le_bytes());
    bytes.extend([0; 12]);
    let left = shown
        .state_of_charge
        .map_or(-1, |charge| (100.0 * charge).round() as i8);
    bytes.extend(left.to_le_bytes());
    bytes
}

/// GPS_RAW_INT: a fix without errors.
fn gps_raw(shown: &Shown) -> Vec<u8> {
    const FIX_3D: u8 = 3;
    const SATELLITES: u8 = 10;
    let [latitude, longitude, altitude, _] = geodetic(shown);
    let mut bytes = ((1e6 * shown.time_s) as u64).to_le_bytes().to_vec();
    for value in [latitude, longitude, altitude] {
        bytes.extend(value.to_le_bytes());
    }
    let [north, east, _] = shown.velocity_ned_m_s;
    let course = east.atan2(north).to_degrees().rem_euclid(360.0);
    for value in [
        100,
        100,
        (100.0 * north.hypot(east)).round() as u16,
        (100.0 * course).round() as u16 % 36_000,
    ] {
        bytes.extend(value.to_le_bytes());
    }
    bytes.extend([FIX_3D, SATELLITES]);
    bytes
}

#[cfg(test)]
mod tests {
    use super::super::frame::Decoder;
    use super::super::hex::bytes;
    use super::*;
    use std::time::Duration;

    // Packed by pymavlink 2.4.50: sequence 5, system 1, component 1.
    const ATTITUDE_BYTES: &str = "fd1c00000501011e0000d43000000000003e000080be0000c0bf0000003f000080bd0000403f532b";
    const GLOBAL_BYTES: &str = "fd1c0000050101210000d43000009c52401c7af51705f27e0700b20c00007d0006ff32000e6b1db3";
    const SERVO_BYTES: &str = "fd10000005010124000020bcbe00e204dc05d007e8035f05590641d5";
    const STATUS_BYTES: &str = "fd1f000005010101000023cc000223cc000223cc000200008c3cc904000000000000000000000000583a90";
    const GPS_BYTES: &str = "fd1e000005010118000020bcbe00000000009c52401c7af51705f27e0700640064001801d973030ae7a1";

    fn shown() -> Shown {
        Shown {
            time_s: 12.5,
            position_ned_m: [1.0, 2.0, -3.25],
            geodetic: [47.39775, 8.545625, 491.25],
            velocity_ned_m_s: [1.25, -2.5, 0.5],
            attitude_rad: [0.125, -0.25, -1.5],
            body_rates_rad_s: [0.5, -0.0625, 0.75],
            duty: vec![0.25, 0.5, 1.0, 0.0, 0.375, 0.625],
            battery_voltage_v: 15.5,
            battery_current_a: 12.25,
            state_of_charge: Some(0.875),
        }
    }

    #[test]
    fn val_messages_have_the_bytes_of_pymavlink() {
        let frame = |message, payload: &[u8]| encode(5, SYSTEM, COMPONENT, message, payload);
        let shown = shown();
        assert_eq!(frame(ATTITUDE, &attitude(&shown)), bytes(ATTITUDE_BYTES));
        assert_eq!(
            frame(GLOBAL_POSITION_INT, &global_position(&shown)),
            bytes(GLOBAL_BYTES)
        );
        assert_eq!(frame(SERVO_OUTPUT_RAW, &servo_output(&shown)), bytes(SERVO_BYTES));
        assert_eq!(frame(SYS_STATUS, &system_status(&shown)), bytes(STATUS_BYTES));
        assert_eq!(frame(GPS_RAW_INT, &gps_raw(&shown)), bytes(GPS_BYTES));
    }

    #[test]
    fn val_a_ground_station_gets_states_and_whole_sentences() {
        let station = UdpSocket::bind("127.0.0.1:0").expect("a free port");
        station
            .set_read_timeout(Some(Duration::from_secs(5)))
            .expect("a time-out");
        let mut broadcast = Broadcast::new(station.local_addr().expect("an address"), 6).expect("a port");
        broadcast.show(&shown());
        let sentence =
            "sequential: rotor 3 faulty (probability 0.9999, loses 0.253 N [0.231, 0.275]), 10 µs – and more";
        broadcast.say(2, sentence);
        let mut decoder = Decoder::default();
        let (mut kinds, mut heard) = (Vec::new(), String::new());
        // Seven messages of the state, a sentence in two or three.
        while kinds.len() < 7 || !heard.ends_with("more") {
            let mut buffer = [0; 400];
            let length = station.recv(&mut buffer).expect("a datagram in time");
            decoder.push(&buffer[..length]);
            let frame = decoder.next_frame().expect("one frame in a datagram");
            kinds.push(frame.message);
            if let Some(text) = StatusText::read(&frame) {
                assert_eq!(text.severity, 2);
                // The reader trims whitespace at the ends of a piece.
                heard = format!("{} {}", heard.trim(), text.text);
            }
        }
        assert_eq!(
            kinds[..7],
            [
                HEARTBEAT,
                ATTITUDE,
                LOCAL_POSITION_NED,
                GLOBAL_POSITION_INT,
                SERVO_OUTPUT_RAW,
                SYS_STATUS,
                GPS_RAW_INT
            ]
        );
        let letters = |text: &str| text.chars().filter(|c| !c.is_whitespace()).collect::<String>();
        assert_eq!(letters(&heard), letters(sentence));
    }
}
