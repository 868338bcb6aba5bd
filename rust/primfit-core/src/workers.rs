//! Where parallel work runs, and how it is told to stop.

use crate::Error;

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

    /// # Errors
    /// [`Error::Stopped`] when the caller does not want to go on.
    pub fn check(&self) -> Result<(), Error> {
        if (self.go_on)() { Ok(()) } else { Err(Error::Stopped) }
    }
}
