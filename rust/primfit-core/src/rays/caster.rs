//! Many rays against triangles and round solids.

#![allow(clippy::inline_always)]

use super::interleaved::{self, Flight, IN_FLIGHT};
use super::memory::zeros;
use super::packet::{self, Packet};
use super::query::{Query, Rays};
use super::ray::Start;
use super::round::Round;
use super::tiles::{Tiles, tasks};
use super::tree::Tree;
use super::triangle::ShearedRay;
use super::walk;
use crate::instructions::{Instructions, for_each_set};
use crate::workers::Stop;
use crate::{Error, Vector, Workers};
use rayon::prelude::*;
use std::cell::RefCell;
use std::f64::consts::PI;

/// Rays between two questions to the caller.
const CHUNK: usize = 1 << 16;
/// Triangles that are ready before a caller who wants to stop would notice.
const FEW: usize = 1 << 12;
/// Expected triangles in a tile above which its rays have little in common.
const IN_TILE: f64 = 500.0;

/// Bytes that a triangle and a vertex take while the tree is built, and that a ray takes.
const TRIANGLE_BYTES: usize = 250;
const VERTEX_BYTES: usize = 24;
const RAY_BYTES: usize = 20;

/// What a ray hit first.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// Distance in units of the direction; infinite for none.
    pub range: f64,
    /// Row of the triangle, or of the round solid after all triangles; -1 for none.
    pub triangle: i64,
}

impl Hit {
    pub(super) const NONE: Self = Self { range: f64::INFINITY, triangle: -1 };

    pub(super) fn is_before(self, other: Self) -> bool {
        self.range < other.range || (self.range == other.range && self.triangle < other.triangle)
    }

    /// What the triangle is called; -1 for none.
    #[inline(always)]
    pub(super) fn id(self, names: Option<&[i64]>) -> i64 {
        match (names, usize::try_from(self.triangle)) {
            (Some(names), Ok(triangle)) => names[triangle],
            _ => self.triangle,
        }
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

/// A triangle mesh, and round solids beside it, ready for rays.
pub struct RayCaster {
    tree: Tree,
    names: Option<Vec<i64>>,
    instructions: Instructions,
}

impl RayCaster {
    /// # Errors
    /// [`Error::VertexOutOfRange`] when a triangle names a vertex that does not exist,
    /// [`Error::Stopped`] when the caller does not want to go on.
    pub fn new(
        vertices: &[Vector],
        triangles: &[[i64; 3]],
        workers: &Workers,
    ) -> Result<Self, Error> {
        Self::with_rounds(vertices, triangles, &[], workers)
    }

    /// The same with round solids, whose rows follow those of the triangles.
    ///
    /// # Errors
    /// As of [`Self::new`].
    pub fn with_rounds(
        vertices: &[Vector],
        triangles: &[[i64; 3]],
        rounds: &[Round],
        workers: &Workers,
    ) -> Result<Self, Error> {
        let n = triangles.len() + rounds.len();
        workers.room(TRIANGLE_BYTES * n + VERTEX_BYTES * vertices.len())?;
        let instructions = Instructions::best();
        let build = |stop: &Stop| Tree::new(vertices, triangles, rounds, instructions, stop);
        let tree = if n <= FEW {
            workers.install(|| build(&Stop::default()))
        } else {
            workers.watch(build)
        }?;
        Ok(Self { tree, names: None, instructions })
    }

    /// The same, but hits of many rays are called by the name of their triangle.
    ///
    /// # Panics
    /// When there are not as many names as triangles.
    #[must_use]
    pub fn named(self, names: Vec<i64>) -> Self {
        assert_eq!(names.len(), self.len(), "one name a triangle and round solid");
        Self { names: Some(names), ..self }
    }

    /// The corners of all triangles, row after row, and what these are called.
    #[must_use]
    pub fn mesh(&self) -> (Vec<[Vector; 3]>, Option<&[i64]>) {
        let mut triangles = vec![[[0.0; 3]; 3]; self.tree.exact.len()];
        for triangle in &self.tree.exact {
            triangles[triangle.id() as usize] = [0, 1, 2].map(|i| triangle.corner(i));
        }
        (triangles, self.names.as_deref())
    }

    /// The round solids, row after row.
    #[must_use]
    pub fn rounds(&self) -> &[Round] {
        &self.tree.rounds
    }

    /// How many triangles and round solids there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.tree.len()
    }

    /// Whether there is nothing to hit.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.tree.len() == 0
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
        workers.room(RAY_BYTES * n)?;
        let mut hits = Hits { ranges: zeros(n), ids: zeros(n) };
        let rays = origins.chunks(CHUNK).zip(directions.chunks(CHUNK));
        let out = hits.ranges.chunks_mut(CHUNK).zip(hits.ids.chunks_mut(CHUNK));
        for (first, ((origins, directions), (ranges, ids))) in
            (0..).step_by(CHUNK).zip(rays.zip(out))
        {
            workers.check()?;
            let Some(tasks) = tasks(origins, directions, self.largest_tile()) else {
                return Err(what_is_wrong(origins, directions, first));
            };
            let mut rest = (origins, directions, ranges, ids);
            let mut parts: Vec<(Way, Rays)> = tasks
                .into_iter()
                .map(|task| {
                    let (origins, directions, ranges, ids) = std::mem::take(&mut rest);
                    let (origins, later_origins) = origins.split_at(task.n_rays);
                    let (directions, later_directions) = directions.split_at(task.n_rays);
                    let (ranges, later_ranges) = ranges.split_at_mut(task.n_rays);
                    let (ids, later_ids) = ids.split_at_mut(task.n_rays);
                    rest = (later_origins, later_directions, later_ranges, later_ids);
                    let names = self.names();
                    (self.way(task.tiles), Rays { origins, directions, names, ranges, ids })
                })
                .collect();
            let all_have_directions = workers
                .install(|| parts.par_iter_mut().all(|(way, rays)| self.cast_part(*way, rays)));
            if !all_have_directions {
                return Err(what_is_wrong(origins, directions, first));
            }
        }
        Ok(hits)
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

    pub(super) fn names(&self) -> Option<&[i64]> {
        self.names.as_deref()
    }

    /// Casts and answers the rays of one task; whether all have a direction.
    pub(super) fn cast_part<Q: Query>(&self, way: Way, query: &mut Q) -> bool {
        SCRATCH.with_borrow_mut(|scratch| {
            let (set, tree) = (self.instructions, &self.tree);
            if tree.rounds.is_empty() {
                cast_on::<Q, false>(set, way, tree, query, scratch)
            } else {
                cast_on::<Q, true>(set, way, tree, query, scratch)
            }
        })
    }
}

/// What rays on their way keep: large, so that each thread makes it once.
struct Scratch {
    packet: Packet,
    flights: [Flight; IN_FLIGHT],
}

thread_local! {
    static SCRATCH: RefCell<Box<Scratch>> = RefCell::new(Box::new(Scratch {
        packet: Packet::new(),
        flights: std::array::from_fn(|_| Flight::idle()),
    }));
}

for_each_set! {
    fn cast_on<Q: Query, const ROUND: bool>(way: Way, tree: &Tree, query: &mut Q, scratch: &mut Scratch) -> bool {
        let Scratch { packet, flights } = scratch;
        match way {
            _ if query.len() == 0 => true,
            _ if tree.len() == 0 => query.miss(),
            Way::OneByOne => {
                walk::cast::<Set, Q, ROUND>(tree, query, &mut packet.bundle, &mut flights[0].walk)
            }
            Way::Interleaved => {
                interleaved::cast::<Set, Q, ROUND>(tree, query, &mut packet.bundle, flights)
            }
            Way::Packets(tiles) => {
                let start = Start::new(query.origin(0), &tree.frame);
                if start.is_far {
                    return interleaved::cast::<Set, Q, ROUND>(tree, query, &mut packet.bundle, flights);
                }
                packet::cast::<Set, Q, ROUND>(tree, tiles, start, query, packet, flights)
            }
        }
    }
}

/// Says what is wrong with the first bad ray; row `first` is the given one of all.
fn what_is_wrong(origins: &[Vector], directions: &[Vector], first: usize) -> Error {
    let is_finite = |vector: &Vector| vector.iter().all(|x| x.is_finite());
    let bad =
        (first..).zip(origins.iter().zip(directions)).find_map(|(row, (origin, direction))| {
            if !is_finite(origin) {
                Some(Error::NotFinite { name: "origins", row })
            } else if !is_finite(direction) {
                Some(Error::NotFinite { name: "directions", row })
            } else {
                (*direction == [0.0; 3]).then_some(Error::NoDirection { row })
            }
        });
    bad.unwrap_or(Error::NoDirection { row: first })
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

/// Every triangle and round solid in float64.
#[cold]
pub(super) fn cast_at_all(tree: &Tree, origin: Vector, direction: Vector) -> Hit {
    let ray = ShearedRay::new(origin, direction);
    let hits = tree.exact.iter().filter_map(|triangle| {
        let range = ray.cast(&triangle.corners)?;
        Some(Hit { range, triangle: triangle.id() })
    });
    let rounds = (0..).zip(&tree.rounds).map(|(row, round)| Hit {
        range: round.cast_one(origin, direction),
        triangle: tree.round_id(row),
    });
    let rounds = rounds.filter(|hit| hit.range < f64::INFINITY);
    hits.chain(rounds).fold(Hit::NONE, |best, hit| if hit.is_before(best) { hit } else { best })
}
