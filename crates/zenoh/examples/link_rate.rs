//! Step rate of the bare link: plant, controller and FDI engine that compute nothing, in three processes.
//!
//! ```text
//! cargo run --release -p rotortwin-zenoh --example link_rate -- iceoryx2 [steps [window [batch]]]
//! taskset -c 0 target/release/examples/link_rate iceoryx2        # all three on one core: the fastest
//! ```
//! Links: `in-process`, `iceoryx2`, `zenoh`, and `futex`: two processes without messages and without an FDI engine that hand each other the turn in
//! shared memory, faster than which no link between processes that sleep while they wait can be. A window of 0 waits for each report.
//! Prints one line.

use rotortwin_links::endpoint::{Endpoint, EndpointLink, PeerOptions, serve_controller, serve_fdi};
use rotortwin_links::iox2::{Iox2Endpoint, Iox2Options};
use rotortwin_links::zenoh::ZenohOptions;
use rotortwin_proto::{ControllerSetup, FdiSetup, Role, Rotor};
use rotortwin_wire::frames::{CommandFrame, FdiReport, SensorFrame, Stamp};
use rotortwin_wire::link::in_process::InProcessLink;
use rotortwin_wire::link::{ControllerPeer, FdiPeer, LinkTiming, PlantLink, RunSetup};
use rotortwin_zenoh::endpoint::ZenohEndpoint;
use std::error::Error;
use std::process::{Child, Command};
use std::time::Instant;

struct Echo;

impl ControllerPeer for Echo {
    fn setup(&mut self, _: &ControllerSetup) -> Result<(), String> {
        Ok(())
    }
    fn step(&mut self, sensors: &SensorFrame) -> CommandFrame {
        CommandFrame {
            stamp: sensors.stamp,
            ..CommandFrame::default()
        }
    }
}

impl FdiPeer for Echo {
    fn setup(&mut self, _: &FdiSetup) -> Result<(), String> {
        Ok(())
    }
    fn step(&mut self, sensors: &SensorFrame, _: &CommandFrame) -> FdiReport {
        FdiReport {
            stamp: sensors.stamp,
            ..FdiReport::default()
        }
    }
}

fn fly(link: &mut impl PlantLink, run_id: u64, steps: u64) -> Result<f64, Box<dyn Error>> {
    let rotors = vec![Rotor::default(); 6];
    link.open(&RunSetup {
        run_id,
        scenario: "link_rate".to_owned(),
        model_hash: String::new(),
        step_count: steps,
        controller: ControllerSetup {
            rotors: rotors.clone(),
            ..ControllerSetup::default()
        },
        fdi: FdiSetup {
            rotors,
            ..FdiSetup::default()
        },
    })?;
    let begin = Instant::now();
    let mut reports = 0;
    for step in 0..steps {
        let stamp = Stamp {
            run_id,
            step,
            sim_time_ns: step * 2_500_000,
        };
        let command = link.exchange(&SensorFrame {
            stamp,
            ..SensorFrame::default()
        })?;
        assert_eq!(command.stamp, stamp);
        while let Some(report) = link.next_report(false)? {
            assert_eq!(report.stamp.step, reports);
            reports += 1;
        }
    }
    while let Some(report) = link.next_report(true)? {
        assert_eq!(report.stamp.step, reports);
        reports += 1;
    }
    assert_eq!(reports, steps);
    let elapsed = begin.elapsed().as_secs_f64();
    link.finish(steps, None);
    Ok(elapsed)
}

fn main() -> Result<(), Box<dyn Error>> {
    let args: Vec<String> = std::env::args().collect();
    let get = |index: usize, default: &str| args.get(index).cloned().unwrap_or_else(|| default.to_owned());
    let transport = get(1, "iceoryx2");
    let steps: u64 = get(2, if transport == "zenoh" { "10000" } else { "200000" }).parse()?;
    let timing = LinkTiming {
        fdi_window: get(3, "128").parse()?,
        fdi_batch: get(4, "32").parse()?,
        ..LinkTiming::default()
    };
    let role = get(5, "plant");
    let run_id: u64 = get(6, &(u64::from(std::process::id()) << 20 | 1).to_string()).parse()?;
    let place = get(7, "tcp/127.0.0.1:17447");
    if transport == "futex" {
        return if role == "plant" {
            hand_over(steps)
        } else {
            hand_back(&place)
        };
    }
    let spin: u32 = std::env::var("SPIN").map_or(Ok(0), |spin| spin.parse())?;

    if role != "plant" {
        let role = if role == "controller" {
            Role::Controller
        } else {
            Role::Fdi
        };
        return match transport.as_str() {
            "iceoryx2" => serve(
                Iox2Endpoint::new(
                    role,
                    run_id,
                    Iox2Options {
                        spin,
                        ..Iox2Options::default()
                    },
                )?,
                role,
                &timing,
            ),
            _ => serve(
                ZenohEndpoint::new(role, run_id, ZenohOptions::connect(place))?,
                role,
                &timing,
            ),
        };
    }

    if transport == "in-process" {
        let elapsed = fly(&mut InProcessLink::new(Echo, Echo), run_id, steps)?;
        println!("in-process: {:.0} steps/s", steps as f64 / elapsed);
        return Ok(());
    }
    let children = ["controller", "fdi"]
        .map(|role| {
            Command::new(std::env::current_exe()?)
                .args([
                    &transport,
                    &steps.to_string(),
                    &get(3, "128"),
                    &get(4, "32"),
                    role,
                    &run_id.to_string(),
                    &place,
                ])
                .spawn()
        })
        .into_iter()
        .collect::<Result<Vec<_>, _>>()?;
    let elapsed = match transport.as_str() {
        "iceoryx2" => {
            let endpoint = Iox2Endpoint::new(
                Role::Plant,
                run_id,
                Iox2Options {
                    spin,
                    ..Iox2Options::default()
                },
            )?;
            fly(&mut EndpointLink::new(endpoint, timing), run_id, steps)?
        }
        _ => {
            let endpoint = ZenohEndpoint::new(Role::Plant, run_id, ZenohOptions::listen(place))?;
            fly(&mut EndpointLink::new(endpoint, timing), run_id, steps)?
        }
    };
    for mut child in children {
        assert!(child.wait()?.success());
    }
    println!(
        "{transport}, window {}, batch {}: {:.0} steps/s, {:.2} us a step",
        timing.fdi_window,
        timing.fdi_batch,
        steps as f64 / elapsed,
        elapsed / steps as f64 * 1e6
    );
    Ok(())
}

/// Whose turn it is.
const PLANT: u32 = 0;
const CONTROLLER: u32 = 1;
const NOBODY: u32 = 2;

/// The plant's side of `futex`: gives the turn to another process and waits until it is back, `steps` times.
fn hand_over(steps: u64) -> Result<(), Box<dyn Error>> {
    let file = tempfile::tempfile_in("/dev/shm")?;
    let turn = turn::Turn::of(&file)?;
    // The file has no name; the other process opens it as this one's.
    let place = format!(
        "/proc/{}/fd/{}",
        std::process::id(),
        std::os::fd::AsRawFd::as_raw_fd(&file)
    );
    let mut controller: Child = Command::new(std::env::current_exe()?)
        .args(["futex", &steps.to_string(), "0", "0", "controller", "0", &place])
        .spawn()?;
    // Once before the clock runs: the other process has to start.
    turn.give(CONTROLLER)?;
    turn.until(PLANT, "controller")?;
    let begin = Instant::now();
    for _ in 0..steps {
        turn.give(CONTROLLER)?;
        turn.until(PLANT, "controller")?;
    }
    let elapsed = begin.elapsed().as_secs_f64();
    turn.give(NOBODY)?;
    assert!(controller.wait()?.success());
    println!(
        "futex, no messages, no FDI engine: {:.0} steps/s, {:.2} us a step",
        steps as f64 / elapsed,
        elapsed / steps as f64 * 1e6
    );
    Ok(())
}

/// The controller's side of `futex`.
fn hand_back(place: &str) -> Result<(), Box<dyn Error>> {
    let file = std::fs::File::options().read(true).write(true).open(place)?;
    let turn = turn::Turn::of(&file)?;
    while turn.until(CONTROLLER, "plant")? {
        turn.give(PLANT)?;
    }
    Ok(())
}

/// A word in memory that processes share, and sleeping until it changes.
#[expect(
    unsafe_code,
    reason = "shared memory and futexes are calls to the kernel with pointers"
)]
mod turn {
    use std::fs::File;
    use std::io::{Error, ErrorKind, Result};
    use std::os::fd::AsRawFd as _;
    use std::sync::atomic::{AtomicU32, Ordering};

    const PAGE: usize = 4096;
    /// Longest wait for the other process, s.
    const LIMIT_S: libc::time_t = 10;

    pub(super) struct Turn(&'static AtomicU32);

    impl Turn {
        /// The first word of a file, 0 if it is new.
        pub(super) fn of(file: &File) -> Result<Self> {
            file.set_len(PAGE as u64)?;
            let rights = libc::PROT_READ | libc::PROT_WRITE;
            // SAFETY: a new mapping of a file of this length, which stays until the process ends.
            let place = unsafe {
                libc::mmap(
                    std::ptr::null_mut(),
                    PAGE,
                    rights,
                    libc::MAP_SHARED,
                    file.as_raw_fd(),
                    0,
                )
            };
            if place == libc::MAP_FAILED {
                return Err(Error::last_os_error());
            }
            // SAFETY: the page is aligned, initialised and mapped for good; all processes access the word as an atomic.
            Ok(Self(unsafe { AtomicU32::from_ptr(place.cast()) }))
        }

        /// Hands over, and wakes who waits.
        pub(super) fn give(&self, whose: u32) -> Result<()> {
            self.0.store(whose, Ordering::Release);
            // SAFETY: the kernel only uses the address, which is that of a mapped word.
            let woken = unsafe { libc::syscall(libc::SYS_futex, self.0.as_ptr(), libc::FUTEX_WAKE, 1) };
            if woken < 0 {
                return Err(Error::last_os_error());
            }
            Ok(())
        }

        /// Sleeps until it is `mine`; false once it is nobody's.
        pub(super) fn until(&self, mine: u32, other: &str) -> Result<bool> {
            loop {
                let now = self.0.load(Ordering::Acquire);
                if now == mine || now == super::NOBODY {
                    return Ok(now == mine);
                }
                let limit = libc::timespec {
                    tv_sec: LIMIT_S,
                    tv_nsec: 0,
                };
                // SAFETY: the word is mapped, the time lives until the call returns; the kernel only reads both.
                let slept = unsafe {
                    libc::syscall(
                        libc::SYS_futex,
                        self.0.as_ptr(),
                        libc::FUTEX_WAIT,
                        now,
                        &raw const limit,
                    )
                };
                if slept >= 0 {
                    continue;
                }
                let error = Error::last_os_error();
                match error.raw_os_error() {
                    // It changed before the kernel looked, or a signal came.
                    Some(libc::EAGAIN | libc::EINTR) => {}
                    Some(libc::ETIMEDOUT) => {
                        let sentence = format!("the {other} did not hand the turn back within {LIMIT_S} s");
                        return Err(Error::new(ErrorKind::TimedOut, sentence));
                    }
                    _ => return Err(error),
                }
            }
        }
    }
}

fn serve(mut endpoint: impl Endpoint, role: Role, timing: &LinkTiming) -> Result<(), Box<dyn Error>> {
    let options = PeerOptions::new("link_rate", timing);
    if role == Role::Controller {
        serve_controller(&mut endpoint, &mut Echo, &options)?;
    } else {
        serve_fdi(&mut endpoint, &mut Echo, &options)?;
    }
    Ok(())
}
