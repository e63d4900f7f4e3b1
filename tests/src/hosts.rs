//! Several hosts on one machine: network namespaces, joined by virtual cables and a switch.
//!
//! ```text
//!  host 1 (10.77.0.1) ──cable──┐
//!  host 2 (10.77.0.2) ──cable──┤ switch (a separate namespace)
//!  host 3 (10.77.0.3) ──cable──┘   with delay and loss: netem, or a program where the kernel has none
//! ```
//! Needs root and iproute2.

use crate::scratch::repository;
use rustix::thread::{LinkNameSpaceType, move_into_link_name_space};
use std::ffi::OsString;
use std::os::fd::AsFd as _;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};

/// Hosts and their switch; removed on drop.
#[derive(Debug)]
pub struct Hosts {
    prefix: String,
    count: usize,
    /// Proxy in the middle of the first host's cable.
    wire: Option<Child>,
}

fn try_ip(args: &str) -> Result<(), String> {
    let made = Command::new("ip")
        .args(args.split_ascii_whitespace())
        .output()
        .map_err(|error| format!("ip: {error}"))?;
    if made.status.success() {
        Ok(())
    } else {
        Err(format!("ip {args}: {}", String::from_utf8_lossy(&made.stderr).trim()))
    }
}

fn ip(args: &str) {
    try_ip(args).unwrap_or_else(|error| panic!("{error}"));
}

impl Hosts {
    /// Creates this many hosts; `None` if that is not possible.
    pub fn new(count: usize) -> Option<Self> {
        static NEXT: AtomicU32 = AtomicU32::new(0);
        let number = NEXT.fetch_add(1, Ordering::Relaxed);
        let hosts = Self {
            prefix: format!("rt{:x}-{number}", std::process::id()),
            count,
            wire: None,
        };
        // The first command that needs the privileges; any later failure is an error.
        let switch = hosts.switch();
        let possible =
            try_ip(&format!("netns add {switch}")).and_then(|()| try_ip(&format!("-n {switch} link set lo up")));
        if let Err(error) = possible {
            crate::skip(&format!(
                "no network name spaces here ({error}): several hosts are not tried"
            ));
            return None;
        }
        ip(&format!("-n {switch} link add hub type bridge"));
        ip(&format!("-n {switch} link set hub up"));
        for host in 1..=count {
            let name = hosts.name(host);
            ip(&format!("netns add {name}"));
            ip(&format!("-n {name} link set lo up"));
            ip(&format!(
                "-n {name} link add eth0 type veth peer name port{host} netns {switch}"
            ));
            ip(&format!("-n {name} addr add {}/24 dev eth0", Self::address(host)));
            ip(&format!("-n {name} link set eth0 up"));
            ip(&format!("-n {switch} link set port{host} master hub up"));
        }
        Some(hosts)
    }

    fn switch(&self) -> String {
        format!("{}-hub", self.prefix)
    }

    fn name(&self, host: usize) -> String {
        format!("{}-{host}", self.prefix)
    }

    /// Address of a host, from 1.
    pub fn address(host: usize) -> String {
        format!("10.77.0.{host}")
    }

    /// Command prefix for running on a host.
    pub fn on(&self, host: usize) -> [OsString; 4] {
        ["ip", "netns", "exec", &self.name(host)].map(OsString::from)
    }

    /// Runs `act` on a host: it connects and starts processes there.
    pub fn visit<T: Send>(&self, host: usize, act: impl FnOnce() -> T + Send) -> T {
        let place = std::fs::File::open(Path::new("/var/run/netns").join(self.name(host))).expect("ip keeps it there");
        std::thread::scope(|scope| {
            let visitor = scope.spawn(move || {
                let kind = LinkNameSpaceType::Network;
                move_into_link_name_space(place.as_fd(), Some(kind)).expect("root may go there");
                act()
            });
            visitor.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
        })
    }

    /// Unplugs the cable of a host.
    pub fn cut(&self, host: usize) {
        ip(&format!("-n {} link set port{host} down", self.switch()));
    }

    /// Plugs it in again.
    pub fn mend(&self, host: usize) {
        ip(&format!("-n {} link set port{host} up", self.switch()));
    }

    /// Gives the first host's cable delay and loss, each way.
    pub fn disturb(&mut self, delay_ms: u32, loss_percent: u32) {
        let switch = self.switch();
        let netem = |place: &str| {
            Command::new("ip")
                .args([
                    "netns", "exec", &switch, "tc", "qdisc", "add", "dev", place, "root", "netem",
                ])
                .args(["delay", &format!("{delay_ms}ms"), "loss", &format!("{loss_percent}%")])
                .output()
                .is_ok_and(|made| made.status.success())
        };
        if netem("port1") {
            let host = self.name(1);
            let made = Command::new("ip")
                .args([
                    "netns", "exec", &host, "tc", "qdisc", "add", "dev", "eth0", "root", "netem",
                ])
                .args(["delay", &format!("{delay_ms}ms"), "loss", &format!("{loss_percent}%")])
                .status();
            assert!(
                made.is_ok_and(|status| status.success()),
                "netem is there for one end only"
            );
            return;
        }
        let script = repository().join("tests/src/lossy_wire.py");
        for host in 1..=self.count {
            let mut words = self.on(host).into_iter();
            let off = Command::new(words.next().expect("the first word is ip"))
                .args(words)
                .arg("python3")
                .arg(&script)
                .arg("eth0")
                .status();
            assert!(
                off.is_ok_and(|status| status.success()),
                "checksums are made in software"
            );
        }
        ip(&format!("-n {switch} link set port1 nomaster"));
        ip(&format!("-n {switch} link add wire0 type veth peer name wire1"));
        ip(&format!("-n {switch} link set wire0 up"));
        ip(&format!("-n {switch} link set wire1 master hub up"));
        let mut wire = Command::new("ip")
            .args(["netns", "exec", &switch, "python3"])
            .arg(&script)
            .args(["port1", "wire0", &delay_ms.to_string(), &loss_percent.to_string(), "1"])
            .stdout(Stdio::piped())
            .spawn()
            .expect("python3 starts");
        let mut word = String::new();
        let stdout = wire.stdout.take().expect("it is piped");
        std::io::BufRead::read_line(&mut std::io::BufReader::new(stdout), &mut word).expect("it prints UTF-8");
        self.wire = Some(wire);
        assert_eq!(word.trim(), "relaying");
    }
}

impl Drop for Hosts {
    fn drop(&mut self) {
        if let Some(wire) = &mut self.wire {
            drop(wire.kill());
            drop(wire.wait());
        }
        for name in (1..=self.count).map(|host| self.name(host)).chain([self.switch()]) {
            drop(try_ip(&format!("netns del {name}")));
        }
    }
}
