//! Best-first agglomeration: of all pairs that touch, the one that gains most is joined next.

use std::cmp::Ordering;
use std::collections::{BTreeMap, BinaryHeap};

/// Things that may be joined, by number.
pub trait Clusters {
    /// What joining two gains, if anything; `bonus` is that of their touching.
    fn gain(&self, a: usize, b: usize, bonus: f64) -> Option<f64>;

    /// Lets the first take up the second, of which nobody will ask again.
    fn join(&mut self, a: usize, b: usize);
}

/// Joins pairs as long as that gains something; which cluster took up each, which may be itself.
///
/// `touching` holds for each cluster the others that it touches, with a bonus each; those of two that
/// are joined add. Equal gains are settled by the lower numbers.
pub fn agglomerate(
    clusters: &mut impl Clusters,
    mut touching: Vec<BTreeMap<usize, f64>>,
) -> Vec<usize> {
    let n = touching.len();
    let mut version = vec![0_u32; n];
    let mut into: Vec<usize> = (0..n).collect();
    let mut heap = BinaryHeap::new();
    let pair = |clusters: &_, version: &[u32], a: usize, b: usize, bonus: f64| {
        let gain = Clusters::gain(clusters, a, b, bonus)?;
        Some(Pair { gain, a, b, versions: (version[a], version[b]) })
    };
    for (a, others) in touching.iter().enumerate() {
        let after = others.range(a + 1..);
        heap.extend(after.filter_map(|(&b, &bonus)| pair(clusters, &version, a, b, bonus)));
    }
    while let Some(Pair { a, b, versions, .. }) = heap.pop() {
        if versions != (version[a], version[b]) {
            continue;
        }
        clusters.join(a, b);
        into[b] = a;
        version[a] += 1;
        version[b] += 1;
        for (other, bonus) in std::mem::take(&mut touching[b]) {
            touching[other].remove(&b);
            if other != a {
                *touching[other].entry(a).or_insert(0.0) += bonus;
                *touching[a].entry(other).or_insert(0.0) += bonus;
            }
        }
        let around = touching[a].iter();
        heap.extend(around.filter_map(|(&other, &bonus)| {
            pair(clusters, &version, a.min(other), a.max(other), bonus)
        }));
    }
    let root = |mut at: usize| {
        while into[at] != at {
            at = into[at];
        }
        at
    };
    (0..n).map(root).collect()
}

/// Two clusters that may be joined, as they were at these versions.
struct Pair {
    gain: f64,
    a: usize,
    b: usize,
    versions: (u32, u32),
}

impl PartialEq for Pair {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Pair {}

impl Ord for Pair {
    fn cmp(&self, other: &Self) -> Ordering {
        self.gain.total_cmp(&other.gain).then((other.a, other.b).cmp(&(self.a, self.b)))
    }
}

impl PartialOrd for Pair {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers that join when they are nearer than one, and become their mean.
    struct Numbers(Vec<f64>);

    impl Clusters for Numbers {
        fn gain(&self, a: usize, b: usize, bonus: f64) -> Option<f64> {
            let gain = 1.0 + bonus - (self.0[a] - self.0[b]).abs();
            (gain > 0.0).then_some(gain)
        }

        fn join(&mut self, a: usize, b: usize) {
            self.0[a] = f64::midpoint(self.0[a], self.0[b]);
        }
    }

    fn chain(values: &[f64], bonus: f64) -> Vec<usize> {
        let n = values.len();
        let beside = |i: usize| [i.checked_sub(1), (i + 1 < n).then_some(i + 1)];
        let touching =
            (0..n).map(|i| beside(i).into_iter().flatten().map(|j| (j, bonus)).collect()).collect();
        agglomerate(&mut Numbers(values.to_vec()), touching)
    }

    #[test]
    fn the_nearest_are_joined_first() {
        // 0.7 and 1.2 become 0.95, which is too far from 0; by pairs from the left all were one.
        assert_eq!(chain(&[-0.1, 0.7, 1.2], 0.0), [0, 1, 1]);
        assert_eq!(chain(&[-0.1, 0.7, 1.2], 0.1), [0, 0, 0]);
    }

    #[test]
    fn what_does_not_touch_stays_apart() {
        let touching = vec![BTreeMap::new(); 3];
        assert_eq!(agglomerate(&mut Numbers(vec![0.0; 3]), touching), [0, 1, 2]);
    }

    #[test]
    fn what_is_taken_up_is_followed_to_the_end() {
        assert_eq!(chain(&[0.0; 6], 0.0), [0; 6]);
    }
}
