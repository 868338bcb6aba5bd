//! Many rays against a triangle mesh: nearest hit, ties to the lower triangle.

use crate::triangle::ShearedRay;
use crate::{Error, Vector, Workers};
use parry3d_f64::bounding_volume::Aabb;
use parry3d_f64::partitioning::{Bvh, BvhBuildStrategy, BvhNode};
use rayon::prelude::*;
use std::cell::Cell;

/// Rays between two questions to the caller.
const CHUNK: usize = 1 << 16;
/// Rays that one task casts.
const TASK: usize = 256;

/// What a ray hit first.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// Distance in units of the direction; infinite for none.
    pub range: f64,
    /// Row of the triangle; -1 for none.
    pub triangle: i64,
}

impl Hit {
    const NONE: Self = Self { range: f64::INFINITY, triangle: -1 };

    fn is_before(self, other: Self) -> bool {
        self.range < other.range || (self.range == other.range && self.triangle < other.triangle)
    }
}

/// A triangle mesh ready for rays; parry's bounding-volume tree is the broad phase.
pub struct RayCaster {
    tree: Bvh,
    triangles: Vec<[Vector; 3]>,
    center: Vector,
    half_size: f64,
}

impl RayCaster {
    /// # Errors
    /// [`Error::VertexOutOfRange`] when a triangle names a vertex that does not exist.
    pub fn new(vertices: &[Vector], triangles: &[[i64; 3]]) -> Result<Self, Error> {
        let triangles = triangles
            .iter()
            .enumerate()
            .map(|(row, corners)| {
                let mut triangle = [[0.0; 3]; 3];
                for (corner, &vertex) in triangle.iter_mut().zip(corners) {
                    *corner = usize::try_from(vertex)
                        .ok()
                        .and_then(|vertex| vertices.get(vertex))
                        .copied()
                        .ok_or(Error::VertexOutOfRange {
                            triangle: row,
                            vertex,
                            n_vertices: vertices.len(),
                        })?;
                }
                Ok(triangle)
            })
            .collect::<Result<Vec<_>, Error>>()?;
        let boxes: Vec<Aabb> =
            triangles.iter().map(|triangle| Aabb::from_points(triangle.map(Into::into))).collect();
        let tree = Bvh::from_leaves(BvhBuildStrategy::Binned, &boxes);
        let (center, half_size) = if boxes.is_empty() {
            ([0.0; 3], 0.0)
        } else {
            let bounds = tree.root_aabb();
            (bounds.center().into(), bounds.half_extents().max_element())
        };
        Ok(Self { tree, triangles, center, half_size })
    }

    /// How many triangles there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.triangles.len()
    }

    /// Whether there is nothing to hit.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.triangles.is_empty()
    }

    /// The first hit of one ray; `direction` must be finite and not zero.
    #[must_use]
    pub fn cast_one(&self, origin: Vector, direction: Vector) -> Hit {
        let ray = ShearedRay::new(origin, direction);
        let slabs = Slabs::new(origin, direction, self.center, self.half_size);
        let best = Cell::new(Hit::NONE);
        self.tree.find_best(
            f64::MAX,
            |node, _| slabs.entry(node),
            |leaf, _| {
                let range = ray.cast(&self.triangles[leaf as usize])?;
                let hit = Hit { range, triangle: i64::from(leaf) };
                if hit.is_before(best.get()) {
                    best.set(hit);
                }
                Some(range)
            },
        );
        best.get()
    }

    /// The first hit of every ray, in order.
    ///
    /// # Errors
    /// [`Error::Stopped`] when the caller does not want to go on.
    pub fn cast(
        &self,
        origins: &[Vector],
        directions: &[Vector],
        workers: &Workers,
    ) -> Result<Vec<Hit>, Error> {
        let mut hits = vec![Hit::NONE; origins.len()];
        let rays = origins.chunks(CHUNK).zip(directions.chunks(CHUNK));
        for (hits, (origins, directions)) in hits.chunks_mut(CHUNK).zip(rays) {
            workers.check()?;
            workers.install(|| {
                hits.par_iter_mut()
                    .zip(origins.par_iter().zip(directions))
                    .with_min_len(TASK)
                    .for_each(|(hit, (&origin, &direction))| {
                        *hit = self.cast_one(origin, direction);
                    });
            });
        }
        Ok(hits)
    }
}

/// Where a ray crosses the slabs of a box, widened by more than the rounding of the test.
struct Slabs {
    inverse: Vector,
    near: Vector,
    far: Vector,
}

impl Slabs {
    fn new(origin: Vector, direction: Vector, center: Vector, half_size: f64) -> Self {
        let reach = (0..3).fold(half_size, |reach, k| {
            reach.max(half_size + (origin[k] - center[k]).abs() + center[k].abs())
        });
        // A component of zero would give zero times infinity for a box face at the origin.
        let inverse =
            direction.map(|d| if d.abs() < 1e-300 { 1e300_f64.copysign(d) } else { 1.0 / d });
        let margin = inverse.map(|inverse| 8.0 * f64::EPSILON * reach * inverse.abs());
        Self {
            inverse,
            near: std::array::from_fn(|k| -origin[k] * inverse[k] - margin[k]),
            far: std::array::from_fn(|k| -origin[k] * inverse[k] + margin[k]),
        }
    }

    /// Where the ray enters the box of `node`: `f64::MAX` when it does not.
    #[inline]
    fn entry(&self, node: &BvhNode) -> f64 {
        let (mins, maxs) = (node.mins(), node.maxs());
        let (mut enter, mut leave) = (-1.0_f64, f64::MAX);
        for (k, (low, high)) in
            [(mins.x, maxs.x), (mins.y, maxs.y), (mins.z, maxs.z)].into_iter().enumerate()
        {
            let (low, high) = if self.inverse[k] < 0.0 { (high, low) } else { (low, high) };
            enter = enter.max(low * self.inverse[k] + self.near[k]);
            leave = leave.min(high * self.inverse[k] + self.far[k]);
        }
        if enter <= leave && leave >= 0.0 { enter } else { f64::MAX }
    }
}
