//! Candidate planes: grown from seeds over the graph of touching points.

use super::context::Context;
use crate::neighbors::Search;
use crate::neighbors::normals::{LocalPlane, cut_plane};
use crate::spread::{Spread, Sums, dot};
use crate::{Error, Workers};
use std::collections::VecDeque;

/// Label of a point without a plane.
pub const NOBODY: i32 = -1;
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
    context: &Context,
    local: &[LocalPlane],
    step: usize,
    seeds: &[Seed],
    workers: &Workers,
) -> Result<Vec<i32>, Error> {
    let n = context.points().len();
    let mut growth = Growth {
        context,
        local,
        step,
        labels: vec![NOBODY; n],
        off: vec![f32::INFINITY; n],
        seen: vec![NOBODY; n],
        search: Search::default(),
        members: Vec::new(),
        queue: VecDeque::new(),
    };
    let mut number = 0;
    for (i, &seed) in seeds.iter().enumerate() {
        if i % CHUNK == 0 {
            workers.check()?;
        }
        let Some(first) = growth.first_plane(seed) else { continue };
        let (plane, sigma) = growth.spread_from(seed, first, number);
        if growth.members.len() >= FEWEST {
            growth.claim(&plane, sigma, number);
            number += 1;
        }
    }
    Ok(growth.labels)
}

/// A cloud over which planes grow, one after the other.
struct Growth<'a> {
    context: &'a Context<'a>,
    local: &'a [LocalPlane],
    step: usize,
    labels: Vec<i32>,
    /// How far each point is from its plane, in standard deviations.
    off: Vec<f32>,
    /// The plane that took up each point last while it grew.
    seen: Vec<i32>,
    search: Search,
    /// Points of the plane that grows.
    members: Vec<u32>,
    queue: VecDeque<u32>,
}

impl Growth<'_> {
    /// Whether no earlier plane explains a point.
    fn is_new(&self, place: u32) -> bool {
        f64::from(self.off[place as usize]) >= self.context.settings.growth.explain
    }

    /// The plane of a seed's neighbourhood, whose points become the members; None where it tells
    /// none, or earlier planes explain it.
    fn first_plane(&mut self, seed: Seed) -> Option<Spread> {
        let &Context { tree, settings, .. } = self.context;
        let at = seed.place as usize;
        let points = tree.points();
        if !self.is_new(seed.place)
            && !self.context.graph.of(at).iter().any(|&other| self.is_new(other))
        {
            return None;
        }
        let given = f64::from(self.context.noise[at]);
        let window = tree.nearest(&points[at], seed.size as usize, &mut self.search);
        if window.len() < 4 {
            return None;
        }
        let own = &self.local[at / self.step];
        let start = own.is_flat.then(|| Spread {
            mean: points[at],
            normal: own.normal,
            variances: [0.0; 3],
        });
        let n_all = window.len() as f64;
        let plane = cut_plane(
            points,
            window,
            start,
            settings.growth.explain * given,
            settings.growth.cuts,
            &mut self.members,
        );
        let n_within = self.members.len() as f64;
        let n_new = self.members.iter().filter(|&&place| self.is_new(place)).count() as f64;
        if plane.distance(&points[at]).abs() > settings.growth.seed * given
            || n_within < settings.growth.on_plane * n_all
            || n_new < settings.growth.new * n_within
        {
            return None;
        }
        Some(plane)
    }

    /// Lets a plane take what touches its members and lies on it, step by step; the plane of all
    /// members then, and its standard deviation.
    fn spread_from(&mut self, seed: Seed, first: Spread, number: i32) -> (Spread, f64) {
        let (points, settings) = (self.context.points(), self.context.settings);
        let given = f64::from(self.context.noise[seed.place as usize]);
        let (mut plane, mut sigma) = (first, given);
        let mut sums = Sums::new(points[seed.place as usize]);
        self.queue.clear();
        for &place in &self.members {
            self.seen[place as usize] = number;
            sums.add(&points[place as usize]);
            self.queue.push_back(place);
        }
        let fitted = |sums: &Sums| {
            let plane = sums.moments().spread();
            let sigma = plane.variances[0]
                .sqrt()
                .clamp(settings.growth.sigma.0 * given, settings.growth.sigma.1 * given);
            (plane, sigma)
        };
        let mut refit_at = settings.growth.refit * self.members.len() as f64;
        while let Some(place) = self.queue.pop_front() {
            for &other in self.context.graph.of(place as usize) {
                let at = other as usize;
                if self.seen[at] == number
                    || plane.distance(&points[at]).abs() >= settings.growth.take * sigma
                    || !self.is_along(&plane, at)
                {
                    continue;
                }
                self.seen[at] = number;
                sums.add(&points[at]);
                self.members.push(other);
                self.queue.push_back(other);
            }
            if self.members.len() as f64 >= refit_at {
                (plane, sigma) = fitted(&sums);
                refit_at = settings.growth.refit * self.members.len() as f64;
            }
        }
        fitted(&sums)
    }

    /// Whether the neighbourhood of a point, where it has one of its own, lies along a plane.
    fn is_along(&self, plane: &Spread, at: usize) -> bool {
        !at.is_multiple_of(self.step)
            || dot(&self.local[at / self.step].normal, &plane.normal).abs()
                >= self.context.settings.growth.along
    }

    /// Gives a plane those of its members that lie on no other one as well.
    fn claim(&mut self, plane: &Spread, sigma: f64, number: i32) {
        for &place in &self.members {
            let at = place as usize;
            let distance = (plane.distance(&self.context.points()[at]).abs() / sigma) as f32;
            if f64::from(distance) < self.context.settings.growth.take && distance < self.off[at] {
                self.off[at] = distance;
                self.labels[at] = number;
            }
        }
    }
}
