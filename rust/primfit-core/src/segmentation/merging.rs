//! Touching planes that are one: put together as long as the points allow it.

use super::context::Context;
use super::growth::NOBODY;
use super::regions::Region;
use super::roughness::{Law, Surfaces};
use super::settings::Settings;
use crate::Workers;
use crate::agglomeration::{Clusters, agglomerate};
use crate::spread::Spread;
use std::collections::BTreeMap;

/// New labels after putting touching regions together, best gain a point first.
///
/// Two are one when the sum of squared distances grows by less than a plane's parameters and the
/// smaller plane's freedom to move are worth.
pub fn merge(context: &Context, labels: &[i32], workers: &Workers) -> Vec<i32> {
    let regions = context.fit(labels, workers);
    let touching = touching(context, labels, regions.len());
    let freedom = Freedom::of(context.surfaces, &regions, context.settings);
    let mut planes = Planes { freedom, regions };
    let into = agglomerate(&mut planes, touching);
    let of = |&label: &i32| if label == NOBODY { NOBODY } else { into[label as usize] as i32 };
    labels.iter().map(of).collect()
}

/// Regions that may be one plane.
struct Planes<'a> {
    freedom: Freedom<'a>,
    regions: Vec<Region>,
}

impl Clusters for Planes<'_> {
    fn gain(&self, a: usize, b: usize, bonus: f64) -> Option<f64> {
        let gain = self.freedom.gain([&self.regions[a], &self.regions[b]], bonus);
        (gain > 0.0).then_some(gain)
    }

    fn join(&mut self, a: usize, b: usize) {
        self.regions[a] = joined(&self.regions[a], &self.regions[b]);
    }
}

/// How far two planes may be from one.
#[derive(Debug, Clone, Copy)]
pub struct Freedom<'a> {
    settings: &'a Settings,
    surfaces: Surfaces,
    law: Law,
    squared_move: f64,
}

impl<'a> Freedom<'a> {
    /// Of the planes of a cloud.
    pub fn of(surfaces: Surfaces, regions: &[Region], settings: &'a Settings) -> Self {
        let (law, squared_move) = match surfaces {
            Surfaces::Smooth => (Law::WHITE, settings.merging.move_smooth),
            Surfaces::Rough => (Law::of(regions, &settings.roughness), settings.merging.move_rough),
        };
        Self { settings, surfaces, law, squared_move }
    }

    /// Variance about the plane of both of two parts.
    pub fn variance(&self, parts: [(&Region, &Spread); 2], both: &Spread) -> f64 {
        let extent = |spread: &Spread| spread.variances[1].sqrt();
        let [a, b] = parts.map(|(region, spread)| {
            let sigma = region.sigma(spread, self.surfaces, self.settings);
            self.law.sigma(sigma, extent(spread), extent(both)).powi(2)
        });
        a.max(b).min(self.settings.merging.unequal * a.min(b))
    }

    /// What each point gains when two regions become one plane, in variances.
    fn gain(&self, [first, second]: [&Region; 2], bonus: f64) -> f64 {
        let both = joined(first, second);
        let planes = [first, second, &both].map(Region::spread);
        let rise =
            squares(&planes[2], &both) - squares(&planes[0], first) - squares(&planes[1], second);
        let counts = [first.moments.count, second.moments.count];
        let variance = self.variance([(first, &planes[0]), (second, &planes[1])], &planes[2]);
        let worth = self.worth(counts) + 2.0 * bonus;
        (worth - rise / variance) / (counts[0] + counts[1])
    }

    /// Whether two regions may be one plane, whether or not they touch.
    pub fn allows(&self, pair: [&Region; 2]) -> bool {
        self.gain(pair, 0.0) > 0.0
    }

    /// How much the sum of squares may rise, in variances, when two parts of so many points become
    /// one plane.
    pub fn worth(&self, counts: [f64; 2]) -> f64 {
        self.settings.merging.plane * (counts[0] + counts[1]).ln()
            + self.squared_move * counts[0].min(counts[1])
    }
}

fn squares(spread: &Spread, region: &Region) -> f64 {
    spread.variances[0] * region.moments.count
}

fn joined(a: &Region, b: &Region) -> Region {
    let moments = a.moments.joined(&b.moments);
    let [m, n] = [a, b].map(|region| region.moments.count);
    Region { moments, local_sigma: (m * a.local_sigma + n * b.local_sigma) / (m + n) }
}

/// For each region those that it touches, and by how much the logarithm of the shares of labels
/// among neighbours grows when both are one: much where they interleave, little across an edge.
fn touching(context: &Context, labels: &[i32], n: usize) -> Vec<BTreeMap<usize, f64>> {
    let mut touching = vec![BTreeMap::new(); n];
    let mut counts: Vec<(i32, f64)> = Vec::new();
    for (i, &label) in labels.iter().enumerate().filter(|(_, label)| **label != NOBODY) {
        let neighbors = context.graph.of(i);
        counts.clear();
        let mut own = 0.0;
        for &other in neighbors {
            let other = labels[other as usize];
            if other == label {
                own += 1.0;
            } else if other != NOBODY {
                match counts.iter_mut().find(|entry| entry.0 == other) {
                    Some(entry) => entry.1 += 1.0,
                    None => counts.push((other, 1.0)),
                }
            }
        }
        let least = context.settings.competition.share * neighbors.len() as f64;
        for &(other, count) in &counts {
            let bonus = ((own + count + least) / (own + least)).ln();
            *touching[label as usize].entry(other as usize).or_insert(0.0) += bonus;
            *touching[other as usize].entry(label as usize).or_insert(0.0) += bonus;
        }
    }
    touching
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::super::graph::Graph;
    use super::*;
    use crate::neighbors::PointTree;
    use crate::{Vector, Workers};

    #[test]
    fn halves_are_one_plane() {
        let square = |k: u32, at: f64| {
            (0..k).map(move |i| {
                let (u, v) = (f64::from(i) * 0.618_034 % 1.0, f64::from(i) * 0.754_878 % 1.0);
                [at + 0.3 * u, 0.3 * v, 0.004 * f64::from(i).powi(2).sin()]
            })
        };
        let points: Vec<Vector> = square(300, 0.0).chain(square(300, 0.3)).collect();
        let workers = Workers::new(Some(1), &(|| true)).unwrap();
        let tree = PointTree::new(&points);
        let graph = Graph::new(&tree, 24, 96, &workers).unwrap();
        let labels: Vec<i32> = tree.points().iter().map(|p| i32::from(p[0] > 0.3)).collect();
        let noise = vec![0.003; points.len()];
        let (tree, graph, noise) = (&tree, &graph, &noise[..]);
        let context = Context {
            tree,
            graph,
            noise,
            surfaces: Surfaces::Smooth,
            settings: &Settings::default(),
        };
        let mut merged = merge(&context, &labels, &workers);
        merged.dedup();
        assert_eq!(merged.len(), 1);
    }
}
