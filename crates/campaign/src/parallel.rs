//! Independent jobs on several threads, with results in the order of the jobs.
//!
//! Each job is a pure function of its input, so the results are the same bits for every number of threads; only the order in which
//! jobs are started differs.

use std::num::NonZeroUsize;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Threads that this machine can run at a time.
pub fn available_threads() -> NonZeroUsize {
    std::thread::available_parallelism().unwrap_or(NonZeroUsize::MIN)
}

/// `work` of every job, in the order of the jobs. Jobs are started in that order: put long ones first.
///
/// `done` is told from any thread whenever a job has ended.
pub fn map_in_order<J: Sync, R: Send>(
    threads: NonZeroUsize,
    jobs: &[J],
    work: impl Fn(&J) -> R + Sync,
    done: &(dyn Fn() + Sync),
) -> Vec<R> {
    let next = AtomicUsize::new(0);
    let results: Vec<Mutex<Option<R>>> = jobs.iter().map(|_| Mutex::new(None)).collect();
    let worker = || {
        loop {
            let index = next.fetch_add(1, Ordering::Relaxed);
            let Some(job) = jobs.get(index) else { return };
            let result = work(job);
            *results[index].lock().expect("no job panics while it holds the lock") = Some(result);
            done();
        }
    };
    std::thread::scope(|scope| {
        for _ in 1..threads.get().min(jobs.len()) {
            scope.spawn(worker);
        }
        worker();
    });
    results
        .into_iter()
        .map(|slot| {
            slot.into_inner()
                .expect("no job panics while it holds the lock")
                .expect("every job has been done, or its panic has ended the scope")
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_results_are_in_the_order_of_the_jobs() {
        let jobs: Vec<u64> = (0..100).collect();
        // Early jobs take longest, so that later ones overtake them.
        let slow_square = |job: &u64| {
            std::thread::sleep(std::time::Duration::from_micros(100 - job));
            job * job
        };
        let ended = AtomicUsize::new(0);
        for threads in [1, 2, 7, 200] {
            let threads = NonZeroUsize::new(threads).expect("above 0");
            let results = map_in_order(threads, &jobs, slow_square, &|| {
                ended.fetch_add(1, Ordering::Relaxed);
            });
            assert_eq!(results, jobs.iter().map(|job| job * job).collect::<Vec<_>>());
        }
        assert_eq!(ended.into_inner(), 400);
    }
}
