//! The nearest points of one point after the other: what is near a leaf of the tree is gathered once.
//!
//! The distances of the points before are a guess; that enough points lie within it proves it.

use super::{Block, LEAF, PointTree, Search};
use crate::Vector;
use crate::instructions::widest;

/// Leaves around one that are searched together; where more are near, each point asks the tree.
const MOST_LEAVES: usize = 192;
/// Low bits of a squared distance that give way to the number of its point.
const NUMBER: u64 = 0xffff;
/// How much farther neighbours are looked for than those of the point before reach, and how much
/// farther leaves are gathered.
const GUESS: f64 = 1.2;
const GATHERED: f64 = 1.6;
/// What rounding and the bits that give way may take from a distance.
const SLACK: f64 = 1.0 + 1e-9;

/// The nearest points of one point after the other in the order of the tree.
pub struct Vicinity<'a> {
    tree: &'a PointTree,
    search: Search,
    /// The leaf that `blocks` are around, within which distance, and whether there are too many.
    leaf: usize,
    radius: f64,
    is_crowded: bool,
    blocks: Vec<Block>,
    /// How many neighbours the point before had, and how far the last of them was.
    before: (usize, f64),
    keys: Vec<u64>,
    sorted: Vec<u64>,
    places: Vec<u32>,
}

impl<'a> Vicinity<'a> {
    pub fn new(tree: &'a PointTree) -> Self {
        Self {
            tree,
            search: Search::default(),
            leaf: usize::MAX,
            radius: 0.0,
            is_crowded: false,
            blocks: Vec::new(),
            before: (0, 0.0),
            keys: Vec::new(),
            sorted: Vec::new(),
            places: Vec::new(),
        }
    }

    /// Places of the `k` points nearest to a point of the tree, itself among them, nearest first.
    ///
    /// Squared distances of the same 48 upper bits are alike; then the lower place is nearer.
    pub fn nearest(&mut self, place: usize, k: usize) -> &[u32] {
        self.look_for(place, k, Self::take_in_order);
        &self.places
    }

    /// The same points by rising place.
    pub fn nearest_by_place(&mut self, place: usize, k: usize) -> &[u32] {
        if !self.look_for(place, k, Self::take_by_place) {
            self.places.sort_unstable();
        }
        &self.places
    }

    /// Puts the `k` nearest into `places`, as `take` takes them from `keys`; else, which it tells,
    /// as the tree finds them, nearest first.
    fn look_for(&mut self, place: usize, k: usize, take: fn(&mut Self, usize) -> f64) -> bool {
        let k = k.min(self.tree.points().len());
        if self.before.0 == k {
            let guess = GUESS * self.before.1;
            if self.found(place, k, guess, take) {
                return true;
            }
            // As if the points that were found lay on a surface.
            let reach = guess * GUESS * (k as f64 / self.keys.len().max(1) as f64).sqrt();
            if reach <= self.radius && self.found(place, k, reach, take) {
                return true;
            }
        }
        let point = &self.tree.points()[place];
        let last = self.tree.nearest(point, k, &mut self.search)[k - 1].squared.sqrt();
        self.before = (k, last);
        let is_found = self.found(place, k, SLACK * last, take);
        if !is_found {
            self.ask_tree(place, k, SLACK * last);
        }
        is_found
    }

    /// The same by the tree alone, for many neighbours of few points; the lower row is nearer.
    pub fn nearest_of_one(&mut self, place: usize, k: usize) -> &[u32] {
        let found = self.tree.nearest(&self.tree.points()[place], k, &mut self.search);
        self.places.clear();
        self.places.extend(found.iter().map(|neighbor| neighbor.place));
        &self.places
    }

    /// Whether the `k` nearest lie within `reach`; then they are in `places`.
    fn found(
        &mut self,
        place: usize,
        k: usize,
        reach: f64,
        take: fn(&mut Self, usize) -> f64,
    ) -> bool {
        let leaf = place / LEAF;
        let is_unfit = if self.is_crowded {
            GATHERED * GATHERED * reach < self.radius
        } else {
            reach > self.radius
        };
        if leaf != self.leaf || is_unfit {
            let radius = GATHERED * reach;
            let is_complete = self.tree.blocks_around(leaf, radius, MOST_LEAVES, &mut self.blocks);
            (self.leaf, self.radius, self.is_crowded) = (leaf, radius, !is_complete);
        }
        if self.is_crowded {
            return false;
        }
        find(&self.blocks, &self.tree.points()[place], reach * reach, &mut self.keys);
        if self.keys.len() < k {
            return false;
        }
        let last = take(self, k);
        if last > reach * reach {
            return false;
        }
        self.before = (k, last.sqrt());
        true
    }

    /// Takes the `k` smallest keys, rising; the greatest squared distance that the last may have.
    fn take_in_order(&mut self, k: usize) -> f64 {
        let keys = &mut self.keys;
        if keys.len() > 2 * k {
            keys.select_nth_unstable(k - 1);
            keys.truncate(k);
        }
        keys.sort_unstable();
        keys.truncate(k);
        self.take(u64::MAX);
        f64::from_bits(self.keys[k - 1] | NUMBER)
    }

    /// Takes them as they were found: by rising place.
    fn take_by_place(&mut self, k: usize) -> f64 {
        self.sorted.clone_from(&self.keys);
        let last = *self.sorted.select_nth_unstable(k - 1).1;
        self.take(last);
        f64::from_bits(last | NUMBER)
    }

    /// Puts the points with keys up to `last` into `places`.
    fn take(&mut self, last: u64) {
        let blocks = &self.blocks;
        self.places.clear();
        self.places.extend(self.keys.iter().filter(|&&key| key <= last).map(|key| {
            let number = (key & NUMBER) as usize;
            blocks[number / LEAF].start + (number % LEAF) as u32
        }));
    }

    /// The `k` nearest, all of them within `reach`, into `places`, nearest first.
    fn ask_tree(&mut self, place: usize, k: usize, reach: f64) {
        let near = self.tree.within(&self.tree.points()[place], reach, &mut self.search);
        let mut keys: Vec<(u64, u32)> =
            near.iter().map(|n| (n.squared.to_bits() & !NUMBER, n.place)).collect();
        keys.sort_unstable();
        self.places.clear();
        self.places.extend(keys.iter().take(k).map(|(_, place)| place));
    }
}

widest! {
    fn find(blocks: &[Block], point: &Vector, reach: f64, keys: &mut Vec<u64>) -> () {
        keys.clear();
        for (number, block) in (0..).step_by(LEAF).zip(blocks) {
            if block.gap(point) > reach {
                continue;
            }
            let mut squared = [0.0; LEAF];
            for (lane, squared) in squared.iter_mut().enumerate() {
                let [x, y, z] = std::array::from_fn(|k| block.coordinates[k][lane] - point[k]);
                *squared = x * x + y * y + z * z;
            }
            let mut near = [0; LEAF];
            let mut n_near = 0;
            for (own, squared) in (number..).zip(&squared[..block.len]) {
                near[n_near] = (squared.to_bits() & !NUMBER) | own;
                n_near += usize::from(*squared <= reach);
            }
            keys.extend_from_slice(&near[..n_near]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn neighbors_are_those_of_the_tree(
            points in prop::collection::vec(prop::array::uniform3(-1.0..1.0), 1..120),
            k in 1_usize..50,
        ) {
            let tree = PointTree::new(&points);
            let mut vicinity = Vicinity::new(&tree);
            let mut again = Vicinity::new(&tree);
            let mut search = Search::default();
            for (place, point) in tree.points().iter().enumerate() {
                let alone = tree.nearest(point, k, &mut search).iter().map(|n| &n.place);
                prop_assert!(vicinity.nearest(place, k).iter().eq(alone));
                let mut by_place = vicinity.places.clone();
                by_place.sort_unstable();
                prop_assert_eq!(vicinity.nearest_by_place(place, k), by_place);
                vicinity.nearest(place, k);
                again.ask_tree(place, k.min(points.len()), 4.0);
                prop_assert_eq!(&again.places, &vicinity.places);
            }
        }
    }

    #[test]
    fn ties_do_not_depend_on_the_points_before() {
        let points: Vec<Vector> = (0..4000)
            .map(|i| [f64::from(i % 20), f64::from(i / 20 % 20), f64::from(i / 400)])
            .collect();
        let tree = PointTree::new(&points);
        let mut vicinity = Vicinity::new(&tree);
        for place in 0..points.len() {
            assert_eq!(vicinity.nearest(place, 33), Vicinity::new(&tree).nearest(place, 33));
            let alone = Vicinity::new(&tree).nearest_by_place(place, 33).to_vec();
            assert_eq!(vicinity.nearest_by_place(place, 33), alone);
        }
    }

    #[test]
    fn a_far_point_does_not_gather_the_cloud() {
        let mut points: Vec<Vector> =
            (0..20_000).map(|i| [f64::from(i % 200), f64::from(i / 200), 0.0]).collect();
        points.push([1e6, 0.0, 0.0]);
        let tree = PointTree::new(&points);
        let mut vicinity = Vicinity::new(&tree);
        let far = tree.rows().iter().position(|&row| row == 20_000).unwrap_or_default();
        assert!(vicinity.nearest(far, 5).contains(&(far as u32)));
        assert!(vicinity.blocks.len() <= MOST_LEAVES);
    }
}
