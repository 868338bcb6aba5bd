//! Which regions are planes, and which are points that happen to lie near one.

use super::curvature::Bend;
use super::graph::Graph;
use super::growth::{FEWEST, NOBODY};
use super::regions::{self, Members};
use super::roughness::Surfaces;
use crate::neighbors::normals::FLOOR;
use crate::neighbors::{Neighbor, PointTree, Search};
use crate::spread::{Moments, Spread};
use crate::{Error, Vector, Workers};

/// Least share of the labelled neighbours among the neighbours with this label or none.
const PURITY: f64 = 0.5;
/// Least logarithm of the likelihood ratio of a plane to scattered points.
const EVIDENCE: f64 = 5.0;
/// Standard deviation of a plane on rough surfaces, as a share of its points' noise, below which it
/// is no plane but one row of the scan, whose beams spread in a plane of their own.
const THINNEST: f64 = 1.0 / 3.0;
/// Points of a plane around which it is compared with scattered ones.
const SAMPLES: usize = 16;
/// How much denser the points must lie on the plane than on its denser side: 8 times in a Gaussian
/// layer, as dense in a filled volume, even at its faces.
const PEAK: f64 = 1.5;
const SIDE: (f64, f64) = (1.5, 3.0);
/// Largest share of a plane's own points among those around it, since more is not known.
const MOST_SHARE: f64 = 0.99;
/// Least density of scattered points at the rim of a ball, as a share of that in its middle.
const LEAST_DENSITY: f64 = 0.01;
/// Standard deviations within which scattered points are looked for, and within which the profile
/// of a plane is.
const FAR: f64 = 10.0;
const CLOSE: f64 = 4.0;
/// Least share of the points of a plane that bends only with those of others.
const MOSTLY: f64 = 0.75;
/// How much less its own points turn.
const STRAIGHTER: f64 = 0.6;
/// Second smallest over smallest variance of a plane, more when it is of few points.
const FLAT: (f64, f64) = (2.0, 6.0);
const FLAT_BY_CHANCE: f64 = 288.0;

/// Labels of the connected parts that are planes, numbered by falling size, and nothing else.
///
/// # Errors
/// [`Error::Stopped`] when the caller does not want to go on.
pub fn accept(
    tree: &PointTree,
    graph: &Graph,
    noise: &[f32],
    labels: &[i32],
    surfaces: Surfaces,
    workers: &Workers,
) -> Result<Vec<i32>, Error> {
    let labels = regions::components(graph, labels);
    let planes: Vec<(Spread, f64)> = regions::fit(tree.points(), noise, &labels, workers)
        .iter()
        .map(|region| {
            let spread = region.spread();
            (spread, region.sigma(&spread, surfaces))
        })
        .collect();
    let members = Members::of(&labels);
    let thinnest = if surfaces == Surfaces::Rough { THINNEST } else { 0.0 };
    let test = Test { tree, graph, labels: &labels, planes: &planes, thinnest };
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
    tree: &'a PointTree,
    graph: &'a Graph,
    labels: &'a [i32],
    /// Plane and standard deviation of each label.
    planes: &'a [(Spread, f64)],
    thinnest: f64,
}

impl Test<'_> {
    fn passes(&self, number: usize, places: &[u32], search: &mut Search) -> bool {
        let (spread, sigma) = &self.planes[number];
        let [thin, middle, long] = spread.variances;
        let flatness = middle / thin.max(FLOOR * FLOOR * long);
        let least = (FLAT_BY_CHANCE / places.len() as f64).clamp(FLAT.0, FLAT.1);
        if places.len() < FEWEST || flatness <= least || thin.sqrt() < self.thinnest * sigma {
            return false;
        }
        self.purity(number as i32, places) >= PURITY
            && !self.is_bent(number, places)
            && self.evidence(number, places, search) > EVIDENCE
    }

    fn purity(&self, label: i32, places: &[u32]) -> f64 {
        let (mut same, mut nobody) = (0, 0);
        for &place in places {
            for &other in self.graph.of(place as usize) {
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
        let points = self.tree.points();
        let (spread, sigma) = &self.planes[number];
        let all = places.iter().map(|&place| &points[place as usize]);
        let Some(bend) = Bend::of(all, spread).filter(Bend::is_clear) else { return false };
        let own = places.iter().filter(|&&place| {
            normal(spread.distance(&points[place as usize]), *sigma)
                >= self.density_of_others(number, place as usize)
        });
        let own: Vec<&Vector> = own.map(|&place| &points[place as usize]).collect();
        if (own.len() as f64) < MOSTLY * places.len() as f64 {
            return true;
        }
        let spread = Moments::of(own.iter().copied(), own[0]).spread();
        Bend::of(own.into_iter(), &spread).is_none_or(|own| own.turn > STRAIGHTER * bend.turn)
    }

    /// Logarithm of the likelihood ratio of points spread normally about the plane to points that
    /// touching planes explain, or that are scattered; less what choosing among all places costs.
    ///
    /// Looked at are its own points and those of no plane, in balls around some of its own.
    fn evidence(&self, number: usize, places: &[u32], search: &mut Search) -> f64 {
        let points = self.tree.points();
        let (spread, sigma) = &self.planes[number];
        let n_samples = SAMPLES.min(places.len());
        let mut densities = Vec::new();
        let mut n_own = 0.0;
        let mut profile = Profile::default();
        for sample in 0..n_samples {
            let place = places[sample * places.len() / n_samples] as usize;
            let spacing = self.graph.reach(place, points);
            let radius = spacing.max(FAR * sigma);
            let close = spacing.max(CLOSE * sigma);
            for &Neighbor { place, squared, .. } in self.tree.within(&points[place], radius, search)
            {
                let off = spread.distance(&points[place as usize]);
                if squared <= close * close {
                    profile.add(off / sigma);
                }
                let label = self.labels[place as usize];
                let mut others = 0.75 * (1.0 - (off / radius).powi(2)).max(LEAST_DENSITY) / radius;
                if label == number as i32 {
                    n_own += 1.0;
                    others = others.max(self.density_of_others(number, place as usize));
                } else if label != NOBODY {
                    continue;
                }
                densities.push(normal(off, *sigma) / others);
            }
        }
        if !profile.has_peak() {
            return f64::NEG_INFINITY;
        }
        let share = (n_own / densities.len() as f64).min(MOST_SHARE);
        let ratio: f64 = densities.iter().map(|ratio| (share * ratio + 1.0 - share).ln()).sum();
        ratio / n_own * places.len() as f64 - (12.0 * points.len() as f64).ln()
    }

    /// Greatest density of a point by other planes that it touches.
    fn density_of_others(&self, number: usize, place: usize) -> f64 {
        let point: &Vector = &self.tree.points()[place];
        let mut last = number as i32;
        let mut greatest: f64 = 0.0;
        for &other in self.graph.of(place) {
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

/// Density of a normal distribution.
fn normal(off: f64, sigma: f64) -> f64 {
    (-0.5 * (off / sigma).powi(2)).exp() / (sigma * std::f64::consts::TAU.sqrt())
}

/// How many points lie on a plane, and on either side.
#[derive(Default)]
struct Profile {
    core: f64,
    sides: [f64; 2],
}

impl Profile {
    /// A point so many standard deviations off.
    fn add(&mut self, off: f64) {
        if off.abs() <= 1.0 {
            self.core += 1.0;
        } else if off.abs() > SIDE.0 && off.abs() <= SIDE.1 {
            self.sides[usize::from(off > 0.0)] += 1.0;
        }
    }

    fn has_peak(&self) -> bool {
        self.core / 2.0 > PEAK * self.sides[0].max(self.sides[1]) / (SIDE.1 - SIDE.0)
    }
}
