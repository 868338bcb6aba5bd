//! Planes as sets of labelled points: fit, competition for points, merging, components.

use super::context::Context;
use super::graph::Graph;
use super::growth::NOBODY;
use super::roughness::Surfaces;
use super::settings::{Competing, Settings};
use crate::neighbors::normals::FLOOR;
use crate::spread::{Moments, Spread};
use crate::{Error, Vector, Workers};
use rayon::prelude::{IntoParallelRefIterator, ParallelIterator};

/// A plane and the points that carry its label.
#[derive(Debug, Clone, Copy, Default)]
pub struct Region {
    /// Moments of its points.
    pub moments: Moments,
    /// Median of the noise of its points.
    pub local_sigma: f64,
}

impl Region {
    /// Its plane.
    pub fn spread(&self) -> Spread {
        self.moments.spread()
    }

    /// Standard deviation about its plane: not less than the noise of its points, nor than what
    /// rounding leaves; not much more where surfaces are smooth.
    pub fn sigma(&self, spread: &Spread, surfaces: Surfaces, settings: &Settings) -> f64 {
        let floor = (FLOOR * spread.variances[2].sqrt()).max(f64::MIN_POSITIVE);
        let least = self.local_sigma.max(floor);
        let most = match surfaces {
            Surfaces::Smooth => settings.competition.slack * least,
            Surfaces::Rough => f64::INFINITY,
        };
        spread.variances[0].sqrt().clamp(least, most)
    }
}

/// Points sorted by label.
pub struct Members {
    places: Vec<u32>,
    starts: Vec<usize>,
}

impl Members {
    /// Of labels from 0, or [`NOBODY`].
    pub fn of(labels: &[i32]) -> Self {
        let n = labels.iter().max().map_or(0, |&most| (most + 1) as usize);
        let mut starts = vec![0; n + 1];
        for &label in labels.iter().filter(|&&label| label != NOBODY) {
            starts[label as usize + 1] += 1;
        }
        for k in 0..n {
            starts[k + 1] += starts[k];
        }
        let mut next = starts.clone();
        let mut places = vec![0; starts[n]];
        for (&label, place) in labels.iter().zip(0..).filter(|(label, _)| **label != NOBODY) {
            places[next[label as usize]] = place;
            next[label as usize] += 1;
        }
        Self { places, starts }
    }

    /// Number of labels.
    pub fn len(&self) -> usize {
        self.starts.len() - 1
    }

    /// Points of a label, rising.
    pub fn get(&self, label: usize) -> &[u32] {
        &self.places[self.starts[label]..self.starts[label + 1]]
    }
}

/// The plane of each label.
pub fn fit(points: &[Vector], noise: &[f32], labels: &[i32], workers: &Workers) -> Vec<Region> {
    let members = Members::of(labels);
    let numbers: Vec<usize> = (0..members.len()).collect();
    workers.install(|| {
        numbers
            .par_iter()
            .map(|&label| {
                let places = members.get(label);
                let Some(&first) = places.first() else { return Region::default() };
                let origin = points[first as usize];
                let own = places.iter().map(|&place| &points[place as usize]);
                let mut noise: Vec<f32> =
                    places.iter().map(|&place| noise[place as usize]).collect();
                let (_, &mut local_sigma, _) =
                    noise.select_nth_unstable_by(places.len() / 2, f32::total_cmp);
                Region { moments: Moments::of(own, &origin), local_sigma: f64::from(local_sigma) }
            })
            .collect()
    })
}

/// One sweep of competition: each point takes the best label among its neighbours', or none. All
/// points look at the old labels.
///
/// # Errors
/// [`Error::Stopped`] when the caller does not want to go on.
pub fn compete(context: &Context, labels: &[i32], workers: &Workers) -> Result<Vec<i32>, Error> {
    let &Context { graph, surfaces, settings, .. } = context;
    let points = context.points();
    let competition =
        Competition::new(&context.fit(labels, workers), surfaces, settings, graph.most());
    let mut next = vec![NOBODY; labels.len()];
    workers.fill(&mut next, 1, Vec::new, |counts, i, best| {
        let labels = graph.of(i).iter().map(|&other| labels[other as usize]);
        best[0] = competition.best(&points[i], labels, || graph.log_room(i), counts);
    })?;
    Ok(next)
}

/// Planes that compete for points.
///
/// The score is the logarithm of the likelihood of a point's distance, plus that of the share of
/// its neighbours with the label (an auto-logistic prior); without a plane, a point may be anywhere
/// within its neighbourhood.
pub struct Competition {
    /// Each plane with its standard deviation, and the logarithm of its normal density's inverse peak.
    planes: Vec<(Spread, f64, f64)>,
    shares: Shares,
    reach: f64,
}

impl Competition {
    /// Of planes for points with up to `most` neighbours.
    pub fn new(regions: &[Region], surfaces: Surfaces, settings: &Settings, most: usize) -> Self {
        let planes = regions
            .iter()
            .map(|region| {
                let spread = region.spread();
                let sigma = region.sigma(&spread, surfaces, settings);
                (spread, sigma, (sigma * std::f64::consts::TAU.sqrt()).ln())
            })
            .collect();
        let Competing { share, reach, .. } = settings.competition;
        Self { planes, shares: Shares::new(most, share), reach }
    }

    /// The best label for a point among those of its neighbours, or [`NOBODY`]; `log_room` is the
    /// logarithm of how wide its neighbourhood is.
    #[inline]
    pub fn best(
        &self,
        point: &Vector,
        neighbors: impl ExactSizeIterator<Item = i32>,
        log_room: impl FnOnce() -> f64,
        counts: &mut Vec<(i32, u32)>,
    ) -> i32 {
        let n_neighbors = neighbors.len();
        count(neighbors, counts);
        let nobody = match *counts.as_slice() {
            [(NOBODY, _)] => return NOBODY,
            [(NOBODY, count), ..] => count,
            _ => 0,
        };
        let log_share = |count| self.shares.log(count, n_neighbors);
        let mut best = NOBODY;
        let mut best_score = log_share(nobody) - log_room();
        for &(label, count) in counts.iter().filter(|entry| entry.0 != NOBODY) {
            let (spread, sigma, log_sigma) = &self.planes[label as usize];
            let distance = spread.distance(point) / sigma;
            let score = log_share(count) - (distance * distance / 2.0 + log_sigma);
            if distance.abs() <= self.reach && score > best_score {
                best_score = score;
                best = label;
            }
        }
        best
    }
}

/// How often each label comes, by rising label.
#[inline]
fn count(labels: impl Iterator<Item = i32>, counts: &mut Vec<(i32, u32)>) {
    counts.clear();
    // Most labels are the one before again.
    let mut last = (NOBODY, 0);
    let mut add = |(label, n): (i32, u32)| match counts.iter_mut().find(|entry| entry.0 == label) {
        Some(entry) => entry.1 += n,
        None => counts.push((label, n)),
    };
    for label in labels {
        if label != last.0 {
            if last.1 > 0 {
                add(last);
            }
            last = (label, 0);
        }
        last.1 += 1;
    }
    add(last);
    counts.sort_unstable();
}

/// Logarithms of the shares of neighbours that a label counts with.
struct Shares {
    most: usize,
    logs: Vec<f64>,
}

impl Shares {
    /// Among up to `most` neighbours, each at least `least`.
    fn new(most: usize, least: f64) -> Self {
        let log = |place: usize| {
            let (of_all, count) = (place / (most + 1), place % (most + 1));
            (count as f64 / of_all as f64 + least).ln()
        };
        Self { most, logs: (0..(most + 1).pow(2)).map(log).collect() }
    }

    fn log(&self, count: u32, of_all: usize) -> f64 {
        self.logs[of_all * (self.most + 1) + count as usize]
    }
}

/// The labels with each connected part its own, numbered by their first points.
pub fn components(graph: &Graph, labels: &[i32]) -> Vec<i32> {
    components_by(graph, labels, |_, _| true)
}

/// The same along edges that join.
pub fn components_by(
    graph: &Graph,
    labels: &[i32],
    is_joined: impl Fn(usize, usize) -> bool,
) -> Vec<i32> {
    let mut parent: Vec<u32> = (0..labels.len() as u32).collect();
    for (i, &label) in labels.iter().enumerate().filter(|(_, label)| **label != NOBODY) {
        for &other in graph.of(i) {
            if labels[other as usize] == label
                && is_joined(i, other as usize)
                && parent[i] != parent[other as usize]
            {
                let (a, b) = (root(&mut parent, i as u32), root(&mut parent, other));
                parent[a.max(b) as usize] = a.min(b);
            }
        }
    }
    let mut numbers = vec![NOBODY; labels.len()];
    let mut n = 0;
    let mut parts = vec![NOBODY; labels.len()];
    for i in 0..labels.len() {
        if labels[i] == NOBODY {
            continue;
        }
        let first = root(&mut parent, i as u32) as usize;
        if numbers[first] == NOBODY {
            numbers[first] = n;
            n += 1;
        }
        parts[i] = numbers[first];
    }
    parts
}

fn root(parent: &mut [u32], mut i: u32) -> u32 {
    while parent[i as usize] != i {
        parent[i as usize] = parent[parent[i as usize] as usize];
        i = parent[i as usize];
    }
    i
}
