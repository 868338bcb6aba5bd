//! Arithmetic of vectors.

use crate::Vector;
pub use crate::spread::dot;

#[inline]
pub fn minus(a: &Vector, b: &Vector) -> Vector {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[inline]
pub fn plus(a: &Vector, b: &Vector) -> Vector {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

#[inline]
pub fn scaled(a: &Vector, by: f64) -> Vector {
    [a[0] * by, a[1] * by, a[2] * by]
}

/// From `a` so far along `direction`.
#[inline]
pub fn along(a: &Vector, direction: &Vector, far: f64) -> Vector {
    [a[0] + far * direction[0], a[1] + far * direction[1], a[2] + far * direction[2]]
}

#[inline]
pub fn cross(a: &Vector, b: &Vector) -> Vector {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[inline]
pub fn unit(a: &Vector) -> Vector {
    scaled(a, 1.0 / dot(a, a).sqrt())
}

/// Middle of points; zero where there are none.
pub fn mean<'a>(points: impl Iterator<Item = &'a Vector>) -> Vector {
    let (sum, count) =
        points.fold(([0.0; 3], 0.0), |(sum, count), point| (plus(&sum, point), count + 1.0));
    if count == 0.0 { sum } else { scaled(&sum, 1.0 / count) }
}
