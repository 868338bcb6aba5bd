//! Planes that are two: cut where two planes explain much more.

use super::context::Context;
use super::merging::Freedom;
use super::regions::{Members, Region};
use super::roughness::Surfaces;
use super::settings::Merging;
use crate::spread::{Moments, Spread, Sums, axes_across, dot};
use crate::{Vector, Workers};
use rayon::prelude::{IntoParallelIterator, ParallelIterator};

/// Directions of straight cuts that are tried, and cosine and sine from one to the next.
const DIRECTIONS: usize = 12;
const STEP: [f64; 2] = [0.965_925_826_289_068_3, 0.258_819_045_102_520_74];
/// Fewest points on either side.
const FEWEST: f64 = 10.0;

/// A straight cut: points whose product with `along` is greater than `at` are the second part.
#[derive(Debug, Clone, Copy)]
struct Cut {
    along: Vector,
    at: f64,
}

/// New labels after cutting each region that two planes explain better, at the price of smooth
/// surfaces: what is one on rough ones is put together again.
pub fn split(context: &Context, labels: &[i32], workers: &Workers) -> Vec<i32> {
    let (points, regions) = (context.points(), context.fit(labels, workers));
    let freedom = Freedom::of(Surfaces::Smooth, &regions, context.settings);
    let members = Members::of(labels);
    let cuts: Vec<Option<Cut>> = workers.install(|| {
        (0..regions.len())
            .into_par_iter()
            .map(|k| {
                let (places, spread) = (members.get(k), regions[k].spread());
                best_cut(points, places, &regions[k], &spread, freedom, &context.settings.merging)
            })
            .collect()
    });
    let mut labels = labels.to_vec();
    let mut next = regions.len() as i32;
    for (k, cut) in cuts.iter().enumerate() {
        let Some(Cut { along, at }) = cut else { continue };
        for &place in members.get(k) {
            if dot(along, &points[place as usize]) > *at {
                labels[place as usize] = next;
            }
        }
        next += 1;
    }
    labels
}

fn best_cut(
    points: &[Vector],
    places: &[u32],
    region: &Region,
    spread: &Spread,
    freedom: Freedom,
    settings: &Merging,
) -> Option<Cut> {
    if (places.len() as f64) < 2.0 * FEWEST {
        return None;
    }
    let variance = freedom.variance([(region, spread); 2], spread);
    let count = region.moments.count;
    let squares = spread.variances[0] * count;
    if squares / variance - count < freedom.worth([count - FEWEST, FEWEST]) {
        return None;
    }
    let step = places.len().div_ceil(settings.looked_at);
    let some: Vec<&Vector> =
        places.iter().step_by(step).map(|&place| &points[place as usize]).collect();
    let scale = count / some.len() as f64;
    let all = Moments::of(some.iter().copied(), some[0]);
    let squares = all.spread().variances[0] * all.count;
    let mut best = None;
    let mut best_gain = 0.0;
    let [mut along, mut across] = axes_across(&spread.normal);
    for _ in 0..DIRECTIONS {
        let (before, [cos, sin]) = (along, STEP);
        along = std::array::from_fn(|k| cos * before[k] + sin * across[k]);
        across = std::array::from_fn(|k| cos * across[k] - sin * before[k]);
        let Some(slices) = Slices::of(&some, &along, &spread.mean, settings.bins) else { continue };
        for (at, parts) in slices.cuts() {
            let counts = parts.map(|part| part.count * scale);
            if counts[0] < FEWEST || counts[1] < FEWEST {
                continue;
            }
            let [before, after] = parts.map(|part| part.spread().variances[0] * part.count);
            let fall = scale * (squares - before - after);
            let gain = fall / variance - freedom.worth(counts);
            if gain > best_gain {
                best_gain = gain;
                best = Some(Cut { along, at });
            }
        }
    }
    best
}

/// Points sorted into slices of one width along a direction.
struct Slices {
    low: f64,
    width: f64,
    /// Moments of each slice.
    moments: Vec<Moments>,
}

impl Slices {
    /// None of points without extent along it.
    fn of(points: &[&Vector], along: &Vector, origin: &Vector, n: usize) -> Option<Self> {
        let places: Vec<f64> = points.iter().map(|point| dot(along, point)).collect();
        let low = places.iter().copied().fold(f64::INFINITY, f64::min);
        let width = (places.iter().copied().fold(f64::NEG_INFINITY, f64::max) - low) / n as f64;
        if width <= 0.0 {
            return None;
        }
        let mut sums = vec![Sums::new(*origin); n];
        for (place, point) in places.iter().zip(points) {
            sums[(((place - low) / width) as usize).min(n - 1)].add(point);
        }
        Some(Self { low, width, moments: sums.iter().map(Sums::moments).collect() })
    }

    /// Where one slice ends and the next begins, and what is before and after.
    fn cuts(&self) -> impl Iterator<Item = (f64, [Moments; 2])> {
        let n = self.moments.len();
        let mut after = vec![Moments::default(); n + 1];
        for k in (0..n).rev() {
            after[k] = self.moments[k].joined(&after[k + 1]);
        }
        let mut before = Moments::default();
        (1..n).map(move |k| {
            before = before.joined(&self.moments[k - 1]);
            (self.low + k as f64 * self.width, [before, after[k]])
        })
    }
}
