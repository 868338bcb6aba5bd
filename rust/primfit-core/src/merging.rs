//! Touching planes that are one: put together as long as the points allow it.

use crate::graph::Graph;
use crate::growth::NOBODY;
use crate::regions::Region;
use crate::roughness::Roughness;
use std::collections::{BTreeSet, BinaryHeap};

/// Squared distance, in variances, that each point of the smaller plane may move.
const MOVE: f64 = 2.56;
/// What a plane costs, in variances, times the logarithm of its points.
const PLANE: f64 = 4.0;
/// How much larger than the smaller variance of two planes the common one may be.
const UNEQUAL: f64 = 4.0;

/// New labels after putting touching regions together, best gain a point first.
///
/// Two are one when the sum of squared distances grows by less than a plane's parameters and the
/// smaller plane's freedom to move are worth.
pub fn merge(graph: &Graph, regions: &[Region], labels: &[i32]) -> Vec<i32> {
    let mut regions = regions.to_vec();
    let mut touching = touching(graph, labels, regions.len());
    let mut version = vec![0_u32; regions.len()];
    let mut into: Vec<usize> = (0..regions.len()).collect();
    let roughness = Roughness::of(&regions);
    let mut heap = BinaryHeap::new();
    for (a, others) in touching.iter().enumerate() {
        for &b in others.range(a + 1..) {
            heap.extend(Pair::of(&roughness, &regions, &version, a, b));
        }
    }
    while let Some(Pair { a, b, versions, .. }) = heap.pop() {
        if versions != (version[a], version[b]) {
            continue;
        }
        regions[a] = joined(&regions[a], &regions[b]);
        into[b] = a;
        version[a] += 1;
        version[b] += 1;
        for other in std::mem::take(&mut touching[b]) {
            touching[other].remove(&b);
            if other != a {
                touching[other].insert(a);
                touching[a].insert(other);
            }
        }
        for &other in &touching[a] {
            heap.extend(Pair::of(&roughness, &regions, &version, a.min(other), a.max(other)));
        }
    }
    labels
        .iter()
        .map(|&label| {
            if label == NOBODY {
                return NOBODY;
            }
            let mut at = label as usize;
            while into[at] != at {
                at = into[at];
            }
            at as i32
        })
        .collect()
}

/// Two regions that may be one.
#[derive(Debug, PartialEq)]
struct Pair {
    gain: f64,
    a: usize,
    b: usize,
    versions: (u32, u32),
}

impl Pair {
    fn of(
        roughness: &Roughness,
        regions: &[Region],
        version: &[u32],
        a: usize,
        b: usize,
    ) -> Option<Self> {
        let (first, second) = (&regions[a], &regions[b]);
        let both = joined(first, second);
        let planes = [first, second, &both].map(Region::spread);
        let extents = planes.map(|plane| plane.variances[1].sqrt());
        let variances = [(first, 0), (second, 1)].map(|(region, k)| {
            let sigma = region.sigma(&planes[k]);
            roughness.sigma(sigma, extents[k], extents[2]).powi(2)
        });
        let counts = [first.moments.count, second.moments.count];
        let variance = variances[0].max(variances[1]).min(UNEQUAL * variances[0].min(variances[1]));
        let squares = |k: usize, count: f64| planes[k].variances[0] * count;
        let both_count = counts[0] + counts[1];
        let rise = squares(2, both_count) - squares(0, counts[0]) - squares(1, counts[1]);
        let worth = PLANE * both_count.ln() + MOVE * counts[0].min(counts[1]);
        let gain = (worth - rise / variance) / both_count;
        (gain > 0.0).then(|| Self { gain, a, b, versions: (version[a], version[b]) })
    }
}

impl Eq for Pair {}

impl Ord for Pair {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.gain.total_cmp(&other.gain).then((other.a, other.b).cmp(&(self.a, self.b)))
    }
}

impl PartialOrd for Pair {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

fn joined(a: &Region, b: &Region) -> Region {
    let moments = a.moments.joined(&b.moments);
    let [m, n] = [a, b].map(|region| region.moments.count);
    Region { moments, local_sigma: (m * a.local_sigma + n * b.local_sigma) / (m + n) }
}

fn touching(graph: &Graph, labels: &[i32], n: usize) -> Vec<BTreeSet<usize>> {
    let mut touching = vec![BTreeSet::new(); n];
    for (i, &label) in labels.iter().enumerate().filter(|(_, label)| **label != NOBODY) {
        let mut last = label;
        for &other in graph.of(i) {
            let other = labels[other as usize];
            if other != NOBODY && other != label && other != last {
                touching[label as usize].insert(other as usize);
                touching[other as usize].insert(label as usize);
                last = other;
            }
        }
    }
    touching
}
