//! Candidate planes: grown from seeds over the graph of touching points.

use super::graph::Graph;
use crate::neighbors::normals::{LocalPlane, cut_plane};
use crate::neighbors::{PointTree, Search};
use crate::spread::{Spread, Sums, dot};
use crate::{Error, Workers};
use std::collections::VecDeque;

/// Label of a point without a plane.
pub const NOBODY: i32 = -1;
/// Standard deviations within which a plane takes a point.
const TAKE: f64 = 3.0;
/// Cosine of the angle to a plane beyond which the neighbourhood of a point lies on another one.
const ALONG: f64 = 0.9;
/// Standard deviations within which a plane explains a point.
const EXPLAIN: f64 = 2.0;
/// Standard deviations from its own plane at which a point is no seed.
const SEED: f64 = 2.5;
/// Share of a seed's neighbourhood that must lie on its plane, and share of those that must be new.
const ON_PLANE: f64 = 0.4;
const NEW: f64 = 0.3;
/// Fits of a seed's plane, each to the points near the one before.
const CUTS: usize = 4;
/// Growth of the number of points after which the plane is fitted again.
const REFIT: f64 = 1.5;
/// How far the noise of a growing plane may move from its seed's.
const SIGMA: (f64, f64) = (0.7, 1.3);
/// Fewest points of a plane.
pub const FEWEST: usize = 10;
/// Seeds between two questions to the caller.
const CHUNK: usize = 256;

/// A point from which a plane may grow, and the number of points that tell its first plane.
#[derive(Debug, Clone, Copy)]
pub struct Seed {
    pub place: u32,
    pub size: u32,
}

/// The label of each point: the plane that it lies on best in terms of its noise, or [`NOBODY`].
///
/// A plane may grow over points of an earlier one; a seed that earlier planes explain is skipped.
///
/// # Errors
/// [`Error::Stopped`] when the caller does not want to go on.
pub fn grow(
    tree: &PointTree,
    graph: &Graph,
    noise: &[f32],
    local: &[LocalPlane],
    step: usize,
    seeds: &[Seed],
    workers: &Workers,
) -> Result<Vec<i32>, Error> {
    let points = tree.points();
    let mut labels = vec![NOBODY; points.len()];
    let mut off = vec![f32::INFINITY; points.len()];
    let mut seen = vec![NOBODY; points.len()];
    let mut search = Search::default();
    let (mut within, mut members, mut queue) = (Vec::new(), Vec::new(), VecDeque::new());
    let mut number = 0;
    let is_along = |plane: &Spread, at: usize| {
        !at.is_multiple_of(step) || dot(&local[at / step].normal, &plane.normal).abs() >= ALONG
    };
    for (i, &Seed { place: seed, size }) in seeds.iter().enumerate() {
        if i % CHUNK == 0 {
            workers.check()?;
        }
        let seed = seed as usize;
        let is_new = |&place: &u32| f64::from(off[place as usize]) >= EXPLAIN;
        if !is_new(&(seed as u32)) && !graph.of(seed).iter().any(is_new) {
            continue;
        }
        let given = f64::from(noise[seed]);
        let window = tree.nearest(&points[seed], size as usize, &mut search);
        if window.len() < 4 {
            continue;
        }
        let start = local[seed / step].is_flat.then(|| Spread {
            mean: points[seed],
            normal: local[seed / step].normal,
            variances: [0.0; 3],
        });
        let mut plane = cut_plane(points, window, start, EXPLAIN * given, CUTS, &mut within);
        let n_new = within.iter().filter(|place| is_new(place)).count() as f64;
        if plane.distance(&points[seed]).abs() > SEED * given
            || (within.len() as f64) < ON_PLANE * window.len() as f64
            || n_new < NEW * within.len() as f64
        {
            continue;
        }
        let mut sigma = given;
        let mut sums = Sums::new(points[seed]);
        members.clear();
        queue.clear();
        for &place in &within {
            seen[place as usize] = number;
            sums.add(&points[place as usize]);
            members.push(place);
            queue.push_back(place);
        }
        let mut refit_at = REFIT * members.len() as f64;
        while let Some(place) = queue.pop_front() {
            for &other in graph.of(place as usize) {
                let at = other as usize;
                if seen[at] == number
                    || plane.distance(&points[at]).abs() >= TAKE * sigma
                    || !is_along(&plane, at)
                {
                    continue;
                }
                seen[at] = number;
                sums.add(&points[at]);
                members.push(other);
                queue.push_back(other);
            }
            if members.len() as f64 >= refit_at {
                plane = sums.moments().spread();
                sigma = plane.variances[0].sqrt().clamp(SIGMA.0 * given, SIGMA.1 * given);
                refit_at = REFIT * members.len() as f64;
            }
        }
        plane = sums.moments().spread();
        sigma = plane.variances[0].sqrt().clamp(SIGMA.0 * given, SIGMA.1 * given);
        if members.len() < FEWEST {
            continue;
        }
        for &place in &members {
            let at = place as usize;
            let distance = (plane.distance(&points[at]).abs() / sigma) as f32;
            if f64::from(distance) < TAKE && distance < off[at] {
                off[at] = distance;
                labels[at] = number;
            }
        }
        number += 1;
    }
    Ok(labels)
}
