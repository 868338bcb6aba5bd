//! Where parallel work runs, and how it is told to stop.

use crate::Error;
use rayon::prelude::{IndexedParallelIterator, ParallelIterator, ParallelSliceMut};
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// Time between two questions to the caller while the work goes on elsewhere.
const PATIENCE: Duration = Duration::from_millis(20);

/// Rows between two questions to the caller, and fewest rows of one task.
const ROWS: usize = 1 << 15;
const TASK: usize = 1 << 7;

/// Pools that have been started, each with its process, since a process that forks takes no
/// threads along, and the number of threads asked for. Starting one takes longer than many a call.
static POOLS: Mutex<Vec<(u32, usize, Arc<ThreadPool>)>> = Mutex::new(Vec::new());

/// The threads of one call, and the caller's wish to go on.
///
/// Work is cut into chunks whose size does not depend on the number of threads; between two
/// chunks the calling thread asks `go_on`.
pub struct Workers<'a> {
    pool: Arc<ThreadPool>,
    go_on: &'a (dyn Fn() -> bool + 'a),
}

impl<'a> Workers<'a> {
    /// A pool of `n_threads`, or of as many as the machine has, that no other call uses meanwhile.
    ///
    /// # Errors
    /// [`Error::Threads`] when the threads cannot be started.
    pub fn new(
        n_threads: Option<usize>,
        go_on: &'a (dyn Fn() -> bool + 'a),
    ) -> Result<Self, Error> {
        let (process, n_threads) = (std::process::id(), n_threads.unwrap_or(0));
        let mut pools = POOLS.lock().unwrap_or_else(PoisonError::into_inner);
        let idle = pools.iter().find(|(of_process, of_threads, pool)| {
            (*of_process, *of_threads) == (process, n_threads) && Arc::strong_count(pool) == 1
        });
        if let Some((_, _, pool)) = idle {
            return Ok(Self { pool: pool.clone(), go_on });
        }
        let pool = ThreadPoolBuilder::new()
            .num_threads(n_threads)
            .build()
            .map_err(|reason| Error::Threads { n_threads, reason: reason.to_string() })?;
        let pool = Arc::new(pool);
        pools.push((process, n_threads, pool.clone()));
        Ok(Self { pool, go_on })
    }

    /// Runs `work` on the threads of this call.
    pub fn install<R: Send>(&self, work: impl FnOnce() -> R + Send) -> R {
        self.pool.install(work)
    }

    /// Runs `work` on the threads of this call while the calling thread asks `go_on`, for work
    /// that has no even chunks: it looks at [`Stop`] instead.
    ///
    /// # Errors
    /// Those of the work.
    pub fn watch<R: Send>(
        &self,
        work: impl FnOnce(&Stop) -> Result<R, Error> + Send,
    ) -> Result<R, Error> {
        let stop = Stop::default();
        let mut result = Err(Error::Stopped);
        let (running, finished) = channel::<()>();
        let (stop, result_of_work) = (&stop, &mut result);
        let work = move || {
            let _running = running;
            *result_of_work = work(stop);
        };
        let wait = || {
            while finished.recv_timeout(PATIENCE) == Err(RecvTimeoutError::Timeout) {
                if !(self.go_on)() {
                    stop.0.store(true, Ordering::Relaxed);
                    break;
                }
            }
        };
        self.pool.in_place_scope(|scope| {
            scope.spawn(|_| work());
            wait();
        });
        result
    }

    /// Fills the rows of a table, each `width` wide; `scratch` makes what a thread reuses.
    ///
    /// # Errors
    /// [`Error::Stopped`] when the caller does not want to go on.
    pub fn fill<T: Send, S>(
        &self,
        table: &mut [T],
        width: usize,
        scratch: impl Fn() -> S + Sync + Send,
        work: impl Fn(&mut S, usize, &mut [T]) + Sync + Send,
    ) -> Result<(), Error> {
        for (start, part) in (0..).step_by(ROWS).zip(table.chunks_mut(ROWS * width)) {
            self.check()?;
            self.install(|| {
                part.par_chunks_mut(width)
                    .with_min_len(TASK)
                    .enumerate()
                    .for_each_init(&scratch, |scratch, (i, row)| work(scratch, start + i, row));
            });
        }
        Ok(())
    }

    /// # Errors
    /// [`Error::Stopped`] when the caller does not want to go on.
    pub fn check(&self) -> Result<(), Error> {
        if (self.go_on)() { Ok(()) } else { Err(Error::Stopped) }
    }
}

/// Tells work on other threads that the caller does not want to go on.
#[derive(Default)]
pub struct Stop(AtomicBool);

impl Stop {
    /// # Errors
    /// [`Error::Stopped`] when the caller does not want to go on.
    pub fn check(&self) -> Result<(), Error> {
        if self.0.load(Ordering::Relaxed) { Err(Error::Stopped) } else { Ok(()) }
    }
}
