//! Where parallel work runs, and how it is told to stop.

use crate::Error;
use crate::error::Room;
use rayon::prelude::{IndexedParallelIterator, ParallelIterator, ParallelSliceMut};
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::hint::black_box;
use std::process;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::Duration;

/// Time between two questions to the caller while the work goes on elsewhere.
const PATIENCE: Duration = Duration::from_millis(20);

/// Rows between two questions to the caller, and fewest rows of one task.
const ROWS: usize = 1 << 15;
const TASK: usize = 1 << 7;

/// Idle threads that are kept for the next call, or as many as there are cores; of more, those that
/// were used longest ago end.
const KEPT: usize = 32;

/// Bytes that a thread takes: its stack, and a little of its own.
const THREAD_BYTES: usize = 3 << 20;

/// Pools that no call uses, the one that was used last at the end: starting one takes longer than
/// many a call.
static IDLE: Mutex<Vec<Arc<Pool>>> = Mutex::new(Vec::new());

/// Threads that have ended when their pool is dropped: the fields are dropped in this order.
struct Pool {
    threads: ThreadPool,
    _handles: Handles,
    /// A process that forks takes no threads along.
    process: u32,
}

impl Pool {
    fn start(n_threads: usize) -> Result<Self, Error> {
        black_box(Vec::<u8>::with_room(n_threads.saturating_mul(THREAD_BYTES))?);
        let mut handles = Handles(Vec::with_capacity(n_threads));
        let threads = ThreadPoolBuilder::new()
            .num_threads(n_threads)
            .spawn_handler(|thread| {
                handles.0.push(thread::Builder::new().spawn(|| thread.run())?);
                Ok(())
            })
            .build()
            .map_err(|reason| Error::Threads { n_threads, reason: reason.to_string() })?;
        // The system ends the process when a thread that begins finds no memory for what is its own:
        // all shall have begun while there is some.
        threads.broadcast(|_| ());
        Ok(Self { threads, _handles: handles, process: process::id() })
    }
}

struct Handles(Vec<JoinHandle<()>>);

impl Drop for Handles {
    fn drop(&mut self) {
        for handle in self.0.drain(..) {
            // A panic of a task has already been told to the call that gave it.
            let _ = handle.join();
        }
    }
}

/// The threads of one call, and the caller's wish to go on.
///
/// Work is cut into chunks whose size does not depend on the number of threads; between two
/// chunks the calling thread asks `go_on`.
pub struct Workers<'a> {
    pool: Arc<Pool>,
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
        let n_threads = n_threads.filter(|&n| n > 0).unwrap_or_else(n_cores);
        let process = process::id();
        let idle = {
            let mut idle = IDLE.lock().unwrap_or_else(PoisonError::into_inner);
            let found = idle.iter().rposition(|pool| {
                pool.process == process && pool.threads.current_num_threads() == n_threads
            });
            found.map(|place| idle.remove(place))
        };
        let pool = match idle {
            Some(pool) => pool,
            None => Arc::new(Pool::start(n_threads)?),
        };
        Ok(Self { pool, go_on })
    }

    /// Whether there is memory for `n_bytes`, which the call takes in parts from now on.
    ///
    /// # Errors
    /// [`Error::Memory`] when there is not.
    pub fn room(&self, n_bytes: usize) -> Result<(), Error> {
        // Libraries that were loaded since the threads last worked make the data of each thread
        // grow when it next looks at them; the system ends the process when there is no memory then.
        self.pool.threads.broadcast(|_| ());
        black_box(Vec::<u8>::with_room(n_bytes)?);
        Ok(())
    }

    /// Runs `work` on the threads of this call.
    pub fn install<R: Send>(&self, work: impl FnOnce() -> R + Send) -> R {
        self.pool.threads.install(work)
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
        self.pool.threads.in_place_scope(|scope| {
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

impl Drop for Workers<'_> {
    fn drop(&mut self) {
        let mut idle = IDLE.lock().unwrap_or_else(PoisonError::into_inner);
        idle.push(self.pool.clone());
        let mut n_idle = 0;
        let mut ended = Vec::new();
        for place in (0..idle.len()).rev() {
            if idle[place].process == process::id() {
                let n_threads = idle[place].threads.current_num_threads();
                if n_idle + n_threads > n_cores().max(KEPT) {
                    ended.push(idle.remove(place));
                } else {
                    n_idle += n_threads;
                }
            }
        }
        // Ending threads takes a while, during which others may start calls.
        drop(idle);
        drop(ended);
    }
}

fn n_cores() -> usize {
    thread::available_parallelism().map_or(1, usize::from)
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn idle_threads_end_when_there_are_many() -> Result<(), Error> {
        for n_threads in [40, 3, 40, 60] {
            Workers::new(Some(n_threads), &|| true)?.check()?;
        }
        let idle = IDLE.lock().unwrap_or_else(PoisonError::into_inner);
        let n_kept: usize = idle.iter().map(|pool| pool.threads.current_num_threads()).sum();
        assert!(n_kept <= KEPT.max(n_cores()), "{n_kept}");
        Ok(())
    }

    #[test]
    fn a_lack_of_memory_is_an_error() -> Result<(), Error> {
        let workers = Workers::new(Some(1), &|| true)?;
        let n_bytes = usize::MAX / 4;
        assert_eq!(workers.room(n_bytes), Err(Error::Memory { n_bytes }));
        workers.room(1 << 20)
    }
}
