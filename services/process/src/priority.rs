//! Real-time priority and locked memory, for flights at real-time pace.
//!
//! On a busy machine the scheduler shares each processor among all runnable processes: one that has slept until its step is due then waits
//! for others, for tens of milliseconds. Under `SCHED_FIFO` it runs at once, ahead of all ordinary processes; with its memory locked, it
//! has no page faults from disk. Both need privileges that an ordinary user lacks by default (sched(7), mlock(2)).
//!
//! # Limits
//! The kernel reserves 5 % of each second for ordinary processes (`kernel.sched_rt_runtime_us`), so that a machine can be rescued: longer
//! computations are interrupted then. Processors are not isolated; use the kernel's `isolcpus=` or a cpuset for that, with `--cpu`.

use rustix::process::{Resource, getrlimit};

/// Default priority: below the interrupt threads, which have 50 where they are threads.
pub const DEFAULT_PRIORITY: &str = "40";

/// At fast pace there is no deadline, and a flight would monopolise its processors.
pub const NEEDS_PACE: &str = "--priority applies to flights at the pace of the wall clock: expected --pace real-time";

/// Bit of `CAP_IPC_LOCK` in the sets of capabilities (capability(7)).
const CAP_IPC_LOCK: u32 = 14;

/// Missing privilege, with its error message.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PriorityError {
    /// `SCHED_FIFO` was denied.
    #[error(
        "--priority {priority}: this user may not use real-time scheduling ({reason}): expected the capability cap_sys_nice \
         ('setcap cap_sys_nice,cap_ipc_lock+ep {program}') or a limit of at least {priority} ('ulimit -r', rtprio in limits.conf)"
    )]
    Scheduling {
        /// Requested priority.
        priority: u8,
        /// The kernel's message.
        reason: String,
        /// File of this program.
        program: String,
    },
    /// Not all memory can be locked.
    #[error(
        "--priority {priority}: this user may lock {limit} of memory, not all that a flight takes: expected the capability cap_ipc_lock \
         ('setcap cap_sys_nice,cap_ipc_lock+ep {program}') or no limit ('ulimit -l unlimited', memlock in limits.conf)"
    )]
    Memory {
        /// Requested priority.
        priority: u8,
        /// Limit on locked memory.
        limit: String,
        /// File of this program.
        program: String,
    },
}

/// A priority from 1 to 99.
///
/// # Errors
/// States what was expected.
pub fn parse_priority(text: &str) -> Result<u8, String> {
    match text.parse() {
        Ok(priority @ 1..=99) => Ok(priority),
        _ => Err("expected a whole number from 1 to 99".to_owned()),
    }
}

/// Whether [`take`] would be allowed; does not change this thread.
///
/// # Errors
/// The missing privilege.
pub fn probe(priority: u8) -> Result<(), PriorityError> {
    check_memory(priority)?;
    // In a separate thread, which ends with the privileges it was given.
    std::thread::scope(|scope| scope.spawn(|| set_fifo(priority)).join())
        .unwrap_or_else(|_| Err(std::io::Error::other("the thread that asked for it ended")))
        .map_err(|error| refused(priority, &error))
}

/// `SCHED_FIFO` for this thread and everything it starts from now on, and all memory of this process locked, present and future.
///
/// # Errors
/// The missing privilege; nothing was changed then except perhaps the memory.
pub fn take(priority: u8) -> Result<(), PriorityError> {
    check_memory(priority)?;
    lock_memory().map_err(|error| {
        tracing::warn!(%error, "mlockall");
        no_memory(priority)
    })?;
    set_fifo(priority).map_err(|error| refused(priority, &error))
}

/// Work after a flight has no deadline: this thread returns to normal scheduling. No effect without priority.
pub fn give_back() {
    if let Err(error) = set_ordinary() {
        tracing::warn!(%error, "this thread keeps its real-time priority");
    }
}

/// With a finite limit, `mlockall` of the future makes the first allocation beyond it fail in flight.
fn check_memory(priority: u8) -> Result<(), PriorityError> {
    let unlimited = getrlimit(Resource::Memlock).current.is_none();
    let capable =
        std::fs::read_to_string("/proc/self/status").is_ok_and(|status| has_capability(&status, CAP_IPC_LOCK));
    if unlimited || capable {
        return Ok(());
    }
    Err(no_memory(priority))
}

/// From `/proc/self/status`: whether the effective set holds this capability.
fn has_capability(status: &str, bit: u32) -> bool {
    status
        .lines()
        .find_map(|line| line.strip_prefix("CapEff:"))
        .and_then(|set| u64::from_str_radix(set.trim(), 16).ok())
        .is_some_and(|set| set >> bit & 1 == 1)
}

fn no_memory(priority: u8) -> PriorityError {
    let limit = getrlimit(Resource::Memlock).current.map_or_else(
        || "an unlimited amount (the kernel refused nevertheless)".to_owned(),
        |bytes| format!("{} KiB", bytes / 1024),
    );
    PriorityError::Memory {
        priority,
        limit,
        program: program(),
    }
}

fn refused(priority: u8, error: &std::io::Error) -> PriorityError {
    PriorityError::Scheduling {
        priority,
        reason: error.to_string(),
        program: program(),
    }
}

fn program() -> String {
    std::env::current_exe().map_or_else(|_| "rotortwin".to_owned(), |path| path.display().to_string())
}

fn set_fifo(priority: u8) -> std::io::Result<()> {
    set_scheduler(libc::SCHED_FIFO, i32::from(priority))
}

#[expect(
    unsafe_code,
    reason = "libc's call takes no pointer; rustix has it behind a feature that would build half of the tree again"
)]
fn lock_memory() -> std::io::Result<()> {
    // SAFETY: no pointer; locked memory behaves as before.
    match unsafe { libc::mlockall(libc::MCL_CURRENT | libc::MCL_FUTURE) } {
        0 => Ok(()),
        _ => Err(std::io::Error::last_os_error()),
    }
}

#[expect(unsafe_code, reason = "rustix has no call for it; libc's takes no pointer")]
fn set_ordinary() -> std::io::Result<()> {
    // SAFETY: 0 is this thread; nothing is read or written through a pointer.
    if unsafe { libc::sched_getscheduler(0) } != libc::SCHED_FIFO {
        return Ok(());
    }
    set_scheduler(libc::SCHED_OTHER, 0)
}

#[expect(unsafe_code, reason = "rustix has no call for it")]
fn set_scheduler(policy: libc::c_int, priority: libc::c_int) -> std::io::Result<()> {
    let parameters = libc::sched_param {
        sched_priority: priority,
    };
    // SAFETY: 0 is this thread; the pointer is to a value that lives through the call, which only reads it.
    match unsafe { libc::sched_setscheduler(0, policy, &raw const parameters) } {
        0 => Ok(()),
        _ => Err(std::io::Error::last_os_error()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_priorities_are_those_of_the_kernel() {
        assert_eq!(parse_priority("1"), Ok(1));
        assert_eq!(parse_priority("99"), Ok(99));
        for wrong in ["0", "100", "-1", "high", ""] {
            assert!(parse_priority(wrong).is_err(), "{wrong}");
        }
        assert!(parse_priority(DEFAULT_PRIORITY).is_ok());
    }

    /// The sets as shown by proc(5): all of root, none of a user.
    #[test]
    fn val_capabilities_are_read_from_the_effective_set() {
        let status =
            |set: &str| format!("Name:\ta\nCapPrm:\t000001ffffffffff\nCapEff:\t{set}\nCapBnd:\t000001ffffffffff\n");
        assert!(has_capability(&status("000001ffffffffff"), CAP_IPC_LOCK));
        assert!(has_capability(&status("0000000000004000"), CAP_IPC_LOCK));
        assert!(!has_capability(&status("0000000000000000"), CAP_IPC_LOCK));
        assert!(!has_capability(&status("000001ffffffbfff"), CAP_IPC_LOCK));
        assert!(!has_capability("", CAP_IPC_LOCK));
    }

    #[test]
    fn val_what_is_missing_and_how_to_give_it_is_said() {
        let sentence = refused(40, &std::io::Error::from_raw_os_error(libc::EPERM)).to_string();
        for word in [
            "--priority 40",
            "cap_sys_nice",
            "setcap",
            "ulimit -r",
            "Operation not permitted",
        ] {
            assert!(sentence.contains(word), "{word}: {sentence}");
        }
        let sentence = no_memory(40).to_string();
        for word in ["--priority 40", "cap_ipc_lock", "ulimit -l"] {
            assert!(sentence.contains(word), "{word}: {sentence}");
        }
    }
}
