//! One ray against one triangle, without gaps between neighbours.
//!
//! Woop, Benthin, Wald: Watertight Ray/Triangle Intersection, JCGT 2(1), 2013. The ray is
//! sheared onto the z axis; a triangle is hit when the three edge functions agree in sign.
//! Two triangles that share an edge evaluate the same products for it, so that a ray at the
//! edge is never lost between them. Where a difference of products is near zero, their rounding
//! errors are taken into account, which gives its exact sign and most of its digits.

#![allow(clippy::inline_always)]
// Lazy operators would be branches.
#![allow(clippy::needless_bitwise_bool)]
// Lanes are counted, so that the compiler sees whole vectors.
#![allow(clippy::needless_range_loop)]

use crate::Vector;

/// The corners of a triangle by axis; what comes fourth does not count.
pub type Corners = [[f64; 4]; 3];

/// A ray made ready for many triangles.
#[derive(Clone, Copy, Default)]
pub struct ShearedRay {
    origin: Vector,
    axes: [usize; 3],
    shear: [f64; 3],
}

impl ShearedRay {
    /// `direction` must be finite and not zero.
    #[inline(always)]
    pub fn new(origin: Vector, direction: Vector) -> Self {
        let [x, y, z] = direction.map(f64::abs);
        Self::with_inverse(origin, direction, 1.0 / x.max(y).max(z))
    }

    /// The same when the inverse of the longest component is known, but for its sign.
    #[inline(always)]
    pub fn with_inverse(origin: Vector, direction: Vector, inverse: f64) -> Self {
        let axes = Self::axes_of(direction);
        let [kx, ky, kz] = axes;
        let inverse = inverse.copysign(direction[kz]);
        Self { origin, axes, shear: [direction[kx] * inverse, direction[ky] * inverse, inverse] }
    }

    /// The longest axis is last; the others in an order that keeps the handedness.
    #[inline(always)]
    pub fn axes_of(direction: Vector) -> [usize; 3] {
        let [x, y, z] = direction.map(f64::abs);
        let kz = if x >= y && x >= z {
            0
        } else if y >= z {
            1
        } else {
            2
        };
        let (kx, ky) = ((kz + 1) % 3, (kz + 2) % 3);
        if direction[kz] < 0.0 { [ky, kx, kz] } else { [kx, ky, kz] }
    }

    /// A ray whose axes and shear are known.
    #[inline(always)]
    pub fn from_shear(origin: Vector, axes: [usize; 3], shear: Vector) -> Self {
        Self { origin, axes, shear }
    }

    pub fn origin(&self) -> Vector {
        self.origin
    }

    /// Distance to the triangle in units of the direction, at zero or beyond.
    #[inline(always)]
    pub fn cast(&self, triangle: &Corners) -> Option<f64> {
        let [kx, ky, kz] = self.axes;
        let [sx, sy, sz] = self.shear;
        let [ox, oy, oz] = [kx, ky, kz].map(|k| self.origin[k]);
        let (mut x, mut y, mut depth) = ([0.0; 4], [0.0; 4], [0.0; 4]);
        for i in 0..4 {
            let z = triangle[kz][i] - oz;
            x[i] = triangle[kx][i] - ox - sx * z;
            y[i] = triangle[ky][i] - oy - sy * z;
            depth[i] = sz * z;
        }
        // Of each corner, the two others in turn.
        let (after, before) = ([1, 2, 0, 3], [2, 0, 1, 3]);
        let (mut sides, mut clear) = ([0.0; 4], [0.0; 4]);
        for i in 0..4 {
            let (left, right) = (x[before[i]] * y[after[i]], y[before[i]] * x[after[i]]);
            sides[i] = left - right;
            clear[i] = sides[i].abs() - CLEAR * (left.abs() + right.abs());
        }
        if !((clear[0] > 0.0) & (clear[1] > 0.0) & (clear[2] > 0.0)) {
            for i in 0..3 {
                let (a, b) = (before[i], after[i]);
                sides[i] = cross([x[a], y[a], 0.0], [x[b], y[b], 0.0]);
            }
        }
        let [u, v, w, _] = sides;
        let is_inside =
            ((u >= 0.0) & (v >= 0.0) & (w >= 0.0)) | ((u <= 0.0) & (v <= 0.0) & (w <= 0.0));
        let determinant = u + v + w;
        if !is_inside | (determinant == 0.0) {
            return None;
        }
        // The mean of the depths lies between them, even at grazing incidence.
        let depth = (u * depth[0] + v * depth[1] + w * depth[2]) / determinant;
        (depth >= 0.0).then_some(depth)
    }

    /// What [`Self::cast`] says for rays of one origin and the same axes, infinite for none; None
    /// when an edge is so near to one of them that it needs a closer look.
    #[inline(always)]
    pub fn cast_many<const N: usize>(
        origin: Vector,
        [kx, ky, kz]: [usize; 3],
        [sx, sy, sz]: &[[f64; N]; 3],
        triangle: &Corners,
    ) -> Option<[f64; N]> {
        let [a, b, c] = [0, 1, 2].map(|i| [kx, ky, kz].map(|k| triangle[k][i] - origin[k]));
        let mut is_clear = true;
        let mut depths = [0.0; N];
        for i in 0..N {
            let [a, b, c] = [a, b, c].map(|[x, y, z]| [x - sx[i] * z, y - sy[i] * z, sz[i] * z]);
            let ([u, u_clear], [v, v_clear], [w, w_clear]) =
                (rough_cross(c, b), rough_cross(a, c), rough_cross(b, a));
            is_clear &= (u_clear > 0.0) & (v_clear > 0.0) & (w_clear > 0.0);
            let determinant = u + v + w;
            let depth = (u * a[2] + v * b[2] + w * c[2]) / determinant;
            let is_inside =
                ((u >= 0.0) & (v >= 0.0) & (w >= 0.0)) | ((u <= 0.0) & (v <= 0.0) & (w <= 0.0));
            depths[i] = if is_inside & (depth >= 0.0) { depth } else { f64::INFINITY };
        }
        is_clear.then_some(depths)
    }
}

/// Below this share of the products, their difference needs their rounding errors.
const CLEAR: f64 = 1e-9;

/// The difference of products, and by how much it is clear of zero.
#[inline(always)]
fn rough_cross(a: Vector, b: Vector) -> [f64; 2] {
    let left = a[0] * b[1];
    let right = a[1] * b[0];
    let difference = left - right;
    [difference, difference.abs() - CLEAR * (left.abs() + right.abs())]
}

/// `a[0] * b[1] - a[1] * b[0]`, with the right sign and at least six digits.
#[inline(always)]
fn cross(a: Vector, b: Vector) -> f64 {
    let [difference, clear] = rough_cross(a, b);
    if clear > 0.0 {
        return difference;
    }
    let (left, right) = (a[0] * b[1], a[1] * b[0]);
    difference + (f64::mul_add(a[0], b[1], -left) - f64::mul_add(a[1], b[0], -right))
}
