//! First surfaces: of each kind, at several scales, around many points.

use super::cloud::{Cloud, Sample};
use super::growing::NOBODY;
use super::surface::{Kind, Surface};
use super::vectors::dot;
use crate::neighbors::{PointTree, Search};
use crate::{Error, Workers};

/// Nearest points that a first surface is fitted to.
const SIZES: [usize; 4] = [32, 96, 256, 512];
/// Points beyond which every second, third ... is fitted.
const MOST_FITTED: usize = 256;
/// Mean square misfit up to which a neighbourhood is explained: 1.2 standard deviations.
pub const EXPLAINED: f64 = 1.44;
/// Angle by which normals of neighbours may turn for a ball to be smooth, radians, and standard
/// deviations of both.
const SMOOTH: f64 = 0.2;
const NORMAL_ERRORS: f64 = 2.5;

/// Where a surface may grow from.
#[derive(Clone, Default)]
pub struct Seed {
    pub place: u32,
    /// Points that are explained, fewer of them the farther behind the seed comes.
    pub start: Vec<u32>,
    /// Mean square misfit of the best kind.
    pub misfit: f64,
    /// The surfaces of all kinds through them.
    pub surfaces: Vec<Surface>,
}

/// Hypotheses around places through free points, those that explain most points first.
///
/// # Errors
/// [`Error::Stopped`] when the caller does not want to go on.
pub fn hypotheses(
    tree: &PointTree,
    cloud: &Cloud,
    labels: &[i32],
    places: &[u32],
    workers: &Workers,
) -> Result<Vec<Seed>, Error> {
    let mut seeds = vec![Seed::default(); places.len()];
    workers.fill(&mut seeds, 1, Search::default, |search, i, seed| {
        let place = places[i];
        let near = tree.nearest(&cloud.points[place as usize], SIZES[SIZES.len() - 1], search);
        let near: Vec<u32> = near.iter().map(|other| other.place).collect();
        let mut largest = None;
        for size in SIZES {
            let some = near[..size.min(near.len())].iter().copied();
            let start: Vec<u32> = some.filter(|&other| labels[other as usize] == NOBODY).collect();
            if 2 * start.len() < size {
                break;
            }
            let first = AtScale::new(cloud, start, EXPLAINED);
            // Larger neighbourhoods hold this one.
            let Some(first) = first else { break };
            largest = Some(first);
            if size >= near.len() {
                break;
            }
        }
        if let Some(largest) = largest {
            seed[0] = largest.seed(place);
        }
    })?;
    Ok(ranked(seeds))
}

/// Points that some kind explains, with the kinds that were looked at to know it.
struct AtScale {
    start: Vec<u32>,
    sample: Sample,
    misfit: f64,
    surfaces: Vec<Surface>,
    n_tried: usize,
}

impl AtScale {
    /// Kinds through some points up to the first that explains them; None where none does.
    fn new(cloud: &Cloud, start: Vec<u32>, explained: f64) -> Option<Self> {
        let sample = cloud.sample(&start, MOST_FITTED);
        let mut found =
            Self { start, sample, misfit: f64::INFINITY, surfaces: Vec::new(), n_tried: 0 };
        while found.misfit > explained {
            found.add(*Kind::ALL.get(found.n_tried)?);
        }
        Some(found)
    }

    fn add(&mut self, kind: Kind) {
        self.n_tried += 1;
        let Some(surface) = self.sample.fitted(kind, None) else { return };
        self.misfit = self.misfit.min(self.sample.misfit(&surface));
        self.surfaces.push(surface);
    }

    /// With all kinds.
    fn seed(mut self, place: u32) -> Seed {
        for kind in &Kind::ALL[self.n_tried..] {
            self.add(*kind);
        }
        let Self { start, misfit, surfaces, .. } = self;
        Seed { place, start, misfit, surfaces }
    }
}

/// Hypotheses around free places over smooth balls of free points: across no edge.
///
/// # Errors
/// [`Error::Stopped`] when the caller does not want to go on.
pub fn smooth_hypotheses(
    cloud: &Cloud,
    labels: &[i32],
    places: &[u32],
    size: usize,
    explained: f64,
    workers: &Workers,
) -> Result<Vec<Seed>, Error> {
    let mut seeds = vec![Seed::default(); places.len()];
    workers.fill(
        &mut seeds,
        1,
        || vec![u32::MAX; labels.len()],
        |seen, i, seed| {
            let ball = smooth_ball(cloud, labels, places[i], size, seen);
            if ball.len() >= SIZES[0].min(size) {
                let found = AtScale::new(cloud, ball, explained);
                seed[0] = found.map(|found| found.seed(places[i])).unwrap_or_default();
            }
        },
    )?;
    Ok(ranked(seeds))
}

/// Free points about a place, breadth first, where normals turn slowly.
fn smooth_ball(
    cloud: &Cloud,
    labels: &[i32],
    place: u32,
    size: usize,
    seen: &mut [u32],
) -> Vec<u32> {
    let mut ball = vec![place];
    seen[place as usize] = place;
    let mut next = 0;
    while let Some(&at) = ball.get(next) {
        next += 1;
        for &other in cloud.graph.of(at as usize) {
            let (a, b) = (at as usize, other as usize);
            if ball.len() >= size {
                return ball;
            }
            if seen[b] == place || labels[b] != NOBODY {
                continue;
            }
            let error = (cloud.errors[a].powi(2) + cloud.errors[b].powi(2)).sqrt();
            let limit = SMOOTH + NORMAL_ERRORS * error;
            if dot(&cloud.normals[a], &cloud.normals[b]).abs() >= 1.0 - 0.5 * limit * limit {
                seen[b] = place;
                ball.push(other);
            }
        }
    }
    ball
}

/// Those that explain something: the most points first, then the best; alike in the order of places.
fn ranked(mut seeds: Vec<Seed>) -> Vec<Seed> {
    seeds.retain(|seed| !seed.surfaces.is_empty());
    seeds.sort_by(|a, b| {
        let by_size = b.start.len().cmp(&a.start.len());
        by_size.then(a.misfit.total_cmp(&b.misfit)).then(a.place.cmp(&b.place))
    });
    seeds
}
