//! What is asked of a caster, ray by ray, and where the answers go.

#![allow(clippy::inline_always)]
// Lazy operators would be branches.
#![allow(clippy::needless_bitwise_bool, clippy::needless_range_loop)]

use super::caster::Hit;
use crate::Vector;

/// What some rays hit first, as [`Hit`] says it.
pub struct Nearest<const N: usize> {
    pub ranges: [f64; N],
    pub triangles: [i64; N],
}

impl<const N: usize> Nearest<N> {
    pub fn none() -> Self {
        Self { ranges: [f64::INFINITY; N], triangles: [-1; N] }
    }

    #[inline(always)]
    pub fn get(&self, i: usize) -> Hit {
        Hit { range: self.ranges[i], triangle: self.triangles[i] }
    }

    #[inline(always)]
    pub fn set(&mut self, i: usize, hit: Hit) {
        (self.ranges[i], self.triangles[i]) = (hit.range, hit.triangle);
    }
}

/// Rays by row; each way through the tree asks for them and answers them in its own order.
pub trait Query {
    fn len(&self) -> usize;

    fn origin(&self, row: usize) -> Vector;

    /// Of any length.
    fn direction(&self, row: usize) -> Vector;

    /// The origins of some rows, by axis.
    fn origins<const N: usize>(&self, rows: [u32; N]) -> [[f64; N]; 3];

    /// The directions of some rows, by axis.
    fn directions<const N: usize>(&self, rows: [u32; N]) -> [[f64; N]; 3];

    /// Takes what some rays hit first, of which the first `count` are asked for; directions by
    /// axis, at unit length.
    fn answer<const N: usize>(
        &mut self,
        rows: [u32; N],
        count: usize,
        directions: &[[f64; N]; 3],
        hits: &Nearest<N>,
    );

    /// Takes what a ray hits first; `direction` has unit length.
    #[inline(always)]
    fn answer_one(&mut self, row: usize, direction: Vector, hit: Hit) {
        let hits = Nearest { ranges: [hit.range], triangles: [hit.triangle] };
        self.answer([row as u32], 1, &direction.map(|x| [x]), &hits);
    }

    /// The direction of a ray at unit length; None when it has none.
    #[inline(always)]
    fn unit(&self, row: usize) -> Option<Vector> {
        unit(self.direction(row))
    }

    /// Answers all rays where there is nothing to hit; whether all have a direction.
    fn miss(&mut self) -> bool {
        (0..self.len()).all(|row| {
            let direction = self.unit(row);
            self.answer_one(row, direction.unwrap_or_default(), Hit::NONE);
            direction.is_some()
        })
    }
}

/// Rays as they came, and their ranges and what they hit.
pub struct Rays<'a> {
    pub origins: &'a [Vector],
    pub directions: &'a [Vector],
    pub names: Option<&'a [i64]>,
    pub ranges: &'a mut [f64],
    pub ids: &'a mut [i64],
}

impl Query for Rays<'_> {
    #[inline(always)]
    fn len(&self) -> usize {
        self.origins.len()
    }

    #[inline(always)]
    fn origin(&self, row: usize) -> Vector {
        self.origins[row]
    }

    #[inline(always)]
    fn direction(&self, row: usize) -> Vector {
        self.directions[row]
    }

    #[inline(always)]
    fn origins<const N: usize>(&self, rows: [u32; N]) -> [[f64; N]; 3] {
        by_axis(self.origins, rows)
    }

    #[inline(always)]
    fn directions<const N: usize>(&self, rows: [u32; N]) -> [[f64; N]; 3] {
        by_axis(self.directions, rows)
    }

    #[inline(always)]
    fn answer<const N: usize>(
        &mut self,
        rows: [u32; N],
        count: usize,
        _: &[[f64; N]; 3],
        hits: &Nearest<N>,
    ) {
        for i in 0..count {
            let row = rows[i] as usize;
            // A ray that starts on a surface hits it at 0, not at -0.
            self.ranges[row] = hits.ranges[i] + 0.0;
            self.ids[row] = hits.get(i).id(self.names);
        }
    }
}

/// Some rows of vectors, by axis.
#[inline(always)]
pub fn by_axis<const N: usize>(vectors: &[Vector], rows: [u32; N]) -> [[f64; N]; 3] {
    let (mut x, mut y, mut z) = ([0.0; N], [0.0; N], [0.0; N]);
    for i in 0..N {
        [x[i], y[i], z[i]] = vectors[rows[i] as usize];
    }
    [x, y, z]
}

/// Whether a square of a length is 1 but for rounding.
#[inline(always)]
pub fn is_unit(square: f64) -> bool {
    (square - 1.0).abs() <= 4.0 * f64::EPSILON
}

/// Whether a square of a length keeps its digits.
#[inline(always)]
pub fn is_near_unit(square: f64) -> bool {
    (square > 0.25) & (square < 4.0)
}

/// `direction` at unit length, as it is where only rounding is missing; None when it has none.
#[inline(always)]
pub fn unit(direction: Vector) -> Option<Vector> {
    let [x, y, z] = direction;
    let square = x * x + y * y + z * z;
    if is_unit(square) {
        return Some(direction);
    }
    if is_near_unit(square) {
        let scale = 1.0 / square.sqrt();
        return Some(direction.map(|x| x * scale));
    }
    normalized(direction)
}

/// `direction` over its length, however long; None when it has none.
#[cold]
fn normalized(direction: Vector) -> Option<Vector> {
    // First by the largest: squares of very long or short vectors leave the range of float64.
    let largest = direction.iter().fold(0.0_f64, |largest, x| largest.max(x.abs()));
    if !(largest > 0.0 && direction.iter().all(|x| x.is_finite())) {
        return None;
    }
    let direction = direction.map(|x| x / largest);
    let length = direction.iter().map(|x| x * x).sum::<f64>().sqrt();
    Some(direction.map(|x| x / length))
}
