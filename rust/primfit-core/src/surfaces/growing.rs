//! A surface that takes what touches it, and which kind explains what all kinds took.

use super::cloud::{Cloud, FAR, square};
use super::surface::{Kind, Surface};
use super::vectors::dot;
use crate::neighbors::squared_distance;

/// Label of a point without a surface.
pub const NOBODY: i32 = -1;
/// Standard deviations within which a surface takes a point.
const TAKE: f64 = 3.0;
/// Angle between the normals of a point and of the surface within which it takes it, radians: what a
/// patch of this size may bend, what the normal may err, and at most.
const ALONG: f64 = 0.25;
const NORMAL_ERRORS: f64 = 2.5;
const MOST_ALONG: f64 = 0.7;
/// Growth of the ball about the seed from one fit to the next: never far extrapolation.
const WIDER: f64 = 1.7;
/// Rounds of growth, which end once the ball holds all that the surface takes.
const ROUNDS: usize = 24;
/// Points that a surface is fitted to while it grows, which carries the next ball at a tenth of a
/// standard deviation, and at the end.
const MOST_GROWING: usize = 500;
const MOST_FITTED: usize = 1500;
/// What a point costs that a kind does not take but another does.
const MISSED: f64 = 10.0;
/// What a parameter has to gain beyond its price, and what each point has to.
const PER_PARAMETER: f64 = 3.0;
const PER_POINT: f64 = 0.004;
/// The same for what is a plane otherwise: flat parts are not flat to the noise, and their noise is
/// not white.
const PER_POINT_OF_PLANE: f64 = 0.03;
const PER_LOG_OF_PLANE: f64 = 3.0;

/// A surface and the points that it takes.
#[derive(Clone)]
pub struct Grown {
    pub surface: Surface,
    /// Places, in the order in which they were taken.
    pub members: Vec<u32>,
}

/// What the growth of one kind reuses.
pub struct Flood {
    seen: Vec<u32>,
    round: u32,
}

impl Flood {
    pub fn new(n: usize) -> Self {
        Self { seen: vec![0; n], round: 0 }
    }

    /// Grows a surface from some points around a seed over those of a cloud that have no label.
    pub fn grow(
        &mut self,
        cloud: &Cloud,
        labels: &[i32],
        seed: u32,
        start: &[u32],
        first: Surface,
    ) -> Option<Grown> {
        let at = &cloud.points[seed as usize];
        let far = |place: &u32| squared_distance(at, &cloud.points[*place as usize]);
        let mut reach = start.iter().map(far).fold(0.0, f64::max);
        let mut surface = first;
        let mut members: Vec<u32> = Vec::new();
        for _ in 0..ROUNDS {
            let n_before = members.len();
            let is_cut = self.take(cloud, labels, start, &surface, (at, reach), &mut members);
            if members.len() <= surface.kind.n_parameters() {
                return None;
            }
            if !is_cut && members.len() <= n_before + n_before / 50 {
                break;
            }
            let sample = cloud.sample(&members, MOST_GROWING);
            surface = sample.fitted(surface.kind, Some(surface))?;
            reach *= WIDER * WIDER;
        }
        let sample = cloud.sample(&members, MOST_FITTED);
        surface = sample.fitted(surface.kind, Some(surface))?;
        Some(Grown { surface, members })
    }

    /// Takes what touches; whether the ball cut something off.
    fn take(
        &mut self,
        cloud: &Cloud,
        labels: &[i32],
        start: &[u32],
        surface: &Surface,
        ball: (&[f64; 3], f64),
        members: &mut Vec<u32>,
    ) -> bool {
        self.round += 1;
        members.clear();
        let is_taken = |place: usize| {
            let (point, sigma) = (&cloud.points[place], cloud.sigma[place]);
            let at = surface.sight(point);
            let limit = (ALONG + NORMAL_ERRORS * cloud.errors[place]).min(MOST_ALONG);
            at.distance.abs() <= TAKE * sigma
                && !surface.is_beyond_apex(&at)
                && dot(&at.normal, &cloud.normals[place]).abs() >= 1.0 - 0.5 * limit * limit
        };
        for &place in start {
            if labels[place as usize] == NOBODY && is_taken(place as usize) {
                self.seen[place as usize] = self.round;
                members.push(place);
            }
        }
        let mut is_cut = false;
        let mut next = 0;
        while let Some(&place) = members.get(next) {
            next += 1;
            for &other in cloud.graph.of(place as usize) {
                let other_place = other as usize;
                if self.seen[other_place] == self.round || labels[other_place] != NOBODY {
                    continue;
                }
                self.seen[other_place] = self.round;
                if !is_taken(other_place) {
                    continue;
                }
                if squared_distance(ball.0, &cloud.points[other_place]) > ball.1 {
                    is_cut = true;
                    continue;
                }
                members.push(other);
            }
        }
        is_cut
    }
}

/// The kind that explains best what any of them took; kinds come with fewer parameters first.
pub fn best_of(cloud: &Cloud, grown: Vec<Grown>) -> Option<Grown> {
    let mut union: Vec<u32> = grown.iter().flat_map(|one| one.members.iter().copied()).collect();
    union.sort_unstable();
    union.dedup();
    let n = union.len() as f64;
    let mut best: Option<(f64, Grown)> = None;
    for mut one in grown {
        one.members.sort_unstable();
        let squares = one.members.iter().map(|&place| {
            let place = place as usize;
            square(&one.surface, &cloud.points[place], cloud.sigma[place]).min(FAR)
        });
        let missed = n - one.members.len() as f64;
        let cost = squares.sum::<f64>() + MISSED * missed;
        best = Some(match best {
            Some(best)
                if best.0 - cost < worth(best.1.surface.kind, one.surface.kind, n, cloud.area) =>
            {
                best
            }
            _ => (cost, one),
        });
    }
    best.map(|best| best.1)
}

/// By how much the sum of squares of `n` points, of which as many as `area` err as one, has to fall
/// for a kind in place of one with fewer parameters: what chance lets it fall by grows with the area.
pub fn worth(simpler: Kind, kind: Kind, n: f64, area: f64) -> f64 {
    let n_more = kind.n_parameters() as f64 - simpler.n_parameters() as f64;
    let plain = n_more * area * (n.ln() + PER_PARAMETER) + PER_POINT * n;
    if simpler == Kind::Plane {
        plain + PER_POINT_OF_PLANE * n + PER_LOG_OF_PLANE * area * n.ln()
    } else {
        plain
    }
}
