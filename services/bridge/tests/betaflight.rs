//! The link to Betaflight against a scripted peer, written from docs/autopilots.md alone: pace, switches, and failures.
#![expect(clippy::unwrap_used, reason = "a scripted peer that cannot send has failed its test")]

mod autopilots;
mod failures;
mod leveller;
mod links;

use autopilots::{HEXAROTOR, Watch, scenario_of};
use failures::sentence;
use leveller::{Leveller, channels, motors};
use links::{flown, outputs};
use rotortwin_bridge::autopilot::betaflight::Betaflight;
use rotortwin_bridge::autopilot::{OutputMap, Patience};
use rotortwin_flight::autopilot::AutopilotOutcome;
use rotortwin_flight::lockstep::FlightEnd;
use rotortwin_scenario::autopilot_frame::AutopilotKind;
use rotortwin_wire::autopilot::{Autopilot, Readings};
use std::net::UdpSocket;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU16, Ordering};
use std::time::Duration;

/// Answers each state with motors; counts received packets, and keeps the last sticks.
struct Peer {
    states: u64,
    time_s: Vec<f64>,
    sticks: Vec<[u16; 16]>,
}

/// Its reply to the state of a number.
type Script = fn(u64) -> Vec<u8>;

fn map() -> OutputMap {
    OutputMap {
        rotor_of_channel: vec![2, 0, 3, 5, 1, 4],
        pulse_min_us: 1000.0,
        pulse_max_us: 2000.0,
    }
}

fn patience() -> Patience {
    Patience {
        join: Duration::from_secs(5),
        step: Duration::from_millis(400),
        ..Patience::default()
    }
}

/// Four free consecutive ports: motors, an unused one, states, sticks. No two calls use the same ones: the motor port is released
/// here and reopened by the link.
fn ports() -> (u16, UdpSocket, UdpSocket) {
    static NEXT: AtomicU16 = AtomicU16::new(20_000);
    loop {
        let base = NEXT.fetch_add(10, Ordering::Relaxed);
        assert!(base < 32_000, "no four free ports");
        let at = |port: u16| UdpSocket::bind(("127.0.0.1", port));
        if let (Ok(_), Ok(states), Ok(sticks)) = (at(base), at(base + 2), at(base + 3)) {
            return (base + 2, states, sticks);
        }
    }
}

/// Connects a link and a scripted peer.
fn talk<T>(script: Script, work: impl FnOnce(&mut Betaflight) -> T) -> (T, Peer) {
    let (port, states, sticks) = ports();
    let mut link = Betaflight::listen(
        &format!("betaflight:{port}@2").parse().unwrap(),
        true,
        map(),
        patience(),
    )
    .unwrap();
    let stop = Arc::new(AtomicBool::new(false));
    std::thread::scope(|scope| {
        let stopped = stop.clone();
        let peer = scope.spawn(move || {
            let mut peer = Peer {
                states: 0,
                time_s: Vec::new(),
                sticks: Vec::new(),
            };
            states.set_read_timeout(Some(Duration::from_millis(5))).unwrap();
            sticks.set_nonblocking(true).unwrap();
            let mut buffer = [0; 256];
            while !stopped.load(Ordering::Relaxed) {
                if let Ok((length, from)) = states.recv_from(&mut buffer) {
                    assert_eq!(length, 144);
                    peer.time_s.push(f64::from_le_bytes(buffer[..8].try_into().unwrap()));
                    states.send_to(&script(peer.states), from).unwrap();
                    peer.states += 1;
                }
                while let Ok(length) = sticks.recv(&mut buffer) {
                    peer.sticks.push(channels(&buffer[..length]));
                }
            }
            peer
        });
        let result = work(&mut link);
        // The last packets are read.
        std::thread::sleep(Duration::from_millis(50));
        stop.store(true, Ordering::Relaxed);
        (result, peer.join().unwrap())
    })
}

#[test]
fn val_motors_reach_their_rotors_and_a_pause_is_never_caught_up() {
    let script: Script = |_| motors([1100.0, 1200.0, 1300.0, 1400.0, 1500.0, 1600.0]);
    let (exchanges, peer) = talk(script, |link| {
        let readings = Readings::default();
        let mut duty = link.exchange(&readings).unwrap();
        for exchange in 0..200 {
            if exchange == 100 {
                std::thread::sleep(Duration::from_millis(300));
            }
            duty = link.exchange(&readings).unwrap();
        }
        let expected = [0.2, 0.5, 0.1, 0.3, 0.6, 0.4];
        for (got, expected) in duty.iter().zip(expected) {
            assert!((got - expected).abs() < 1e-6, "{duty:?}");
        }
        let pace = link.pace();
        assert!(pace.longest >= Duration::from_millis(300) && pace.late >= 1, "{pace:?}");
        pace.states
    });
    // One state per exchange, and those used for joining; time stamps are 2 ms apart, even across the pause.
    assert_eq!(exchanges, 201);
    assert!(peer.states >= 201, "{}", peer.states);
    assert!(
        peer.time_s
            .windows(2)
            .all(|pair| (pair[1] - pair[0] - 0.002).abs() < 1e-9)
    );
    // The boot grace: throttle down, arm switch off, ANGLE on.
    assert!(peer.sticks.len() >= 40);
    assert!(peer.sticks.iter().all(|c| c[2] == 1000 && c[4] == 1000 && c[5] == 2000));
}

#[test]
fn scenario_failures_name_peer_and_state() {
    let flown = |script: Script| {
        let (sentence, _) = talk(script, |link| {
            let readings = Readings::default();
            (0..2000).find_map(|_| link.exchange(&readings).err()).unwrap().sentence
        });
        sentence
    };
    let pulse = flown(|state| {
        motors([
            1000.0,
            if state < 50 { 1000.0 } else { f32::NAN },
            1000.0,
            1000.0,
            1000.0,
            1000.0,
        ])
    });
    assert!(
        pulse.starts_with("Betaflight at 127.0.0.1:")
            && pulse.contains("motor 2 has a pulse of NaN µs, expected 0 to 2600"),
        "{pulse}"
    );
    let silent = flown(|state| if state < 50 { motors([1000.0; 6]) } else { vec![1; 16] });
    assert!(
        silent.contains("sent no motors after state ") && silent.contains("allowed are 400 ms (--step-timeout)"),
        "{silent}"
    );
    assert!(
        silent.ends_with("datagrams of another size came, the last of 16 bytes, expected 68"),
        "{silent}"
    );
}

#[test]
fn scenario_nobody_comes_or_the_port_is_taken() {
    let (port, states, _sticks) = ports();
    let address = format!("betaflight:{port}").parse().unwrap();
    let impatient = Patience {
        join: Duration::from_millis(200),
        ..patience()
    };
    let mut link = Betaflight::listen(&address, true, map(), impatient).unwrap();
    let said = link.exchange(&Readings::default()).unwrap_err().sentence;
    let at = port - 2;
    assert_eq!(
        said,
        format!(
            "no motors of Betaflight came to UDP 127.0.0.1:{at} within 200 ms (--join-timeout) of states to 127.0.0.1:{port}"
        )
    );
    let busy = Betaflight::listen(&address, true, map(), patience()).unwrap_err();
    assert!(
        busy.starts_with(&format!(
            "cannot open UDP 127.0.0.1:{at} to receive the motors of Betaflight: "
        )),
        "{busy}"
    );
    drop(states);
}

/// Fate of the answer to a state.
#[derive(Clone, Copy, PartialEq)]
enum Answer {
    Sent,
    Twice,
    Lost,
    /// After the next one.
    Late,
    /// After a thousand invalid datagrams.
    Flooded,
    /// No answers from here on.
    Gone,
    /// It starts again with this one.
    Restart,
}

/// Fate of the answer to the state of a number.
type Happens = fn(u64) -> Answer;

/// Flies a scenario with a peer that levels itself.
fn fly(duration_s: f64, more: &str, happens: Happens) -> (AutopilotOutcome, Watch) {
    let scenario = scenario_of(HEXAROTOR, duration_s, more);
    let (port, states, sticks) = ports();
    let mut link = Betaflight::listen(
        &format!("betaflight:{port}@1").parse().unwrap(),
        true,
        outputs(AutopilotKind::Betaflight, &scenario),
        patience(),
    )
    .unwrap();
    let mut watch = Watch::default();
    let stop = Arc::new(AtomicBool::new(false));
    std::thread::scope(|scope| {
        let stopped = stop.clone();
        let peer = scope.spawn(move || {
            let mut leveller = Leveller::default();
            let mut held: Option<Vec<u8>> = None;
            states.set_read_timeout(Some(Duration::from_millis(5))).unwrap();
            sticks.set_nonblocking(true).unwrap();
            let mut buffer = [0; 256];
            let mut count = 0;
            while !stopped.load(Ordering::Relaxed) {
                while let Ok(length) = sticks.recv(&mut buffer) {
                    leveller.take(channels(&buffer[..length]));
                }
                let Ok((_, from)) = states.recv_from(&mut buffer) else {
                    continue;
                };
                if happens(count) == Answer::Restart {
                    leveller.restart();
                }
                let answer = motors(leveller.pulses(&buffer));
                let send = |bytes: &[u8]| states.send_to(bytes, from).unwrap();
                match happens(count) {
                    Answer::Gone => return,
                    Answer::Lost => {}
                    Answer::Late => held = Some(answer),
                    happens => {
                        if happens == Answer::Flooded {
                            for _ in 0..1000 {
                                send(&[7; 16]);
                            }
                        }
                        send(&answer);
                        if happens == Answer::Twice {
                            send(&answer);
                        }
                        if let Some(held) = held.take() {
                            send(&held);
                        }
                    }
                }
                count += 1;
            }
        });
        let outcome = flown(&scenario, &mut link, &mut watch);
        stop.store(true, Ordering::Relaxed);
        drop(link);
        peer.join().unwrap();
        (outcome, watch)
    })
}

#[test]
fn scenario_takes_off_holds_lands_and_the_damaged_propeller_is_isolated() {
    let fault = "[[fault]]\ntime_s = 12.0\nrotor = 3\nthrust_loss_percent = 10.0";
    let (outcome, watch) = fly(18.0, fault, |_| Answer::Sent);
    assert_eq!(outcome.flight.end, FlightEnd::Done, "{:?}", outcome.flight.end);
    assert_eq!(outcome.flight.steps, 7200);
    assert!(watch.farthest_m < 1.0, "{} m", watch.farthest_m);
    assert_eq!(watch.verdict, 3);
    // From 1.5 m at 0.5 m/s, and a moment to be sure that it stands.
    let landing_s = outcome.landing_s.expect("it has landed, with its motors off");
    assert!((2.0..20.0).contains(&landing_s), "{landing_s} s");
}

/// Not lockstep: if motors are lost or late, the previous ones stay in force, and the vehicle keeps flying.
#[test]
fn scenario_lost_late_doubled_and_flooded_motors_are_flown_with() {
    let scripts: [(&str, Happens); 4] = [
        ("twice", |n| if n % 7 == 3 { Answer::Twice } else { Answer::Sent }),
        ("lost", |n| if n % 5 == 3 { Answer::Lost } else { Answer::Sent }),
        ("out of order", |n| if n % 6 == 3 { Answer::Late } else { Answer::Sent }),
        ("flood", |n| if n % 500 == 499 { Answer::Flooded } else { Answer::Sent }),
    ];
    // In parallel: they follow the wall clock.
    std::thread::scope(|scope| {
        for (name, script) in scripts {
            scope.spawn(move || {
                let (outcome, watch) = fly(5.0, "", script);
                assert_eq!(outcome.flight.end, FlightEnd::Done, "{name}: {:?}", outcome.flight.end);
                assert!(watch.farthest_m < 1.0, "{name}: {} m", watch.farthest_m);
            });
        }
    });
}

#[test]
fn scenario_a_peer_that_goes_away_in_flight_is_named() {
    let (outcome, _) = fly(30.0, "", |n| if n < 9000 { Answer::Sent } else { Answer::Gone });
    let said = sentence(&outcome);
    assert!(
        said.starts_with("Betaflight at 127.0.0.1:") && said.contains("sent no motors after state "),
        "{said}"
    );
}

/// Not lockstep: a peer that restarts is not a new one. Before it arms nothing is lost; in flight its motors stop, as
/// those of the real one do until its arm switch has been off, and the flight runs to its end on the ground.
#[test]
fn scenario_a_restart_before_arming_is_harmless_and_in_flight_a_fall() {
    std::thread::scope(|scope| {
        scope.spawn(|| {
            // State 3000 is that of 6 s: the boot grace.
            let (outcome, watch) = fly(4.0, "", |n| if n == 3000 { Answer::Restart } else { Answer::Sent });
            assert_eq!(outcome.flight.end, FlightEnd::Done, "{:?}", outcome.flight.end);
            assert!(watch.farthest_m < 1.0, "{} m", watch.farthest_m);
        });
        scope.spawn(|| {
            // State 9000 is that of 18 s, some 5 s after the hand-over.
            let (outcome, watch) = fly(12.0, "", |n| if n == 9000 { Answer::Restart } else { Answer::Sent });
            assert!(outcome.prelude_s < 17.0, "{} s", outcome.prelude_s);
            assert_eq!(outcome.flight.end, FlightEnd::Done, "{:?}", outcome.flight.end);
            assert!(watch.farthest_m > 1.2, "{} m: it did not fall", watch.farthest_m);
        });
    });
}

/// It is not lockstep, and reports this; nor is the autopilot's version known.
#[test]
fn val_the_link_says_that_it_is_not_lockstep() {
    let (port, _states, _sticks) = ports();
    let address = format!("betaflight:{port}").parse().unwrap();
    let link = Betaflight::listen(&address, true, map(), patience()).unwrap();
    let identity = link.identity();
    assert_eq!((identity.lockstep, identity.version), (false, None));
    assert_eq!(identity.peer, format!("Betaflight at 127.0.0.1:{port}"));
}
