//! The nearest points of one point after the other: what is near a leaf of the tree is gathered once.
//!
//! The distances of the points before are a guess; that enough points lie within it proves it.

use super::{LEAF, Neighbor, PointTree, Search, gap};
use crate::Vector;
use crate::bounds::bounds;
use crate::instructions::widest;

/// Leaves around one that are searched together; where more are near, each point asks the tree.
const MOST_LEAVES: usize = 192;
/// Low bits of a squared distance that give way to the number of its point.
const NUMBER: u64 = 0xffff;
/// How much farther neighbours are looked for than those of the point before reach, and how much
/// farther leaves are gathered.
const GUESS: f64 = 1.1;
const GATHERED: f64 = 1.6;
/// What rounding and the bits that give way may take from a distance.
const SLACK: f64 = 1.0 + 1e-9;

/// The nearest points of one point after the other in the order of the tree.
///
/// Squared distances of the same 48 upper bits are alike; then the lower place is nearer.
pub struct Vicinity<'a> {
    tree: &'a PointTree,
    search: Search,
    /// The leaf that `leaves` are around, within which distance, and whether there are too many.
    leaf: usize,
    radius: f64,
    is_crowded: bool,
    leaves: Leaves,
    /// How many neighbours the point before had, and how far the last of them was.
    before: (usize, f64),
    /// Squared distances of points found, each with its number in `leaves`, or in `places` when the
    /// tree was asked.
    keys: Vec<u64>,
    is_of_tree: bool,
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
            leaves: Leaves::default(),
            before: (0, 0.0),
            keys: Vec::new(),
            is_of_tree: false,
            sorted: Vec::new(),
            places: Vec::new(),
        }
    }

    /// The `k` points nearest to a point of the tree, itself among them.
    pub fn nearest(&mut self, place: usize, k: usize) -> Ranking<'_> {
        debug_assert!(k as u64 <= NUMBER);
        self.look_for(place, k, Order::Nearness);
        let (starts, width) =
            if self.is_of_tree { (&self.places, 1) } else { (&self.leaves.starts, LEAF) };
        let n_parted = self.keys.len();
        Ranking { keys: &mut self.keys, n_sorted: 0, n_parted, starts, width }
    }

    /// Expects the next `k` neighbours to be so far away as `narrower` tells, if it looked around the
    /// same leaf and this did not: four times as many are twice as far on a surface.
    pub fn expect(&mut self, place: usize, k: usize, narrower: &Vicinity) {
        let (n_before, far) = narrower.before;
        if self.leaf != place / LEAF && n_before > 0 {
            let k = k.min(self.tree.points().len());
            self.before = (k, far * (k as f64 / n_before as f64).sqrt());
        }
    }

    /// Places of the same points, rising.
    pub fn nearest_by_place(&mut self, place: usize, k: usize) -> &[u32] {
        self.look_for(place, k, Order::Place);
        &self.places
    }

    /// Puts the `k` nearest into `keys`, or into `places` by place.
    fn look_for(&mut self, place: usize, k: usize, order: Order) {
        let k = k.min(self.tree.points().len());
        if self.before.0 == k {
            let guess = GUESS * self.before.1;
            if self.gather(place, guess) {
                let n_found = self.ask_leaves(place, guess, k, order);
                // As if the points that were found lay on a surface.
                let reach = guess * GUESS * (k as f64 / n_found.max(1) as f64).sqrt();
                if n_found >= k
                    || self.gather(place, reach) && self.ask_leaves(place, reach, k, order) >= k
                {
                    return;
                }
            }
        }
        self.ask_tree(place, k, order);
    }

    /// Whether `leaves` are all those that hold points within `reach`; else too many do.
    fn gather(&mut self, place: usize, reach: f64) -> bool {
        let leaf = place / LEAF;
        let is_unfit = if self.is_crowded {
            GATHERED * GATHERED * reach < self.radius
        } else {
            reach > self.radius
        };
        if leaf != self.leaf || is_unfit {
            let radius = GATHERED * reach;
            let is_complete = self.leaves.gather(self.tree, leaf, radius);
            (self.leaf, self.radius, self.is_crowded) = (leaf, radius, !is_complete);
        }
        !self.is_crowded
    }

    /// How many points of `leaves` are within `reach`; when they are at least `k`, the nearest of
    /// them are found.
    fn ask_leaves(&mut self, place: usize, reach: f64, k: usize, order: Order) -> usize {
        let Self { keys, sorted, places, .. } = self;
        // All squared distances that are alike are within, or none is.
        let square = greatest_like((reach * reach).to_bits());
        find(&mut self.leaves, &self.tree.points()[place], square, keys);
        let n_found = keys.len();
        if n_found < k {
            return n_found;
        }
        self.is_of_tree = false;
        let last = match order {
            Order::Nearness => {
                let last = *keys.select_nth_unstable(k - 1).1;
                keys.truncate(k);
                last
            }
            Order::Place => {
                sorted.clone_from(keys);
                let last = *sorted.select_nth_unstable(k - 1).1;
                let starts = &self.leaves.starts;
                places.clear();
                places.extend(
                    keys.iter().filter(|&&key| key <= last).map(|key| place_of(*key, starts, LEAF)),
                );
                last
            }
        };
        self.before = (k, greatest_like(last).sqrt());
        n_found
    }

    /// The `k` nearest of the whole tree.
    fn ask_tree(&mut self, place: usize, k: usize, order: Order) {
        let here = &self.tree.points()[place];
        let keys_of = |near: &[Neighbor]| -> Vec<(u64, u32)> {
            near.iter().map(|n| (n.squared.to_bits() & !NUMBER, n.place)).collect()
        };
        let mut near = keys_of(self.tree.nearest(here, k + 1, &mut self.search));
        let last = greatest_like(near[k - 1].0).sqrt();
        // Of those alike the tree takes others.
        if near.get(k).is_some_and(|next| next.0 == near[k - 1].0) {
            near = keys_of(self.tree.within(here, SLACK * last, &mut self.search));
        }
        near.sort_unstable();
        near.truncate(k);
        if let Order::Place = order {
            near.sort_unstable_by_key(|(_, place)| *place);
        }
        self.before = (k, last);
        self.places.clear();
        self.places.extend(near.iter().map(|(_, place)| place));
        self.is_of_tree = true;
        self.keys.clear();
        self.keys.extend(0..k as u64);
    }
}

/// The nearest points of one, sorted as far as is asked.
pub struct Ranking<'a> {
    keys: &'a mut [u64],
    /// How many are sorted, and how many more are no farther than all others.
    n_sorted: usize,
    n_parted: usize,
    starts: &'a [u32],
    width: usize,
}

impl Ranking<'_> {
    pub fn len(&self) -> usize {
        self.keys.len()
    }

    /// Places of the `n` nearest, nearest first.
    pub fn first(&mut self, n: usize) -> impl ExactSizeIterator<Item = u32> {
        self.sort(n);
        self.places(n)
    }

    /// Puts the `n` nearest first, nearest first.
    pub fn sort(&mut self, n: usize) {
        if n > self.n_sorted {
            self.part(n);
            self.keys[self.n_sorted..n].sort_unstable();
            self.n_sorted = n;
            self.n_parted = self.n_parted.max(n);
        }
    }

    /// The same in no particular order.
    pub fn among(&mut self, n: usize) -> impl ExactSizeIterator<Item = u32> {
        if n > self.n_sorted {
            self.part(n);
            self.n_parted = n;
        }
        self.places(n)
    }

    /// Ranks of all, which rise with the distance, in the order of places.
    pub fn ranks(&self) -> &[u64] {
        self.keys
    }

    /// Place of the point that has a rank.
    pub fn place(&self, rank: u64) -> u32 {
        place_of(rank, self.starts, self.width)
    }

    fn places(&self, n: usize) -> impl ExactSizeIterator<Item = u32> {
        self.keys[..n].iter().map(|key| self.place(*key))
    }

    /// Brings the `n` nearest to the front.
    fn part(&mut self, n: usize) {
        let end = if n < self.n_parted { self.n_parted } else { self.keys.len() };
        if n != self.n_parted && n < end {
            self.keys[self.n_sorted..end].select_nth_unstable(n - self.n_sorted - 1);
        }
    }
}

/// Place of the point of a key, with the first places of groups so many numbers wide.
fn place_of(key: u64, starts: &[u32], width: usize) -> u32 {
    let number = (key & NUMBER) as usize;
    starts[number / width] + (number % width) as u32
}

/// How neighbours are sorted.
#[derive(Clone, Copy)]
enum Order {
    Nearness,
    Place,
}

/// The greatest squared distance that is like one of these bits.
fn greatest_like(squared: u64) -> f64 {
    f64::from_bits((squared | NUMBER).min(f64::INFINITY.to_bits()))
}

/// Copies of leaves, their boxes and points axis after axis.
#[derive(Default)]
struct Leaves {
    lows: [Vec<f64>; 3],
    highs: [Vec<f64>; 3],
    /// Places of their first points.
    starts: Vec<u32>,
    points: Vec<[[f64; LEAF]; 3]>,
    /// Room for what is asked of them: squared distances to their boxes, keys of their points.
    gaps: Vec<f64>,
    found: Vec<u64>,
}

impl Leaves {
    /// Copies those whose boxes are within `radius` of that of a leaf; false, and some of them,
    /// when there are too many.
    fn gather(&mut self, tree: &PointTree, leaf: usize, radius: f64) -> bool {
        let start = leaf * LEAF;
        let [low, high] = bounds(&tree.points[start..tree.points.len().min(start + LEAF)]);
        let Self { lows, highs, starts, points, gaps, found } = self;
        for k in 0..3 {
            lows[k].clear();
            highs[k].clear();
        }
        starts.clear();
        points.clear();
        let mut open = vec![0];
        while let Some(at) = open.pop() {
            let node = &tree.nodes[at as usize];
            if gap(&node.low, &node.high, &low, &high) > radius * radius {
                continue;
            }
            if node.second != 0 {
                open.extend([node.second, at + 1]);
                continue;
            }
            if starts.len() == MOST_LEAVES {
                return false;
            }
            for k in 0..3 {
                lows[k].push(node.low[k]);
                highs[k].push(node.high[k]);
            }
            starts.push(node.start);
            // What is missing is near nothing.
            points.push([[f64::NAN; LEAF]; 3]);
            let own = &tree.points[node.start as usize..node.end as usize];
            for (k, lanes) in points.last_mut().into_iter().flatten().enumerate() {
                for (lane, point) in lanes.iter_mut().zip(own) {
                    *lane = point[k];
                }
            }
        }
        gaps.resize(starts.len(), 0.0);
        found.resize(starts.len() * LEAF, 0);
        true
    }
}

widest! {
    // Keys of the points within a squared distance, by rising place.
    fn find(leaves: &mut Leaves, point: &Vector, square: f64, keys: &mut Vec<u64>) -> () {
        let Leaves { lows, highs, points, gaps, found, .. } = leaves;
        gaps.fill(0.0);
        for k in 0..3 {
            for ((gap, low), high) in gaps.iter_mut().zip(&lows[k]).zip(&highs[k]) {
                let (below, above) = (low - point[k], point[k] - high);
                let outside = if below > above { below } else { above };
                let outside = if outside > 0.0 { outside } else { 0.0 };
                *gap += outside * outside;
            }
        }
        let mut n_found = 0;
        for (first, (points, gap)) in (0..).step_by(LEAF).zip(points.iter().zip(gaps)) {
            if *gap > square {
                continue;
            }
            let mut squared = [0.0; LEAF];
            for (lane, squared) in squared.iter_mut().enumerate() {
                let [x, y, z] = std::array::from_fn(|k| points[k][lane] - point[k]);
                *squared = x * x + y * y + z * z;
            }
            let Some(found) = found[n_found..].first_chunk_mut::<LEAF>() else { break };
            let mut n_near = 0;
            for (number, squared) in (first..).zip(squared) {
                found[n_near % LEAF] = squared.to_bits() & !NUMBER | number;
                n_near += usize::from(squared <= square);
            }
            n_found += n_near;
        }
        keys.clear();
        keys.extend_from_slice(&found[..n_found]);
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
            let mut crowded = Vicinity { is_crowded: true, ..Vicinity::new(&tree) };
            let mut search = Search::default();
            for (place, point) in tree.points().iter().enumerate() {
                let alone: Vec<u32> =
                    tree.nearest(point, k, &mut search).iter().map(|n| n.place).collect();
                let mut by_place = alone.clone();
                by_place.sort_unstable();
                crowded.radius = 0.0;
                crowded.leaf = place / LEAF;
                for vicinity in [&mut vicinity, &mut crowded] {
                    let mut found = vicinity.nearest(place, k);
                    for n in [k / 3, k, k / 2].map(|n| n.min(alone.len())) {
                        let mut among: Vec<u32> = found.among(n).collect();
                        among.sort_unstable();
                        let mut first = alone[..n].to_vec();
                        first.sort_unstable();
                        prop_assert_eq!(among, first);
                        prop_assert!(found.first(n / 2).eq(alone[..n / 2].iter().copied()));
                    }
                    prop_assert!(found.first(alone.len()).eq(alone.iter().copied()));
                    prop_assert_eq!(vicinity.nearest_by_place(place, k), &by_place);
                }
                prop_assert!(crowded.is_crowded);
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
            let mut other = Vicinity::new(&tree);
            assert!(vicinity.nearest(place, 33).first(33).eq(other.nearest(place, 33).first(33)));
            let alone = Vicinity::new(&tree).nearest_by_place(place, 33).to_vec();
            assert_eq!(vicinity.nearest_by_place(place, 33), alone);
        }
    }

    #[test]
    fn copies_and_squares_beyond_numbers_have_neighbors() {
        for points in
            [vec![[1.0; 3]; 5000], vec![[1e200, 0.0, 0.0], [0.0; 3], [-1e200; 3], [2e200; 3]]]
        {
            let tree = PointTree::new(&points);
            let mut vicinity = Vicinity::new(&tree);
            for place in (0..points.len()).step_by(1500) {
                assert_eq!(vicinity.nearest_by_place(place, 3).len(), 3);
            }
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
        assert_eq!(vicinity.nearest(far, 5).first(1).next(), Some(far as u32));
        assert!(vicinity.leaves.starts.len() <= MOST_LEAVES);
    }
}
