//! The reverse of a flight: acts as ArduPilot towards an unknown plant, and identifies errors in its answers.
//!
//! ```text
//!  idle 0.5 s: format, keys, units at rest ─▶ full thrust 0.4 s: does it climb? ─▶ more on one side: which way does it turn? ─▶ a repeated frame
//! ```
//! For developers of a plant for ArduPilot's JSON backend. The line is parsed as ArduPilot does: by searching for keys. The only required
//! knowledge of the vehicle is the position of each output's motor.

use super::servo_packet::ServoPacket;
use std::net::{SocketAddr, UdpSocket};
use std::time::Duration;

/// Frames of each part, at the step of the plant.
const IDLE: usize = 500;
const CLIMB: usize = 400;
const TURN: usize = 120;
/// Standard gravity, m/s².
const G: f64 = 9.80665;
/// ArduPilot repeats a request after a second.
const ASK_AGAIN: Duration = Duration::from_secs(1);
const ASKED: u32 = 5;
/// Time within which a second answer to a repeated frame would arrive.
const SECOND_ANSWER: Duration = Duration::from_millis(300);

/// One observation, right or wrong.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Observation {
    /// Key of the line, or "answers".
    pub key: &'static str,
    /// True if it is right.
    pub right: bool,
    /// Observation and expectation.
    pub sentence: String,
}

/// One answer, as parsed by ArduPilot; every number is finite.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Answer {
    /// Time of the plant, s.
    pub timestamp_s: f64,
    /// rad/s, FRD.
    pub gyro: [f64; 3],
    /// Specific force, m/s², FRD.
    pub accel: [f64; 3],
    /// m, NED.
    pub position: [f64; 3],
    /// m/s, NED.
    pub velocity: [f64; 3],
    /// Roll, pitch, yaw, rad.
    pub attitude: [f64; 3],
}

/// Acts as ArduPilot towards the plant that listens at `plant`. `azimuth_deg` of each output's motor, clockwise from the nose.
///
/// # Errors
/// No answer, or an answer that cannot be parsed at all; earlier observations are lost.
pub fn examine(plant: SocketAddr, azimuth_deg: &[f64]) -> Result<Vec<Observation>, String> {
    let socket = UdpSocket::bind(if plant.is_ipv4() { "0.0.0.0:0" } else { "[::]:0" })
        .and_then(|socket| socket.connect(plant).map(|()| socket))
        .map_err(|error| format!("UDP to {plant} cannot be opened: {error}"))?;
    let mut player = Player {
        socket,
        plant,
        frame: 0,
    };
    let mut seen = Vec::new();
    let rest = player.fly(IDLE, &[1000; 32])?;
    at_rest(&rest, &mut seen);
    let climb = player.fly(CLIMB, &pulses(azimuth_deg, |_| 1900))?;
    climbing(&climb, &mut seen);
    let before = climb.last().copied().unwrap_or_default();
    // Those on the right push more: the left side goes down.
    let right = |azimuth: f64| if azimuth.to_radians().sin() > 0.1 { 1630 } else { 1570 };
    turning(&before, &player.fly(TURN, &pulses(azimuth_deg, right))?, 0, &mut seen);
    let before = player.fly(1, &pulses(azimuth_deg, |_| 1600))?[0];
    // Those in front push more: the nose goes up.
    let front = |azimuth: f64| if azimuth.to_radians().cos() > 0.1 { 1630 } else { 1570 };
    turning(&before, &player.fly(TURN, &pulses(azimuth_deg, front))?, 1, &mut seen);
    player.repeat(&mut seen)?;
    Ok(seen)
}

fn pulses(azimuth_deg: &[f64], of: impl Fn(f64) -> u16) -> [u16; 32] {
    let mut pulses = [1000; 32];
    for (pulse, azimuth) in pulses.iter_mut().zip(azimuth_deg) {
        *pulse = of(*azimuth);
    }
    pulses
}

struct Player {
    socket: UdpSocket,
    plant: SocketAddr,
    frame: u32,
}

impl Player {
    fn packet(&self, pulses_us: &[u16; 32]) -> Vec<u8> {
        let packet = ServoPacket {
            frame_rate_hz: 1000,
            frame: self.frame,
            channels: 16,
            pulses_us: *pulses_us,
        };
        packet.encode()
    }

    fn failed(&self, error: &std::io::Error) -> String {
        format!("the socket to the plant at {} failed: {error}", self.plant)
    }

    fn ask(&mut self, pulses_us: &[u16; 32]) -> Result<Answer, String> {
        let packet = self.packet(pulses_us);
        let mut buffer = [0; 65_000];
        self.socket
            .set_read_timeout(Some(ASK_AGAIN))
            .map_err(|error| self.failed(&error))?;
        for _ in 0..ASKED {
            // If there is no receiver yet, the error concerns the previous packet.
            if self.socket.send(&packet).is_err() {
                std::thread::sleep(ASK_AGAIN);
                continue;
            }
            if let Ok(length) = self.socket.recv(&mut buffer) {
                let answer = read(&buffer[..length])
                    .map_err(|clause| format!("frame {} was answered with {clause}", self.frame));
                self.frame += 1;
                return answer;
            }
        }
        Err(format!(
            "the plant at {} did not answer frame {} within {} s, asked {ASKED} times",
            self.plant, self.frame, ASKED
        ))
    }

    fn fly(&mut self, frames: usize, pulses_us: &[u16; 32]) -> Result<Vec<Answer>, String> {
        (0..frames).map(|_| self.ask(pulses_us)).collect()
    }

    /// Repeats an answered frame: an answer to it would stay in ArduPilot's socket forever.
    fn repeat(&mut self, seen: &mut Vec<Observation>) -> Result<(), String> {
        self.ask(&[1000; 32])?;
        self.frame -= 1;
        let packet = self.packet(&[1000; 32]);
        self.socket.send(&packet).map_err(|error| self.failed(&error))?;
        self.socket
            .set_read_timeout(Some(SECOND_ANSWER))
            .map_err(|error| self.failed(&error))?;
        let mut buffer = [0; 2048];
        let again = self.socket.recv(&mut buffer).is_ok();
        let sentence = if again {
            "a repeated frame is answered again: ArduPilot flies on stale samples from then on; expected no second reply"
        } else {
            "a repeated frame is not answered again"
        };
        observe(seen, "answers", !again, sentence.to_owned());
        Ok(())
    }
}

fn observe(seen: &mut Vec<Observation>, key: &'static str, right: bool, sentence: String) {
    seen.push(Observation { key, right, sentence });
}

/// Parses a plant's line by searching for its keys.
///
/// # Errors
/// One clause: what is wrong with it, and what was expected.
pub fn read(bytes: &[u8]) -> Result<Answer, String> {
    let text = std::str::from_utf8(bytes).map_err(|error| format!("bytes that are not text: {error}"))?;
    if !text.ends_with('\n') {
        return Err("a line without a newline at its end: ArduPilot waits for it forever".to_owned());
    }
    Ok(Answer {
        timestamp_s: number(text, "timestamp")?,
        gyro: vector(text, "gyro")?,
        accel: vector(text, "accel_body")?,
        position: vector(text, "position")?,
        velocity: vector(text, "velocity")?,
        attitude: vector(text, "attitude").or_else(|clause| quaternion(text).ok_or(clause))?,
    })
}

/// The text after a key and its colon.
fn behind<'a>(text: &'a str, key: &str) -> Result<&'a str, String> {
    let quoted = format!("\"{key}\":");
    let start = text.find(&quoted).ok_or_else(|| format!("a line without \"{key}\":"))?;
    Ok(&text[start + quoted.len()..])
}

fn number(text: &str, key: &str) -> Result<f64, String> {
    let rest = behind(text, key)?.trim_start();
    let end = rest.find([',', '}']).unwrap_or(rest.len());
    finite(rest[..end].trim(), key)
}

fn finite(text: &str, key: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value.is_finite() => Ok(value),
        _ => Err(format!("'{text}' in \"{key}\", expected a finite number")),
    }
}

fn list(text: &str, key: &str) -> Result<Vec<f64>, String> {
    let rest = behind(text, key)?;
    let Some(rest) = rest.strip_prefix('[') else {
        return Err(format!(
            "something between \"{key}\": and its [: ArduPilot fails to parse it and waits forever; expected no space there"
        ));
    };
    let end = rest.find(']').ok_or_else(|| format!("\"{key}\" without its ]"))?;
    rest[..end].split(',').map(|part| finite(part.trim(), key)).collect()
}

fn vector(text: &str, key: &str) -> Result<[f64; 3], String> {
    match list(text, key)?[..] {
        [x, y, z] => Ok([x, y, z]),
        ref other => Err(format!("{} numbers in \"{key}\", expected 3", other.len())),
    }
}

/// Roll, pitch, yaw of "quaternion".
fn quaternion(text: &str) -> Option<[f64; 3]> {
    let [w, x, y, z] = <[f64; 4]>::try_from(list(text, "quaternion").ok()?).ok()?;
    let roll = (2.0 * (w * x + y * z)).atan2(1.0 - 2.0 * (x * x + y * y));
    let pitch = (2.0 * (w * y - z * x)).clamp(-1.0, 1.0).asin();
    let yaw = (2.0 * (w * z + x * y)).atan2(1.0 - 2.0 * (y * y + z * z));
    // Of numbers near the largest there is.
    let attitude = [roll, pitch, yaw];
    attitude.iter().all(|angle| angle.is_finite()).then_some(attitude)
}

fn length(v: [f64; 3]) -> f64 {
    v.iter().map(|x| x * x).sum::<f64>().sqrt()
}

fn at_rest(answers: &[Answer], seen: &mut Vec<Observation>) {
    let steps: Vec<f64> = answers
        .windows(2)
        .map(|pair| pair[1].timestamp_s - pair[0].timestamp_s)
        .collect();
    let (least, most) = steps
        .iter()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(*x), b.max(*x)));
    let right = least > 0.0 && most < 0.1;
    let hint = if (0.1..200.0).contains(&most) {
        " (milliseconds?)"
    } else {
        ""
    };
    observe(
        seen,
        "timestamp",
        right,
        format!("steps of {least:.6} to {most:.6} s{hint}, expected more than 0 and less than 0.1"),
    );
    let last = answers.last().copied().unwrap_or_default();
    let [x, y, z] = last.accel;
    let size = length(last.accel);
    let (right, what) = if (size - 1.0).abs() < 0.1 {
        (false, ": it is in g, expected m/s²")
    } else if (size - G).abs() > 0.5 {
        (false, ": expected the specific force, 9.81 m/s² at rest")
    } else if z > 0.9 * size {
        (
            false,
            ": it points down, expected the specific force in FRD, (0, 0, -9.81) at rest",
        )
    } else if z > -0.9 * size {
        (false, ": expected (0, 0, -9.81) at rest on level ground, FRD")
    } else {
        (true, "")
    };
    observe(
        seen,
        "accel_body",
        right,
        format!("({x:.3}, {y:.3}, {z:.3}) at rest{what}"),
    );
    let still = length(last.gyro) < 0.05;
    observe(
        seen,
        "gyro",
        still,
        format!("{:.4} rad/s at rest, expected less than 0.05", length(last.gyro)),
    );
}

fn climbing(answers: &[Answer], seen: &mut Vec<Observation>) {
    let (Some(first), Some(last)) = (answers.first(), answers.last()) else {
        return;
    };
    let (time_s, rise) = (
        last.timestamp_s - first.timestamp_s,
        last.position[2] - first.position[2],
    );
    let (right, what) = if rise.abs() < 0.02 {
        (false, ": it does not move; expected it to climb")
    } else if rise > 0.0 {
        (false, ": z grows, expected it to fall: NED, z points down")
    } else {
        (true, "")
    };
    observe(
        seen,
        "position",
        right,
        format!("z changes by {rise:.3} m in {time_s:.2} s at 1900 µs{what}"),
    );
    let moved: f64 = answers
        .windows(2)
        .map(|pair| 0.5 * (pair[0].velocity[2] + pair[1].velocity[2]) * (pair[1].timestamp_s - pair[0].timestamp_s))
        .sum();
    if rise.abs() < 0.02 {
        return;
    }
    let ratio = moved / rise;
    let right = (0.8..1.25).contains(&ratio);
    let what = match ratio {
        r if (-1.25..-0.8).contains(&r) => ": its sign does not fit that of the position",
        r if (80.0..125.0).contains(&r) => ": it is in cm/s, expected m/s",
        _ if right => "",
        _ => ": it does not fit the change of the position",
    };
    observe(
        seen,
        "velocity",
        right,
        format!("its sum over time is {moved:.3} m{what}"),
    );
}

/// Checks the motion of `axis`, 0 roll or 1 pitch, while one side pushes more: roll decreases, pitch increases.
fn turning(before: &Answer, answers: &[Answer], axis: usize, seen: &mut Vec<Observation>) {
    let Some(last) = answers.last() else { return };
    let name = ["roll", "pitch"][axis];
    let expected = [-1.0, 1.0][axis];
    let side = ["right", "front"][axis];
    let mut turned = 0.0;
    let mut previous = before;
    for answer in answers {
        turned += 0.5 * (previous.gyro[axis] + answer.gyro[axis]) * (answer.timestamp_s - previous.timestamp_s);
        previous = answer;
    }
    let other = 1 - axis;
    // Change since the push began: it may already turn about the other axis.
    let gained = [0, 1].map(|i| last.gyro[i] - before.gyro[i]);
    let swapped = gained[other].abs() > 3.0 * gained[axis].abs();
    let (right, what) = if swapped {
        (
            false,
            ": it turns about the other axis; expected the outputs at the motor positions of the table, and p, q, r in FRD",
        )
    } else if gained[axis] * expected < 0.0 {
        (false, ": reversed; expected FRD, or motors are mirrored")
    } else if gained[axis] == 0.0 {
        (false, ": it does not turn")
    } else {
        (true, "")
    };
    observe(
        seen,
        "gyro",
        right,
        format!(
            "{name}: the rate changes by {:+.4} rad/s while the motors at the {side} push more{what}",
            gained[axis]
        ),
    );
    if turned.abs() < 1e-3 || swapped {
        return;
    }
    let change = last.attitude[axis] - before.attitude[axis];
    let ratio = change / turned;
    let degrees = 180.0 / std::f64::consts::PI;
    let near = |x: f64| (ratio / x - 1.0).abs() < 0.3;
    let what = if near(1.0) {
        ""
    } else if near(degrees) {
        ": the attitude is in degrees, or the rates are too small by as much; expected radians"
    } else if near(1.0 / degrees) {
        ": the rates are in degrees, expected rad/s"
    } else if near(-1.0) {
        ": its sign does not fit that of the rates"
    } else {
        ": it does not fit the rates"
    };
    observe(
        seen,
        "attitude",
        what.is_empty(),
        format!("{name} changes by {change:+.4}, the rates sum to {turned:+.4} rad{what}"),
    );
}
