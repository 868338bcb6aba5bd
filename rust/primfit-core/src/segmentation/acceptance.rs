//! Which regions are planes, and which are points that happen to lie near one.

use super::context::Context;
use super::curvature::{Bend, Heights};
use super::growth::{FEWEST, NOBODY};
use super::regions::{self, Members};
use super::roughness::Surfaces;
use super::settings::Accepting;
use crate::neighbors::normals::FLOOR;
use crate::neighbors::{Neighbor, Search};
use crate::spread::{Moments, Spread};
use crate::{Error, Vector, Workers};

/// Labels of the connected parts that are planes, numbered by falling size, and nothing else.
///
/// # Errors
/// [`Error::Stopped`] when the caller does not want to go on.
pub fn accept(context: &Context, labels: &[i32], workers: &Workers) -> Result<Vec<i32>, Error> {
    accept_parts(context, &regions::components(context.graph, labels), workers)
}

/// The same for parts that are not looked at for being connected.
///
/// # Errors
/// [`Error::Stopped`] when the caller does not want to go on.
pub fn accept_parts(
    context: &Context,
    labels: &[i32],
    workers: &Workers,
) -> Result<Vec<i32>, Error> {
    let &Context { surfaces, settings, .. } = context;
    let regions = context.fit(labels, workers);
    let planes: Vec<(Spread, f64)> = regions
        .iter()
        .map(|region| {
            let spread = region.spread();
            (spread, region.sigma(&spread, surfaces, settings))
        })
        .collect();
    let members = Members::of(labels);
    let usual = Usual::of(&planes, &members, &settings.acceptance);
    let thinnest = if surfaces == Surfaces::Rough { settings.acceptance.thinnest } else { 0.0 };
    let test = Test { context, labels, regions: &regions, planes: &planes, thinnest, usual };
    let mut accepted = vec![false; planes.len()];
    workers.fill(&mut accepted, 1, Search::default, |search, k, accepted| {
        accepted[0] = test.passes(k, members.get(k), search);
    })?;
    let mut order: Vec<usize> = (0..planes.len()).filter(|&k| accepted[k]).collect();
    order.sort_by_key(|&k| std::cmp::Reverse(members.get(k).len()));
    let mut result = vec![NOBODY; labels.len()];
    for (&k, number) in order.iter().zip(0..) {
        for &place in members.get(k) {
            result[place as usize] = number;
        }
    }
    Ok(result)
}

struct Test<'a> {
    context: &'a Context<'a>,
    labels: &'a [i32],
    regions: &'a [regions::Region],
    /// Plane and standard deviation of each label.
    planes: &'a [(Spread, f64)],
    thinnest: f64,
    usual: Usual,
}

impl Test<'_> {
    fn passes(&self, number: usize, places: &[u32], search: &mut Search) -> bool {
        let settings = self.context.settings;
        let (spread, sigma) = &self.planes[number];
        let [thin, middle, long] = spread.variances;
        let flatness = middle / thin.max(FLOOR * FLOOR * long);
        // What is no wider than the noise of most planes is not told from a row of the scan.
        let flatness = flatness.min(middle / self.usual.sigma().powi(2));
        let least = (settings.acceptance.flat_by_chance / places.len() as f64)
            .clamp(settings.acceptance.flat.0, settings.acceptance.flat.1);
        // What is thicker than the noise around its points has to be a plane at first sight.
        let is_slab = thin.sqrt() > settings.acceptance.slab * self.regions[number].local_sigma;
        let least = if is_slab { settings.acceptance.clear } else { least };
        if places.len() < FEWEST || flatness <= least || thin.sqrt() < self.thinnest * sigma {
            return false;
        }
        self.purity(number as i32, places) >= settings.acceptance.purity
            && !self.is_bent(number, places)
            && self.evidence(number, places, search) > settings.acceptance.evidence
    }

    fn purity(&self, label: i32, places: &[u32]) -> f64 {
        let (mut same, mut nobody) = (0, 0);
        for &place in places {
            for &other in self.context.graph.of(place as usize) {
                let other = self.labels[other as usize];
                same += i64::from(other == label);
                nobody += i64::from(other == NOBODY);
            }
        }
        same as f64 / (same + nobody).max(1) as f64
    }

    /// Whether the points bend, and not only by those that planes which they touch explain better:
    /// beyond an edge these lie near the plane, too, if they are few.
    fn is_bent(&self, number: usize, places: &[u32]) -> bool {
        let (points, settings) = (self.context.points(), self.context.settings);
        let (spread, sigma) = &self.planes[number];
        let all = places.iter().map(|&place| &points[place as usize]);
        let Some(bend) = Bend::of(all, spread).filter(|bend| bend.is_clear(&settings.curvature))
        else {
            return false;
        };
        if bend.share <= settings.curvature.explained && !self.is_white(number, places) {
            return false;
        }
        let own = places.iter().filter(|&&place| {
            normal(spread.distance(&points[place as usize]), *sigma)
                >= self.density_of_others(number, place as usize)
        });
        let own: Vec<&Vector> = own.map(|&place| &points[place as usize]).collect();
        if (own.len() as f64) < settings.curvature.mostly * places.len() as f64 {
            return true;
        }
        let spread = Moments::of(own.iter().copied(), own[0]).spread();
        Bend::of(own.into_iter(), &spread)
            .is_none_or(|own| own.turn > settings.curvature.straighter * bend.turn)
    }

    /// Whether distances from the paraboloid of a region's points are those of white noise: means
    /// over neighbourhoods vary no more than their number of points makes them.
    fn is_white(&self, number: usize, places: &[u32]) -> bool {
        let points = self.context.points();
        let mut heights = Heights::over(&self.planes[number].0);
        for &place in places {
            heights.add(&points[place as usize]);
        }
        let Some(surface) = heights.paraboloid() else { return false };
        let off = |place: u32| heights.above(&surface, &points[place as usize]);
        let (mut of_means, mut of_points) = (0.0, 0.0);
        for &place in places {
            let (mut sum, mut count) = (off(place), 1.0);
            for &other in self.context.graph.of(place as usize) {
                if self.labels[other as usize] == number as i32 {
                    sum += off(other);
                    count += 1.0;
                }
            }
            of_means += sum * sum / count;
            of_points += off(place).powi(2);
        }
        of_means < self.context.settings.curvature.white * of_points
    }

    /// Logarithm of the likelihood ratio of points spread normally about the plane to points that
    /// touching planes explain, or that are scattered; less what choosing among all places costs.
    ///
    /// Looked at are its own points and those of no plane, in balls around some of its own.
    fn evidence(&self, number: usize, places: &[u32], search: &mut Search) -> f64 {
        let (points, settings) = (self.context.points(), self.context.settings);
        let (spread, sigma) = &self.planes[number];
        let n_samples = settings.acceptance.samples.min(places.len());
        let mut densities = Vec::new();
        let mut n_own = 0.0;
        let side = settings.acceptance.side;
        let [mut profile, mut alone] = [(); 2].map(|()| Profile::new(side));
        for sample in 0..n_samples {
            let place = places[sample * places.len() / n_samples] as usize;
            let spacing = self.context.graph.reach(place, points);
            let radius = spacing.max(settings.acceptance.far * sigma);
            let close = spacing.max(settings.acceptance.close * sigma);
            let around = self.context.tree.within(&points[place], radius, search);
            let middle = self.local_middle(number, around, close);
            for &Neighbor { place, squared, .. } in around {
                let off = spread.distance(&points[place as usize]);
                let label = self.labels[place as usize];
                if squared <= close * close {
                    profile.add((off - middle) / sigma);
                    if label == number as i32 || label == NOBODY {
                        alone.add((off - middle) / sigma);
                    }
                }
                let mut others = 0.75
                    * (1.0 - (off / radius).powi(2)).max(settings.acceptance.least_density)
                    / radius;
                if label == number as i32 {
                    n_own += 1.0;
                    others = others.max(self.density_of_others(number, place as usize));
                } else if label != NOBODY {
                    continue;
                }
                densities.push(normal(off, *sigma) / others);
            }
        }
        if !profile.has_peak(settings.acceptance.peak)
            || !alone.has_peak(settings.acceptance.peak_alone)
        {
            return f64::NEG_INFINITY;
        }
        let share = (n_own / densities.len() as f64).min(settings.acceptance.most_share);
        let ratio: f64 = densities.iter().map(|ratio| (share * ratio + 1.0 - share).ln()).sum();
        ratio / n_own * places.len() as f64
            - (12.0 * points.len() as f64).ln()
            - self.usual.penalty(*sigma, settings.acceptance.grazed)
    }

    /// Where a plane's own points lie across it within so far, as far as their number tells (the
    /// positive part of the estimator of James and Stein): where errors of neighbours are alike, the
    /// layer wanders to either side of the plane, and a few places do not average that.
    fn local_middle(&self, number: usize, around: &[Neighbor], close: f64) -> f64 {
        let (spread, sigma) = &self.planes[number];
        let (mut sum, mut count) = (0.0, 0.0);
        for &Neighbor { place, squared, .. } in around {
            if squared <= close * close && self.labels[place as usize] == number as i32 {
                sum += spread.distance(&self.context.points()[place as usize]);
                count += 1.0;
            }
        }
        let told = 1.0 - count * (sigma / sum).powi(2);
        if told > 0.0 { told * sum / count } else { 0.0 }
    }

    /// Greatest density of a point by other planes that it touches.
    fn density_of_others(&self, number: usize, place: usize) -> f64 {
        let point: &Vector = &self.context.points()[place];
        let mut last = number as i32;
        let mut greatest: f64 = 0.0;
        for &other in self.context.graph.of(place) {
            let label = self.labels[other as usize];
            if label != last && label != NOBODY && label != number as i32 {
                let (spread, sigma) = &self.planes[label as usize];
                greatest = greatest.max(normal(spread.distance(point), *sigma));
                last = label;
            }
        }
        greatest
    }
}

/// Thickness of the planes of a cloud: one sensor saw them all.
#[derive(Debug, Clone, Copy)]
struct Usual {
    /// Mean and standard deviation of the logarithm; None when too few tell.
    log: Option<(f64, f64)>,
}

impl Usual {
    /// Of the planes that are clearly flat, by their points: robust, since clutter is among them.
    fn of(planes: &[(Spread, f64)], members: &Members, settings: &Accepting) -> Self {
        let mut telling: Vec<(f64, f64)> = planes
            .iter()
            .enumerate()
            .map(|(k, plane)| (plane, members.get(k).len() as f64))
            .filter(|((spread, sigma), _)| spread.variances[1] > settings.clear * sigma * sigma)
            .map(|((_, sigma), count)| (sigma.ln(), count))
            .collect();
        if telling.is_empty() {
            return Self { log: None };
        }
        let middle = weighted_median(&mut telling);
        let mut off: Vec<(f64, f64)> =
            telling.iter().map(|(log, weight)| ((log - middle).abs(), *weight)).collect();
        Self { log: Some((middle, (1.4826 * weighted_median(&mut off)).max(settings.alike))) }
    }

    /// Standard deviation of most planes; 0 when it is not known.
    fn sigma(&self) -> f64 {
        self.log.map_or(0.0, |(middle, _)| middle.exp())
    }

    /// Minus the logarithm of how probable a plane so thick is beside the others.
    fn penalty(&self, sigma: f64, grazed: f64) -> f64 {
        self.log.map_or(0.0, |(middle, spread)| {
            let off = (sigma.ln() - middle) / spread;
            let off = if off < 0.0 { grazed * off } else { off };
            off * off / 2.0
        })
    }
}

/// Median of values with weights.
fn weighted_median(rows: &mut [(f64, f64)]) -> f64 {
    rows.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    let half = rows.iter().map(|row| row.1).sum::<f64>() / 2.0;
    let mut sum = 0.0;
    for &(value, weight) in rows.iter() {
        sum += weight;
        if sum >= half {
            return value;
        }
    }
    0.0
}

/// Density of a normal distribution.
fn normal(off: f64, sigma: f64) -> f64 {
    (-0.5 * (off / sigma).powi(2)).exp() / (sigma * std::f64::consts::TAU.sqrt())
}

/// How many points lie on a plane, and on either side.
struct Profile {
    /// Standard deviations at which the sides begin and end.
    side: (f64, f64),
    core: f64,
    sides: [f64; 2],
}

impl Profile {
    fn new(side: (f64, f64)) -> Self {
        Self { side, core: 0.0, sides: [0.0; 2] }
    }

    /// A point so many standard deviations off.
    fn add(&mut self, off: f64) {
        if off.abs() <= 1.0 {
            self.core += 1.0;
        } else if off.abs() > self.side.0 && off.abs() <= self.side.1 {
            self.sides[usize::from(off > 0.0)] += 1.0;
        }
    }

    fn has_peak(&self, times: f64) -> bool {
        self.core / 2.0 > times * self.sides[0].max(self.sides[1]) / (self.side.1 - self.side.0)
    }
}
