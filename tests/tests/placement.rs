//! On which processors the processes of a flight run.

use rotortwin_tests::hosts::Hosts;
use rotortwin_tests::process::wait_until;
use rotortwin_tests::program::{Call, Ended, Link, PATIENCE, Run};
use rotortwin_tests::scratch::{Scratch, announced_flight};
use std::ffi::OsString;

const MEMBERS: [&str; 3] = ["sim", "controller", "fdi"];

/// Processors that the threads of a process may run on, as the kernel writes them; none while they differ.
fn mask(pid: u32) -> Option<String> {
    let tasks = std::fs::read_dir(format!("/proc/{pid}/task")).ok()?;
    let mut masks: Vec<String> = tasks
        .flatten()
        .filter_map(|task| std::fs::read_to_string(task.path().join("status")).ok())
        .filter_map(|status| {
            let line = status.lines().find_map(|line| line.strip_prefix("Cpus_allowed_list:"));
            line.map(|list| list.trim().to_owned())
        })
        .collect();
    masks.dedup();
    (masks.len() == 1).then(|| masks.remove(0))
}

fn own_mask() -> String {
    mask(std::process::id()).expect("this process runs somewhere")
}

/// A flight long enough for a test to end it.
struct Flight {
    run: Run,
    _scratch: Scratch,
}

impl Flight {
    fn start(behind: &[OsString], args: &[&str]) -> Self {
        let scratch = Scratch::new();
        let scenario = scratch.path("announced.toml");
        std::fs::write(&scenario, announced_flight(600)).expect("the scenario is written");
        let call = Call::fly(&scratch, Link::Iceoryx2, &scenario, "out").with(args.iter().copied());
        let mut run = call.behind(behind.iter().cloned()).start();
        run.line(|line| line.contains("truth"));
        Self { run, _scratch: scratch }
    }

    /// Allowed processors of plant, controller and FDI engine; a busy machine may be moving them now.
    fn mask(&mut self) -> String {
        let pids = MEMBERS.map(|name| self.run.member(name).pid);
        let mut found = None;
        wait_until(PATIENCE, || {
            let masks = pids.map(mask);
            found.clone_from(&masks[0]);
            found.is_some() && masks.iter().all(|mask| *mask == masks[0])
        })
        .expect("the three run on the same processors");
        found.expect("they do")
    }

    fn cancel(self) -> Ended {
        self.run.supervisor().signal(rustix::process::Signal::INT);
        self.run.end(PATIENCE)
    }
}

#[test]
fn scenario_a_flight_in_lockstep_keeps_to_one_processor_and_says_so() {
    let mut flight = Flight::start(&[], &[]);
    let cpu = flight.mask();
    assert!(cpu.parse::<usize>().is_ok(), "one processor: {cpu}");
    let supervisor = mask(flight.run.supervisor().pid);
    assert_eq!(supervisor, Some(own_mask()), "the supervisor stays free");
    let ended = flight.cancel();
    let said = ended.stdout.lines().find(|line| line.starts_with("Placement"));
    let said = said.unwrap_or_else(|| panic!("{}", ended.stdout));
    assert!(said.contains("all processes on CPU "), "{said}");
}

#[test]
fn scenario_flights_at_the_same_time_spread_over_the_processors() {
    if std::thread::available_parallelism().is_ok_and(|count| count.get() < 2) {
        return rotortwin_tests::skip("one processor: flights cannot spread");
    }
    // In a namespace where no other flight of this machine holds a place.
    let Some(hosts) = Hosts::new(1) else { return };
    let mut flights = [(); 2].map(|()| Flight::start(&hosts.on(1), &[]));
    let [first, second] = flights.each_mut().map(Flight::mask);
    assert_ne!(first, second);
}

#[test]
fn scenario_an_affinity_mask_and_the_users_word_are_respected() {
    let own = own_mask();
    let last = own.split(['-', ',']).next_back().expect("there is a processor");
    let taskset = ["taskset", "-c", last].map(OsString::from);
    for (behind, args) in [(&taskset[..], &[][..]), (&[], &["--cpu", last])] {
        assert_eq!(Flight::start(behind, args).mask(), last);
    }
}

#[test]
fn scenario_at_the_pace_of_the_wall_clock_the_kernel_decides() {
    let mut flight = Flight::start(&[], &["--pace", "real-time"]);
    assert_eq!(flight.mask(), own_mask());
    let ended = flight.cancel();
    let said = "Placement    left to the kernel: real-time pace";
    assert!(ended.stdout.contains(said), "{}", ended.stdout);
}
