//! What can go wrong in the core.

/// Every error of this crate.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Error {
    /// A triangle names a vertex that does not exist.
    #[error("triangle {triangle} names vertex {vertex}, but there are {n_vertices} vertices")]
    VertexOutOfRange {
        /// Row of the triangle.
        triangle: usize,
        /// The vertex that it names.
        vertex: i64,
        /// How many vertices there are.
        n_vertices: usize,
    },
    /// A ray is not finite.
    #[error("{name} must be finite, but row {row} is not")]
    NotFinite {
        /// The part of the ray.
        name: &'static str,
        /// Which ray.
        row: usize,
    },
    /// A ray has no direction.
    #[error("directions must not be zero, but row {row} is")]
    NoDirection {
        /// Which ray.
        row: usize,
    },
    /// Points are farther apart than their rounding allows to compare with a distance.
    #[error("eps={eps:?} m is below the rounding of points that span {span:?} m")]
    TooWide {
        /// The distance.
        eps: f64,
        /// The longest side of the box around the points.
        span: f64,
    },
    /// There are more points than 32 bits can number.
    #[error("there must be fewer than 2^32 points, not {n_points}")]
    TooMany {
        /// How many there are.
        n_points: usize,
    },
    /// The memory is short.
    #[error("there is no memory for {n_bytes} bytes")]
    Memory {
        /// How many bytes were asked for.
        n_bytes: usize,
    },
    /// A word of a text is no number.
    #[error("line {line} has {word:?} in column {column}, which is no number")]
    Word {
        /// Number of the line, from 1.
        line: usize,
        /// Number of the column, from 1.
        column: usize,
        /// How the word begins.
        word: String,
    },
    /// A line of a table has too many or too few words.
    #[error("line {line} has {found} columns, not {expected}")]
    Width {
        /// Number of the line, from 1.
        line: usize,
        /// How many the other lines have.
        expected: usize,
        /// How many it has.
        found: usize,
    },
    /// A file ends before its rows do.
    #[error("it ends after {n_rows} of {expected} rows")]
    Short {
        /// How many rows there are, or can be.
        n_rows: usize,
        /// How many there should be.
        expected: usize,
    },
    /// A list has no length.
    #[error("row {row} has a list whose length is no whole number of at least 0")]
    List {
        /// Which row.
        row: usize,
    },
    /// The caller asked to stop.
    #[error("stopped by the caller")]
    Stopped,
    /// The threads could not be started.
    #[error("cannot start {n_threads} threads (0: as many as there are cores): {reason}")]
    Threads {
        /// How many were asked for.
        n_threads: usize,
        /// What the system said.
        reason: String,
    },
}

/// Memory that is asked for, so that a lack of it is an error and no end of the process.
pub trait Room: Sized {
    /// An empty vector with room for `n` elements.
    fn with_room(n: usize) -> Result<Self, Error>;
}

impl<T> Room for Vec<T> {
    fn with_room(n: usize) -> Result<Self, Error> {
        let mut room = Self::new();
        let n_bytes = n.saturating_mul(size_of::<T>());
        room.try_reserve_exact(n).map_err(|_| Error::Memory { n_bytes })?;
        Ok(room)
    }
}
