//! PX4 as the plant sees it: it connects by TCP, gets sensors only, estimates its state from them, and flies with our own PID.

use super::px4_estimate::Estimate;
use super::scripted_pilot::{Motion, Pilot, Plan};
use rotortwin_bridge::mavlink::frame::{Decoder, encode};
use rotortwin_bridge::mavlink::messages::{HEARTBEAT, HIL_ACTUATOR_CONTROLS, HilActuatorControls, HilGps, HilSensor};
use rotortwin_scenario::Scenario;
use std::io::{Read as _, Write as _};
use std::net::{SocketAddr, TcpStream};
use std::thread::JoinHandle;
use std::time::Duration;

/// Our rotor of each channel: hexarotor X.
const ROTOR_OF_CHANNEL: [usize; 6] = [2, 5, 6, 3, 1, 4];
/// Simulated time at which it arms, s.
const ARMS_S: f64 = 2.0;
/// First answer: about 70 ms after the first sample.
const FIRST_ANSWER: u64 = 18;

/// Connects to the plant at `to`, hovers at `height_m` over the origin, and flies a tour from `tour_s` of simulated time on. It ends with
/// the connection.
pub(crate) fn start(to: SocketAddr, scenario: &Scenario, height_m: f64, tour_s: f64) -> JoinHandle<()> {
    start_until(to, scenario, height_m, Some(tour_s), f64::INFINITY)
}

/// The same without a tour where there is none, and it closes the connection at `gone_s` of simulated time.
pub(crate) fn start_until(
    to: SocketAddr,
    scenario: &Scenario,
    height_m: f64,
    tour_s: Option<f64>,
    gone_s: f64,
) -> JoinHandle<()> {
    let plan = Plan {
        arms_s: ARMS_S,
        height_m,
        tour_s,
    };
    let pilot = Pilot::new(scenario, plan);
    std::thread::spawn(move || {
        // Waits for a plant that is not there yet.
        for _ in 0..2000 {
            if let Ok(stream) = TcpStream::connect(to) {
                return serve(stream, pilot, gone_s);
            }
            std::thread::sleep(Duration::from_millis(20));
        }
    })
}

/// Flies until the connection closes, or it is to be gone.
fn serve(mut stream: TcpStream, mut pilot: Pilot, gone_s: f64) {
    stream.set_nodelay(true).expect("a connection");
    let hello = encode(0, 1, 1, HEARTBEAT, &[0, 0, 0, 0, 2, 12, 0, 0, 3]);
    stream.write_all(&hello).expect("a connection");
    let (mut estimate, mut decoder) = (Estimate::new(), Decoder::default());
    let (mut samples, mut last_us, mut buffer) = (0, None, [0; 4096]);
    while let Ok(length) = stream.read(&mut buffer)
        && length > 0
    {
        decoder.push(&buffer[..length]);
        while let Some(frame) = decoder.next_frame() {
            if let Some(fix) = HilGps::read(&frame) {
                estimate.satellites(&fix);
            }
            let Some(sample) = HilSensor::read(&frame) else {
                continue;
            };
            let interval = last_us.map_or(0.004, |last| (sample.time_usec - last) as f64 * 1e-6);
            last_us = Some(sample.time_usec);
            estimate.inertial(&sample, interval);
            samples += 1;
            if samples < FIRST_ANSWER {
                continue;
            }
            let time_s = sample.time_usec as f64 * 1e-6;
            if time_s > gone_s {
                return;
            }
            let motion = Motion {
                position: estimate.position,
                velocity: estimate.velocity,
                attitude: estimate.euler(),
                body_rates: sample.gyro.map(f64::from),
            };
            pilot.fly(time_s, &motion);
            let mut answer = HilActuatorControls {
                time_usec: sample.time_usec,
                flags: 1,
                mode: if time_s >= ARMS_S { 129 } else { 1 },
                ..HilActuatorControls::default()
            };
            for (channel, rotor) in ROTOR_OF_CHANNEL.into_iter().enumerate() {
                answer.controls[channel] = pilot.duty[rotor - 1] as f32;
            }
            let bytes = encode(0, 1, 1, HIL_ACTUATOR_CONTROLS, &answer.encode());
            if stream.write_all(&bytes).is_err() {
                return;
            }
        }
    }
}
