//! The planes of a cloud of which nothing is known: grown, in competition, merged, tested.

use crate::curvature::Bend;
use crate::graph::Graph;
use crate::growth::{FEWEST, NOBODY, grow};
use crate::merging::merge;
use crate::neighbors::{PointTree, Search};
use crate::normals::{FLAT, FLOOR, LocalPlane};
use crate::regions::{self, Members, Region};
use crate::spread::Spread;
use crate::{Error, Vector, Workers};

/// Rounds of competition; planes are merged after every second one.
const SWEEPS: usize = 8;
/// Least share of the labelled neighbours among the neighbours with this label or none.
const PURITY: f64 = 0.5;
/// Least logarithm of the likelihood ratio of a plane to scattered points.
const EVIDENCE: f64 = 5.0;
/// Turn of the normal from side to side, radians, from which a part is curved, if it is so with
/// this evidence.
const BENT: f64 = 0.15;
const CURVED: f64 = 16.0;
/// Points of a plane around which it is compared with scattered ones.
const SAMPLES: usize = 16;
/// How much denser the points must lie on the plane than on its denser side: 8 times in a Gaussian
/// layer, as dense in a filled volume, even at its faces.
const PEAK: f64 = 1.5;
/// Standard deviations that such a point may lie off the plane, and share of a Gaussian within.
const BAND: f64 = 1.5;
const IN_BAND: f64 = 0.87;

/// Labels of the points of a tree, in its order: planes are numbered by falling size, -1 for none.
///
/// # Errors
/// [`Error::Stopped`] when the caller does not want to go on.
pub fn segment(
    tree: &PointTree,
    local: &[LocalPlane],
    seeds: &[u32],
    n_nearest: usize,
    n_looked_at: usize,
    workers: &Workers,
) -> Result<Vec<i32>, Error> {
    let points = tree.points();
    let sigma: Vec<f64> = local.iter().map(|plane| plane.sigma).collect();
    let graph = Graph::new(tree, n_nearest, n_looked_at, workers)?;
    let mut labels = grow(tree, &graph, local, seeds, workers)?;
    for sweep in 1..=SWEEPS {
        let found = regions::fit(points, &sigma, &labels, workers);
        labels = regions::compete(points, &graph, &found, &labels, workers)?;
        if sweep % 2 == 0 {
            let found = regions::fit(points, &sigma, &labels, workers);
            labels = merge(&graph, &found, &labels);
        }
    }
    let parts = regions::components(&graph, &labels);
    let found = regions::fit(points, &sigma, &parts, workers);
    let members = Members::of(&parts);
    let mut accepted = vec![false; found.len()];
    workers.fill(&mut accepted, 1, Search::default, |search, k, accepted| {
        let test = Test { tree, graph: &graph, labels: &parts, region: &found[k] };
        accepted[0] = test.passes(k as i32, members.get(k), search);
    })?;
    let mut order: Vec<usize> = (0..found.len()).filter(|&k| accepted[k]).collect();
    order.sort_by_key(|&k| std::cmp::Reverse(members.get(k).len()));
    let mut result = vec![NOBODY; parts.len()];
    for (&k, number) in order.iter().zip(0..) {
        for &place in members.get(k) {
            result[place as usize] = number;
        }
    }
    Ok(result)
}

/// Whether a connected region is a plane, or points that happen to lie near one.
struct Test<'a> {
    tree: &'a PointTree,
    graph: &'a Graph,
    labels: &'a [i32],
    region: &'a Region,
}

impl Test<'_> {
    fn passes(&self, label: i32, places: &[u32], search: &mut Search) -> bool {
        let spread = self.region.spread();
        let [thin, middle, long] = spread.variances;
        places.len() >= FEWEST
            && middle > FLAT * thin.max(FLOOR * FLOOR * long)
            && self.purity(label, places) >= PURITY
            && !self.is_bent(&spread, places)
            && self.evidence(label, places, search) > EVIDENCE
    }

    fn is_bent(&self, spread: &Spread, places: &[u32]) -> bool {
        let points = places.iter().map(|&place| &self.tree.points()[place as usize]);
        Bend::of(points, spread).is_some_and(|bend| bend.turn > BENT && bend.evidence > CURVED)
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

    /// A-contrario (Desolneux, Moisan, Morel: From Gestalt theory to image analysis, 2008): how
    /// unlikely it is that scattered points fill the plane's layer of a ball as much.
    fn evidence(&self, label: i32, places: &[u32], search: &mut Search) -> f64 {
        let points: &[Vector] = self.tree.points();
        let spread = self.region.spread();
        let sigma = self.region.sigma(&spread);
        let (mut inside, mut all, mut chance) = (0.0, 0.0, 0.0);
        let (mut core, mut sides) = (0.0, [0.0_f64; 2]);
        for sample in 0..SAMPLES {
            let place = places[sample * places.len() / SAMPLES] as usize;
            let far = (10.0 * sigma).max(self.graph.reach(place, points));
            let radius = far.min(2.0 * spread.variances[1].sqrt());
            let ball = self.tree.within(&points[place], radius, search);
            all += ball.len() as f64;
            for place in ball.iter().map(|n| n.place as usize) {
                let off = spread.distance(&points[place]) / sigma;
                inside += f64::from(self.labels[place] == label && off.abs() <= BAND);
                core += f64::from(off.abs() <= 1.0);
                if off.abs() > BAND && off.abs() <= 2.0 * BAND {
                    sides[usize::from(off > 0.0)] += 1.0;
                }
            }
            let h = (BAND * sigma / radius).min(1.0);
            chance += 1.5 * h - 0.5 * h * h * h;
        }
        let p = chance / SAMPLES as f64;
        let f = inside / f64::max(all, 1.0);
        if f <= p || core / 2.0 <= PEAK * sides[0].max(sides[1]) / BAND {
            return f64::NEG_INFINITY;
        }
        let rest = if f < 1.0 { (1.0 - f) * ((1.0 - f) / (1.0 - p)).ln() } else { 0.0 };
        let divergence = f * (f / p).ln() + rest;
        IN_BAND * places.len() as f64 / f * divergence - (12.0 * points.len() as f64).ln()
    }
}
