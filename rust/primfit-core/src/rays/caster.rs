//! Many rays against a triangle mesh.

#![allow(clippy::inline_always)]

use super::lanes::{Isa, Scalar};
use super::ray::Start;
use super::tiles::{Tiles, tasks};
use super::tree::Tree;
use super::triangle::ShearedRay;
use super::{interleaved, packet, walk};
use crate::instructions::Instructions;
use crate::{Error, Vector, Workers};
use rayon::prelude::*;
use std::f64::consts::PI;

/// Rays between two questions to the caller.
const CHUNK: usize = 1 << 16;
/// Expected triangles in a tile above which its rays have little in common.
const IN_TILE: f64 = 500.0;

/// What a ray hit first.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// Distance in units of the direction; infinite for none.
    pub range: f64,
    /// Row of the triangle; -1 for none.
    pub triangle: i64,
}

impl Hit {
    pub(super) const NONE: Self = Self { range: f64::INFINITY, triangle: -1 };

    pub(super) fn is_before(self, other: Self) -> bool {
        self.range < other.range || (self.range == other.range && self.triangle < other.triangle)
    }
}

/// How a run of rays goes through the tree.
#[derive(Clone, Copy, Debug)]
pub(super) enum Way {
    OneByOne,
    Interleaved,
    /// Rays of one origin.
    Packets(Tiles),
}

/// What many rays hit first, in their order.
#[derive(Debug, Clone, PartialEq)]
pub struct Hits {
    /// Distances along the normalised directions; infinite for none.
    pub ranges: Vec<f64>,
    /// Rows of the triangles, or what they are called; -1 for none.
    pub ids: Vec<i64>,
}

/// A triangle mesh ready for rays.
pub struct RayCaster {
    tree: Tree,
    names: Option<Vec<i64>>,
    instructions: Instructions,
}

impl RayCaster {
    /// # Errors
    /// [`Error::VertexOutOfRange`] when a triangle names a vertex that does not exist.
    pub fn new(vertices: &[Vector], triangles: &[[i64; 3]]) -> Result<Self, Error> {
        let n_vertices = vertices.len();
        for (triangle, corners) in triangles.iter().enumerate() {
            for &vertex in corners {
                if !usize::try_from(vertex).is_ok_and(|vertex| vertex < n_vertices) {
                    return Err(Error::VertexOutOfRange { triangle, vertex, n_vertices });
                }
            }
        }
        Ok(Self {
            tree: Tree::new(vertices, triangles),
            names: None,
            instructions: Instructions::best(),
        })
    }

    /// The same, but hits of many rays are called by the name of their triangle.
    ///
    /// # Panics
    /// When there are not as many names as triangles.
    #[must_use]
    pub fn named(self, names: Vec<i64>) -> Self {
        assert_eq!(names.len(), self.len(), "one name a triangle");
        Self { names: Some(names), ..self }
    }

    /// How many triangles there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.tree.exact.len()
    }

    /// Whether there is nothing to hit.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.tree.exact.is_empty()
    }

    /// The first hit of one ray; `direction` must be finite and not zero.
    #[must_use]
    pub fn cast_one(&self, origin: Vector, direction: Vector) -> Hit {
        let mut hit = [Hit::NONE];
        self.cast_task(Way::OneByOne, &[origin], &[direction], &mut hit);
        hit[0]
    }

    /// The first hit of every ray, in order; directions may have any length but zero.
    ///
    /// # Errors
    /// [`Error::NotFinite`] and [`Error::NoDirection`] for such a ray, [`Error::Stopped`] when
    /// the caller does not want to go on.
    pub fn cast(
        &self,
        origins: &[Vector],
        directions: &[Vector],
        workers: &Workers,
    ) -> Result<Hits, Error> {
        let n = origins.len();
        let mut hits = Hits { ranges: vec![0.0; n], ids: vec![0; n] };
        let rays = origins.chunks(CHUNK).zip(directions.chunks(CHUNK));
        let out = hits.ranges.chunks_mut(CHUNK).zip(hits.ids.chunks_mut(CHUNK));
        for (chunk, ((origins, directions), (ranges, ids))) in rays.zip(out).enumerate() {
            workers.check()?;
            let mut rest = (origins, directions, ranges, ids);
            let parts: Vec<_> = tasks(origins, directions, self.largest_tile())
                .into_iter()
                .map(|task| {
                    let (origins, directions, ranges, ids) = std::mem::take(&mut rest);
                    let (origins, later_origins) = origins.split_at(task.n_rays);
                    let (directions, later_directions) = directions.split_at(task.n_rays);
                    let (ranges, later_ranges) = ranges.split_at_mut(task.n_rays);
                    let (ids, later_ids) = ids.split_at_mut(task.n_rays);
                    rest = (later_origins, later_directions, later_ranges, later_ids);
                    (self.way(task.tiles), origins, directions, ranges, ids)
                })
                .collect();
            let is_good = workers.install(|| {
                parts
                    .into_par_iter()
                    .map(|(way, origins, directions, ranges, ids)| {
                        let units: Option<Vec<Vector>> = origins
                            .iter()
                            .zip(directions)
                            .map(|(origin, &direction)| {
                                unit(direction).filter(|_| origin.iter().all(|x| x.is_finite()))
                            })
                            .collect();
                        let Some(units) = units else { return false };
                        self.cast_part(way, origins, &units, ranges, ids);
                        true
                    })
                    .reduce(|| true, |a, b| a && b)
            });
            if !is_good {
                check(origins, directions, chunk * CHUNK)?;
            }
        }
        Ok(hits)
    }

    /// Rays of one task; directions have unit length.
    pub(super) fn cast_part(
        &self,
        way: Way,
        origins: &[Vector],
        directions: &[Vector],
        ranges: &mut [f64],
        ids: &mut [i64],
    ) {
        let mut hits = vec![Hit::NONE; origins.len()];
        self.cast_task(way, origins, directions, &mut hits);
        for ((range, id), hit) in ranges.iter_mut().zip(ids).zip(hits) {
            *range = hit.range;
            *id = match (&self.names, usize::try_from(hit.triangle)) {
                (Some(names), Ok(triangle)) => names[triangle],
                _ => hit.triangle,
            };
        }
    }

    pub(super) fn way(&self, tiles: Option<Tiles>) -> Way {
        match tiles {
            Some(tiles) => Way::Packets(tiles),
            None if self.tree.is_cached() => Way::OneByOne,
            None => Way::Interleaved,
        }
    }

    /// Solid angle of a tile that has enough triangles in it.
    pub(super) fn largest_tile(&self) -> f64 {
        IN_TILE * 4.0 * PI / self.len() as f64
    }

    pub(super) fn cast_task(
        &self,
        way: Way,
        origins: &[Vector],
        directions: &[Vector],
        hits: &mut [Hit],
    ) {
        if self.is_empty() {
            return;
        }
        match self.instructions {
            Instructions::Scalar => cast_body::<Scalar>(way, &self.tree, origins, directions, hits),
            #[cfg(target_arch = "x86_64")]
            Instructions::Avx2 => {
                #[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
                fn on(
                    way: Way,
                    tree: &Tree,
                    origins: &[Vector],
                    directions: &[Vector],
                    hits: &mut [Hit],
                ) {
                    cast_body::<super::lanes::Avx2>(way, tree, origins, directions, hits);
                }
                // SAFETY: chosen only where the processor has it.
                unsafe { on(way, &self.tree, origins, directions, hits) }
            }
            #[cfg(target_arch = "x86_64")]
            Instructions::Avx512 => {
                #[target_feature(enable = "avx512f,avx512vl,avx512dq,fma,bmi1,bmi2,lzcnt,popcnt")]
                fn on(
                    way: Way,
                    tree: &Tree,
                    origins: &[Vector],
                    directions: &[Vector],
                    hits: &mut [Hit],
                ) {
                    cast_body::<super::lanes::Avx512>(way, tree, origins, directions, hits);
                }
                // SAFETY: chosen only where the processor has it.
                unsafe { on(way, &self.tree, origins, directions, hits) }
            }
        }
    }
}

/// `direction` at unit length, as it is where only rounding is missing; None when it has none.
#[inline]
pub(super) fn unit(direction: Vector) -> Option<Vector> {
    let square = direction.iter().map(|x| x * x).sum::<f64>();
    if (square - 1.0).abs() <= 4.0 * f64::EPSILON {
        return Some(direction);
    }
    normalized(direction)
}

/// `direction` over its length; None when it has none.
#[inline]
pub(super) fn normalized(direction: Vector) -> Option<Vector> {
    // First by the largest: squares of very long or short vectors leave the range of float64.
    let largest = direction.iter().fold(0.0_f64, |largest, x| largest.max(x.abs()));
    if !(largest > 0.0 && direction.iter().all(|x| x.is_finite())) {
        return None;
    }
    let direction = direction.map(|x| x / largest);
    let length = direction.iter().map(|x| x * x).sum::<f64>().sqrt();
    Some(direction.map(|x| x / length))
}

/// Says what is wrong with the first bad ray; row 0 is the given one of all.
fn check(origins: &[Vector], directions: &[Vector], first: usize) -> Result<(), Error> {
    for (row, (origin, direction)) in (first..).zip(origins.iter().zip(directions)) {
        for (name, vector) in [("origins", origin), ("directions", direction)] {
            if !vector.iter().all(|x| x.is_finite()) {
                return Err(Error::NotFinite { name, row });
            }
        }
        if *direction == [0.0; 3] {
            return Err(Error::NoDirection { row });
        }
    }
    Ok(())
}

#[inline(always)]
fn cast_body<I: Isa>(
    way: Way,
    tree: &Tree,
    origins: &[Vector],
    directions: &[Vector],
    hits: &mut [Hit],
) {
    match way {
        Way::OneByOne => walk::cast::<I>(tree, origins, directions, hits),
        Way::Interleaved => interleaved::cast::<I>(tree, origins, directions, hits),
        Way::Packets(tiles) => {
            let start = Start::new(origins[0], &tree.frame);
            if start.is_far {
                return walk::cast::<I>(tree, origins, directions, hits);
            }
            packet::cast::<I>(tree, tiles, start, origins[0], directions, hits);
        }
    }
}

#[cfg(test)]
impl Way {
    /// Every way for these rays.
    pub(super) fn all(origins: &[Vector]) -> Vec<Self> {
        let mut all = vec![Self::OneByOne, Self::Interleaved];
        if origins.iter().all(|origin| *origin == origins[0]) {
            let tiles = [(origins.len(), 16, 1), (21, 8, 2), (10, 4, 4)];
            all.extend(tiles.map(|tiles| Self::Packets(tiles.into())));
        }
        all
    }
}

#[cfg(test)]
impl RayCaster {
    pub(super) fn use_instructions(&mut self, instructions: Instructions) {
        self.instructions = instructions;
    }

    pub(super) fn tree(&self) -> &Tree {
        &self.tree
    }
}

/// Every triangle in float64.
#[cold]
pub(super) fn cast_at_all(tree: &Tree, origin: Vector, direction: Vector) -> Hit {
    let ray = ShearedRay::new(origin, direction);
    let hits = tree.exact.iter().filter_map(|triangle| {
        let range = ray.cast(&triangle.corners)?;
        Some(Hit { range, triangle: i64::from(triangle.id) })
    });
    hits.fold(Hit::NONE, |best, hit| if hit.is_before(best) { hit } else { best })
}
