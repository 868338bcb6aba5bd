//! Many rays against a triangle mesh.

#![allow(clippy::inline_always)]

use super::instructions::Instructions;
use super::lanes::{Isa, Scalar};
use super::ray::Start;
use super::tiles::{Tiles, tasks};
use super::tree::Tree;
use super::triangle::ShearedRay;
use super::{interleaved, packet, walk};
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

/// A triangle mesh ready for rays.
pub struct RayCaster {
    tree: Tree,
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
        Ok(Self { tree: Tree::new(vertices, triangles), instructions: Instructions::best() })
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
        let alone = if self.tree.is_cached() { Way::OneByOne } else { Way::Interleaved };
        let largest_tile = IN_TILE * 4.0 * PI / self.len() as f64;
        let rays = origins.chunks(CHUNK).zip(directions.chunks(CHUNK));
        for (hits, (origins, directions)) in hits.chunks_mut(CHUNK).zip(rays) {
            workers.check()?;
            let mut rest = (origins, directions, hits);
            let tasks: Vec<_> = tasks(origins, directions, largest_tile)
                .into_iter()
                .map(|task| {
                    let (origins, directions, hits) = std::mem::take(&mut rest);
                    let (origins, later_origins) = origins.split_at(task.n_rays);
                    let (directions, later_directions) = directions.split_at(task.n_rays);
                    let (hits, later_hits) = hits.split_at_mut(task.n_rays);
                    rest = (later_origins, later_directions, later_hits);
                    (task.tiles.map_or(alone, Way::Packets), origins, directions, hits)
                })
                .collect();
            workers.install(|| {
                tasks.into_par_iter().for_each(|(way, origins, directions, hits)| {
                    self.cast_task(way, origins, directions, hits);
                });
            });
        }
        Ok(hits)
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
