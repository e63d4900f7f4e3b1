//! Documents of callers are read away from the threads that answer requests, and only as many at a time as there are processors, four at most.
//!
//! A document of a mebibyte takes up to a second and 200 MB to read, and its refusal as much again: on the threads that answer, a few of them would
//! keep every other request waiting.

use std::num::NonZeroUsize;
use tokio::sync::Semaphore;

/// However many processors there are: each reader may take 200 MB.
const MOST: usize = 4;

/// Turns of those who read a document.
#[derive(Debug)]
pub(crate) struct Readers(Semaphore);

impl Readers {
    /// As many as there are processors, and [`MOST`].
    pub(crate) fn new() -> Self {
        Self::of(
            std::thread::available_parallelism()
                .map_or(1, NonZeroUsize::get)
                .min(MOST),
        )
    }

    fn of(at_once: usize) -> Self {
        Self(Semaphore::new(at_once))
    }

    /// Reads or checks what a caller wrote, when its turn has come. Other requests go on meanwhile, on other threads.
    pub(crate) async fn read<T>(&self, work: impl FnOnce() -> T) -> T {
        // An error would mean that it was closed, which nobody does.
        let _turn = self.0.acquire().await;
        tokio::task::block_in_place(work)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Arc;
    use std::sync::atomic::{AtomicUsize, Ordering};
    use std::time::Duration;

    #[tokio::test(flavor = "multi_thread", worker_threads = 1)]
    async fn val_few_read_at_once_and_others_go_on_meanwhile() {
        const AT_ONCE: usize = 2;
        let readers = Arc::new(Readers::of(AT_ONCE));
        let (reading, most) = (Arc::new(AtomicUsize::new(0)), Arc::new(AtomicUsize::new(0)));
        let (release, wait) = std::sync::mpsc::channel::<()>();
        let wait = Arc::new(std::sync::Mutex::new(wait));
        let tasks: Vec<_> = (0..6)
            .map(|_| {
                let (readers, reading, most, wait) = (readers.clone(), reading.clone(), most.clone(), wait.clone());
                tokio::spawn(async move {
                    let work = || {
                        most.fetch_max(reading.fetch_add(1, Ordering::SeqCst) + 1, Ordering::SeqCst);
                        wait.lock().expect("no panic").recv().expect("released");
                        reading.fetch_sub(1, Ordering::SeqCst);
                    };
                    readers.read(work).await;
                })
            })
            .collect();
        // The only thread that answers is free: this timer fires while they all wait.
        while reading.load(Ordering::SeqCst) < AT_ONCE {
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
        tokio::time::sleep(Duration::from_millis(50)).await;
        for _ in &tasks {
            release.send(()).expect("they wait");
        }
        for task in tasks {
            task.await.expect("no panic");
        }
        assert_eq!(most.load(Ordering::SeqCst), AT_ONCE);
    }
}
