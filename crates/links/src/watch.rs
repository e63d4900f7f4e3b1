//! Is the process on the other side alive? Answered by the kernel where possible.
//!
//! A process id is meaningful only inside one PID namespace of one running kernel. Peers therefore exchange the
//! [`process_space`] that their id belongs to, and watch each other only if it is their own; between hosts and containers a
//! death is noticed through the transport, or as silence.

use rustix::event::{PollFd, PollFlags, poll};
use rustix::fd::OwnedFd;
use rustix::process::{Pid, PidfdFlags, pidfd_open};

/// A handle that keeps referring to the same process even if its id is reused.
#[derive(Debug)]
pub(super) struct ProcessWatch {
    state: State,
}

#[derive(Debug)]
enum State {
    /// Readable once the process has ended.
    Watched(OwnedFd),
    /// It had already ended when first checked.
    Ended,
}

impl ProcessWatch {
    /// Watches a process; `None` if it is this process, or in another process space, or the kernel cannot provide a handle.
    pub(super) fn open(pid: u32, space: u64) -> Option<Self> {
        if space == 0 || space != process_space() || pid == std::process::id() {
            return None;
        }
        let pid = Pid::from_raw(i32::try_from(pid).ok()?)?;
        let state = match pidfd_open(pid, PidfdFlags::empty()) {
            Ok(fd) => State::Watched(fd),
            Err(rustix::io::Errno::SRCH) => State::Ended,
            Err(_) => return None,
        };
        Some(Self { state })
    }

    /// True if the process has ended (even if it has not been reaped).
    pub(super) fn has_ended(&self) -> bool {
        match &self.state {
            State::Ended => true,
            State::Watched(fd) => {
                let mut fds = [PollFd::new(fd, PollFlags::IN)];
                let now = rustix::event::Timespec { tv_sec: 0, tv_nsec: 0 };
                matches!(poll(&mut fds, Some(&now)), Ok(1..))
            }
        }
    }
}

/// Identity of this running kernel and PID namespace, the same in all processes that can see each other's ids; 0 if unknown.
pub(super) fn process_space() -> u64 {
    let boot = std::fs::read("/proc/sys/kernel/random/boot_id");
    let namespace = std::fs::read_link("/proc/self/ns/pid");
    match (boot, namespace) {
        (Ok(boot), Ok(namespace)) => fnv1a(&[boot.as_slice(), namespace.as_os_str().as_encoded_bytes()].concat()),
        _ => 0,
    }
}

/// Name of this host, for messages.
pub fn host_name() -> String {
    std::fs::read_to_string("/proc/sys/kernel/hostname")
        .map_or_else(|_| "unknown host".to_owned(), |name| name.trim().to_owned())
}

/// FNV-1a, 64 bit: the same in every build, unlike the hash of the standard library.
fn fnv1a(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |hash, &byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_fnv1a_published_vectors() {
        // From the FNV authors' test suite.
        assert_eq!(fnv1a(b""), 0xcbf2_9ce4_8422_2325);
        assert_eq!(fnv1a(b"foobar"), 0x8594_4171_f739_67e8);
    }

    #[test]
    fn val_the_end_of_a_child_is_seen_before_it_is_reaped() {
        let mut child = std::process::Command::new("sleep")
            .arg("60")
            .spawn()
            .expect("sleep starts");
        let watch = ProcessWatch::open(child.id(), process_space()).expect("a child can be watched");
        assert!(!watch.has_ended());
        child.kill().expect("a child can be killed");
        let begin = std::time::Instant::now();
        while !watch.has_ended() {
            assert!(
                begin.elapsed() < std::time::Duration::from_secs(5),
                "its end was not seen"
            );
            std::thread::sleep(std::time::Duration::from_millis(1));
        }
        child.wait().expect("a child can be waited for");
        assert!(ProcessWatch::open(child.id(), process_space()).is_none_or(|watch| watch.has_ended()));
    }

    #[test]
    fn val_other_process_spaces_are_not_watched() {
        assert!(ProcessWatch::open(1, process_space() ^ 1).is_none());
        assert!(ProcessWatch::open(1, 0).is_none());
        assert!(ProcessWatch::open(std::process::id(), process_space()).is_none());
    }
}
