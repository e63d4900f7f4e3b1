//! Independent jobs on several threads, with results in the order of the jobs.
//!
//! Each job is a pure function of its input, so the results are bit-identical for every number of threads; only the order in which
//! jobs start differs.

use rayon::iter::{IndexedParallelIterator, IntoParallelRefIterator, ParallelIterator};
use std::num::NonZeroUsize;

/// Number of threads that this machine can run at a time.
pub fn available_threads() -> NonZeroUsize {
    std::thread::available_parallelism().unwrap_or(NonZeroUsize::MIN)
}

/// Runs `work` on every job, with results in the order of the jobs; `done` is called from any thread whenever a job has finished.
pub fn map_in_order<J: Sync, R: Send>(
    threads: NonZeroUsize,
    jobs: &[J],
    work: impl Fn(&J) -> R + Sync,
    done: &(dyn Fn() + Sync),
) -> Vec<R> {
    let each = |job: &J| {
        let result = work(job);
        done();
        result
    };
    let threads = threads.get().min(jobs.len());
    if threads <= 1 {
        return jobs.iter().map(each).collect();
    }
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .expect("the system starts a few threads");
    // Jobs are long: none waits behind another while a thread is idle.
    pool.install(|| jobs.par_iter().with_max_len(1).map(each).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicUsize, Ordering};

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
