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
