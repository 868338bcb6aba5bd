//! One ray against one triangle, without gaps between neighbours.
//!
//! Woop, Benthin, Wald: Watertight Ray/Triangle Intersection, JCGT 2(1), 2013. The ray is
//! sheared onto the z axis; a triangle is hit when the three edge functions agree in sign.
//! Two triangles that share an edge evaluate the same products for it, so that a ray at the
//! edge is never lost between them. Where a difference of products is within rounding of
//! zero, its exact sign is taken from the rounding errors of the products.

use crate::Vector;

/// A ray made ready for many triangles.
pub struct ShearedRay {
    origin: Vector,
    axes: [usize; 3],
    shear: [f64; 3],
}

impl ShearedRay {
    /// `direction` must be finite and not zero.
    pub fn new(origin: Vector, direction: Vector) -> Self {
        let magnitude = direction.map(f64::abs);
        let kz = if magnitude[0] >= magnitude[1] && magnitude[0] >= magnitude[2] {
            0
        } else if magnitude[1] >= magnitude[2] {
            1
        } else {
            2
        };
        let (mut kx, mut ky) = ((kz + 1) % 3, (kz + 2) % 3);
        if direction[kz] < 0.0 {
            std::mem::swap(&mut kx, &mut ky);
        }
        let inverse = 1.0 / direction[kz];
        Self {
            origin,
            axes: [kx, ky, kz],
            shear: [direction[kx] * inverse, direction[ky] * inverse, inverse],
        }
    }

    /// Distance to the triangle in units of the direction, at zero or beyond.
    #[inline]
    pub fn cast(&self, triangle: &[Vector; 3]) -> Option<f64> {
        let [kx, ky, kz] = self.axes;
        let [sx, sy, sz] = self.shear;
        let shifted = triangle.map(|vertex| {
            let z = vertex[kz] - self.origin[kz];
            [vertex[kx] - self.origin[kx] - sx * z, vertex[ky] - self.origin[ky] - sy * z, sz * z]
        });
        let [a, b, c] = shifted;
        let u = cross(c, b);
        let v = cross(a, c);
        let w = cross(b, a);
        if (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0) {
            return None;
        }
        let determinant = u + v + w;
        if determinant == 0.0 {
            return None;
        }
        // The mean of the depths lies between them, even at grazing incidence.
        let depth = (u * a[2] + v * b[2] + w * c[2]) / determinant;
        (depth >= 0.0).then_some(depth)
    }
}

/// `a[0] * b[1] - a[1] * b[0]`, with the right sign.
#[inline]
fn cross(a: Vector, b: Vector) -> f64 {
    let left = a[0] * b[1];
    let right = a[1] * b[0];
    let difference = left - right;
    if difference.abs() > 1e-15 * (left.abs() + right.abs()) {
        difference
    } else {
        difference + (f64::mul_add(a[0], b[1], -left) - f64::mul_add(a[1], b[0], -right))
    }
}
