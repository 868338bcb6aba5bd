//! Where parallel work runs, and how it is told to stop.

use crate::Error;
use rayon::prelude::{IndexedParallelIterator, ParallelIterator, ParallelSliceMut};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::Duration;

/// Time between two questions to the caller while the work goes on elsewhere.
const PATIENCE: Duration = Duration::from_millis(20);

/// Rows between two questions to the caller, and fewest rows of one task.
const ROWS: usize = 1 << 15;
const TASK: usize = 1 << 7;

/// The threads of one call, and the caller's wish to go on.
///
/// Work is cut into chunks whose size does not depend on the number of threads; between two
/// chunks the calling thread asks `go_on`.
pub struct Workers<'a> {
    pool: Option<rayon::ThreadPool>,
    go_on: &'a (dyn Fn() -> bool + 'a),
}

impl<'a> Workers<'a> {
    /// The global pool, or a pool of `n_threads` for this call alone.
    ///
    /// # Errors
    /// [`Error::Threads`] when the threads cannot be started.
    pub fn new(
        n_threads: Option<usize>,
        go_on: &'a (dyn Fn() -> bool + 'a),
    ) -> Result<Self, Error> {
        let pool = n_threads
            .map(|n_threads| {
                rayon::ThreadPoolBuilder::new()
                    .num_threads(n_threads)
                    .build()
                    .map_err(|reason| Error::Threads { n_threads, reason: reason.to_string() })
            })
            .transpose()?;
        Ok(Self { pool, go_on })
    }

    /// Runs `work` on the threads of this call.
    pub fn install<R: Send>(&self, work: impl FnOnce() -> R + Send) -> R {
        match &self.pool {
            Some(pool) => pool.install(work),
            None => work(),
        }
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
        match &self.pool {
            Some(pool) => pool.in_place_scope(|scope| {
                scope.spawn(|_| work());
                wait();
            }),
            None => rayon::in_place_scope(|scope| {
                scope.spawn(|_| work());
                wait();
            }),
        }
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
