//! The memory of the C library's allocator, in use and kept.
//!
//! A server allocates and frees from many threads for weeks. glibc gives threads arenas of their own (eight for each
//! processor), an arena returns memory to the system only from its end, and the first large block that is freed makes
//! large blocks part of arenas: resident memory then consists mostly of freed memory. [`keep_together`] bounds that,
//! and [`heap`] distinguishes it from a leak.

/// Bytes of the heap.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Heap {
    /// Allocated, and not freed.
    pub(crate) used: usize,
    /// Freed, and not returned to the system.
    pub(crate) kept: usize,
}

/// The heap of this process now; `None`: the C library does not say.
#[cfg(target_env = "gnu")]
#[expect(unsafe_code, reason = "rustix has no call for it")]
pub(crate) fn heap() -> Option<Heap> {
    // SAFETY: it takes nothing and returns numbers; glibc locks each arena meanwhile.
    let info = unsafe { libc::mallinfo2() };
    Some(Heap {
        // Large blocks are mapped one by one, and counted apart.
        used: info.uordblks + info.hblkhd,
        kept: info.fordblks,
    })
}

#[cfg(not(target_env = "gnu"))]
pub(crate) fn heap() -> Option<Heap> {
    None
}

/// Options of mallopt(3), with the variable of the environment that counts instead of each.
///
/// * Two arenas: one for each of two threads that allocate at the same time. What takes long is done by other processes.
/// * Blocks of 128 KiB and more are mapped one by one and returned when they are freed; glibc starts so, and by default goes up to 32 MiB.
#[cfg(target_env = "gnu")]
const OPTIONS: [(&str, libc::c_int, libc::c_int); 2] = [
    ("MALLOC_ARENA_MAX", libc::M_ARENA_MAX, 2),
    ("MALLOC_MMAP_THRESHOLD_", libc::M_MMAP_THRESHOLD, 128 << 10),
];

/// Bounds what the allocator keeps. Before any other thread starts.
#[cfg(target_env = "gnu")]
#[expect(unsafe_code, reason = "rustix has no call for it")]
pub fn keep_together() {
    for (variable, option, value) in OPTIONS {
        if std::env::var_os(variable).is_some() {
            continue;
        }
        // SAFETY: numbers for the allocator, no pointer.
        if unsafe { libc::mallopt(option, value) } == 0 {
            tracing::debug!(variable, "the allocator does not take this option");
        }
    }
}

/// Bounds what the allocator keeps: this C library has one heap for all threads anyway.
#[cfg(not(target_env = "gnu"))]
pub fn keep_together() {}

#[cfg(all(test, target_env = "gnu"))]
mod tests {
    use super::*;

    #[test]
    fn val_the_heap_knows_what_is_allocated() {
        let before = heap().expect("glibc says").used;
        let block = vec![1_u8; 50 << 20];
        let with = heap().expect("glibc says").used;
        // Other tests of this process allocate and free meanwhile.
        assert!((49 << 20..60 << 20).contains(&(with - before)), "{before} {with}");
        drop(block);
        assert!(heap().expect("glibc says").used < before + (10 << 20));
    }
}
