//! How the noise about a plane grows with its extent: not at all when it is white, as a power of it
//! where neighbouring points err alike, as in depth images, rings of a sensor, clouds of many views.

use super::regions::Region;
use super::settings::Roughness;
use crate::neighbors::normals::{LocalPlane, MOST as MOST_POINTS};
use crate::neighbors::{Neighbor, PointTree, Search};
use crate::spread::{Moments, Spread, Sums, axes_across, dot};
use crate::{Error, Vector, Workers};

/// Directions of the cuts into two, and parts into which each may cut.
const DIRECTIONS: u32 = 6;
const PARTS: usize = 4;
/// Fits of a plane, each to the points within three median distances of the one before.
const FITS: usize = 3;

/// Whether neighbouring points err alike.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Surfaces {
    /// They do not: the noise about a plane is that of its small parts.
    Smooth,
    /// They do: large planes are less flat than their parts.
    Rough,
}

impl Surfaces {
    /// Those of a cloud of which every `step`-th point has a local plane: told by the lower
    /// quartile of the growth of the noise when flat neighbourhoods become wider.
    ///
    /// # Errors
    /// [`Error::Stopped`] when the caller does not want to go on.
    pub fn of(
        tree: &PointTree,
        local: &[LocalPlane],
        step: usize,
        settings: &Roughness,
        workers: &Workers,
    ) -> Result<Self, Error> {
        let flat: Vec<usize> = (0..local.len()).filter(|&k| local[k].is_flat).collect();
        let mut growth = vec![0.0; flat.len().min(settings.asked)];
        if growth.is_empty() {
            return Ok(Self::Smooth);
        }
        let n_asked = growth.len();
        let mut sizes: Vec<u32> = flat.iter().map(|&k| local[k].size).collect();
        let middle = sizes.len() / 2;
        let size = *sizes.select_nth_unstable(middle).1 as usize;
        workers.fill(&mut growth, 1, Search::default, |search, k, growth| {
            let k = flat[k * flat.len() / n_asked];
            let points = tree.points();
            let wider = (settings.wider * size).min(MOST_POINTS);
            let window = tree.nearest(&points[k * step], wider, search);
            let near = median_distance(points, &window[..size.min(window.len())]);
            let wide = median_distance(points, window);
            let wider = (window.len() as f64 / size as f64).sqrt();
            growth[0] = if near > 0.0 { (wide / near).ln() / wider.ln() } else { 0.0 };
            let window: Vec<&Vector> =
                window.iter().map(|neighbor| &points[neighbor.place as usize]).collect();
            let near = thickness(&window[..size.min(window.len())]);
            let wider = wider / std::f64::consts::SQRT_2;
            if near > 0.0 && wider > settings.narrower {
                growth[0] = growth[0].max((halved(&window) / near).ln() / wider.ln());
            }
        })?;
        let (_, quartile, _) =
            growth.select_nth_unstable_by(n_asked / settings.quartile, f64::total_cmp);
        Ok(if *quartile > settings.rough { Self::Rough } else { Self::Smooth })
    }
}

/// Standard deviation about a plane = level x extent ^ power.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Law {
    power: f64,
    level: f64,
}

impl Law {
    /// White noise.
    pub const WHITE: Self = Self { power: 0.0, level: 0.0 };

    /// The law of a cloud: regression of the logarithms over its regions, weighted by the root of
    /// their points; white when there are too few.
    pub fn of(regions: &[Region], settings: &Roughness) -> Self {
        let telling: Vec<[f64; 3]> = regions
            .iter()
            .filter(|region| region.moments.count >= settings.telling)
            .filter_map(|region| {
                let [thin, middle, _] = region.spread().variances;
                // Nothing is told by what rounding leaves of exact planes, nor by layers of clutter.
                (thin > 1e-10 * middle && settings.thin * thin < middle)
                    .then(|| [middle.ln() / 2.0, thin.ln() / 2.0, region.moments.count.sqrt()])
            })
            .collect();
        if telling.len() < settings.fewest {
            return Self::WHITE;
        }
        let total: f64 = telling.iter().map(|row| row[2]).sum();
        let mean = |k: usize| telling.iter().map(|row| row[2] * row[k]).sum::<f64>() / total;
        let (x, y) = (mean(0), mean(1));
        let product = |k: usize, m: f64| {
            telling.iter().map(|row| row[2] * (row[0] - x) * (row[k] - m)).sum::<f64>()
        };
        let power = (product(1, y) / product(0, x)).min(settings.roughest);
        if power.is_nan() || power <= 0.0 {
            return Self::WHITE;
        }
        Self { power, level: (y - power * x).exp() }
    }

    /// Standard deviation at an `extent`, of a plane that has `sigma` at the extent `own`; where
    /// noise grows, at least what the law tells, since small flat spots are a matter of luck.
    pub fn sigma(&self, sigma: f64, own: f64, extent: f64) -> f64 {
        if self.power == 0.0 || own <= 0.0 {
            return sigma;
        }
        let grown = sigma * (extent / own).max(1.0).powf(self.power);
        grown.max(self.level * extent.powf(self.power))
    }
}

/// Standard deviation about the plane of points.
fn thickness(points: &[&Vector]) -> f64 {
    let n = points.len() as f64;
    let spread = Moments::of(points.iter().copied(), points[0]).spread();
    (spread.variances[0] * n / (n - 3.0).max(1.0)).sqrt()
}

/// The same about the two planes into which the best straight cut parts points: what is left when
/// an edge is between them.
fn halved(points: &[&Vector]) -> f64 {
    let moments = |some: &[(f64, &Vector)]| Moments::of(some.iter().map(|row| row.1), points[0]);
    let whole = Moments::of(points.iter().copied(), points[0]).spread();
    let [first, second] = axes_across(&whole.normal);
    let mut best = f64::INFINITY;
    for k in 0..DIRECTIONS {
        let (sin, cos) = (std::f64::consts::PI * f64::from(k) / f64::from(DIRECTIONS)).sin_cos();
        let along: Vector = std::array::from_fn(|axis| cos * first[axis] + sin * second[axis]);
        let mut at: Vec<(f64, &Vector)> =
            points.iter().map(|&point| (dot(&along, point), point)).collect();
        let ends: [usize; PARTS + 1] = std::array::from_fn(|k| k * at.len() / PARTS);
        for k in 1..PARTS {
            if ends[k] < at.len() {
                at[ends[k - 1]..]
                    .select_nth_unstable_by(ends[k] - ends[k - 1], |a, b| a.0.total_cmp(&b.0));
            }
        }
        let parts: [Moments; PARTS] = std::array::from_fn(|k| moments(&at[ends[k]..ends[k + 1]]));
        for cut in 1..PARTS {
            let squares = |some: &[Moments]| {
                let all = some.iter().fold(Moments::default(), |a, b| b.joined(&a));
                all.spread().variances[0] * all.count
            };
            best = best.min(squares(&parts[..cut]) + squares(&parts[cut..]));
        }
    }
    (best / (points.len() as f64 - 6.0)).sqrt()
}

/// Median distance of points to their plane, whatever a few of them do.
fn median_distance(points: &[Vector], window: &[Neighbor]) -> f64 {
    let own = || window.iter().map(|n| &points[n.place as usize]);
    let mut reach = f64::INFINITY;
    let mut spread: Option<Spread> = None;
    let mut median = 0.0;
    for _ in 0..FITS {
        let mut sums = Sums::new(points[window[0].place as usize]);
        for point in own().filter(|p| spread.is_none_or(|s| s.distance(p).abs() <= reach)) {
            sums.add(point);
        }
        let next = sums.moments().spread();
        let mut distances: Vec<f64> = own().map(|point| next.distance(point).abs()).collect();
        let middle = distances.len() / 2;
        median = *distances.select_nth_unstable_by(middle, f64::total_cmp).1;
        (reach, spread) = (3.0 * median, Some(next));
    }
    // Three of the points' freedoms went into the plane.
    median * (window.len() as f64 / (window.len() as f64 - 3.0).max(1.0)).sqrt()
}
