//! Regions of cells: from the flattest, over neighbours on the same plane, then merged.

use super::cells::{Flat, Pyramid, children, sum};
use crate::agglomeration::{Clusters, agglomerate};
use crate::segmentation::SegmentationSettings;
use crate::segmentation::settings::{Accepting, Merging};
use crate::spread::Moments;
use std::collections::BTreeMap;

/// No region.
pub const NOBODY: i32 = -1;
/// Share of what rounding leaves of the extent of a region, as its least noise.
const FLOOR: f64 = 1e-6;
/// Least points of a cell, and least share of its pixels with one.
const FEWEST: f64 = 8.0;
const FILLED: f64 = 0.25;
/// Cells of one size in a row or column that may be flat together where none is by itself: faces as
/// narrow as a cell, near the sensor, whose noise is as large as it.
const LONGEST: usize = 4;
/// Second smallest over largest variance, below which points are on a line.
const LINE: f64 = 1e-4;
/// Standard deviation of a cell's points about the plane of a region, in those of the noise, up to
/// which it may be of it.
pub const ROUGH: f64 = 1.6;
/// How much a region grows between two fits.
const REFIT: f64 = 1.5;
/// Least points of regions that are merged.
const LEAST: f64 = 3.0;

/// Points on one plane.
#[derive(Debug, Clone, Copy, Default)]
pub struct Region {
    /// Moments of the points.
    pub moments: Moments,
    /// Sum of the variances of their noise.
    pub noise: f64,
}

impl Region {
    /// Of the points of both.
    pub fn joined(&self, other: &Self) -> Self {
        Self { moments: sum(&self.moments, &other.moments), noise: self.noise + other.noise }
    }

    /// Standard deviation of the noise of its points, at least what rounding leaves.
    pub fn sigma(&self, flat: &Flat) -> f64 {
        let floor = FLOOR * flat.variances[2].sqrt();
        (self.noise / self.moments.count).sqrt().max(floor).max(f64::MIN_POSITIVE)
    }

    /// Mean squared distance of its points from a plane.
    fn off(&self, plane: &Flat) -> f64 {
        let [xx, xy, xz, yy, yz, zz] = self.moments.scatter;
        let [a, b, c] = plane.normal;
        let scatter =
            a * (a * xx + 2.0 * (b * xy + c * xz)) + b * (b * yy + 2.0 * c * yz) + c * c * zz;
        scatter / self.moments.count + plane.distance(&self.moments.mean).powi(2)
    }
}

/// Flat cells of any size, which do not overlap.
struct Nodes {
    /// Node of each of the smallest cells.
    of_cell: Vec<i32>,
    /// Their points, from the largest cells to the smallest.
    regions: Vec<Region>,
    flats: Vec<Flat>,
}

/// Region of each of the smallest cells, and the regions; those that no cell names are empty of them.
pub fn regions(
    pyramid: &Pyramid,
    noise: &[f64],
    is_ring: bool,
    settings: &SegmentationSettings,
) -> (Vec<i32>, Vec<Region>) {
    let nodes = flat_cells(pyramid, noise, &settings.acceptance);
    let touching = touching(&nodes.of_cell, pyramid.levels[0].width, is_ring, nodes.regions.len());
    let (of_node, mut regions) = grow(&nodes, &touching);
    let mut beside = vec![BTreeMap::new(); regions.len()];
    for (a, others) in touching.iter().enumerate() {
        let own = of_node[a] as usize;
        let others = others.iter().map(|&b| of_node[b as usize] as usize);
        beside[own].extend(others.filter(|&other| other != own).map(|other| (other, 0.0)));
    }
    let into = merge(&mut regions, beside, &settings.merging);
    let of =
        |&node: &i32| if node == NOBODY { NOBODY } else { into[of_node[node as usize] as usize] };
    (nodes.of_cell.iter().map(of).collect(), regions)
}

/// The largest flat cells.
fn flat_cells(pyramid: &Pyramid, noise: &[f64], settings: &Accepting) -> Nodes {
    let mut squares = vec![weighted(&pyramid.levels[0].moments, noise)];
    for k in 1..pyramid.levels.len() {
        let (level, below) = (&pyramid.levels[k], &pyramid.levels[k - 1]);
        let own = (0..level.moments.len())
            .map(|place| children(level, below, place).map(|i| squares[k - 1][i]).sum())
            .collect();
        squares.push(own);
    }
    let mut nodes =
        Nodes { of_cell: vec![NOBODY; noise.len()], regions: Vec::new(), flats: Vec::new() };
    let mut open: Vec<usize> =
        (0..pyramid.levels[pyramid.levels.len() - 1].moments.len()).collect();
    for k in (0..pyramid.levels.len()).rev() {
        let level = &pyramid.levels[k];
        let full = (pyramid.cell.0 * pyramid.cell.1) as f64 * f64::from(1 << (2 * k));
        let region =
            |place: usize| Region { moments: level.moments[place], noise: squares[k][place] };
        open.retain(|&place| level.moments[place].count >= FEWEST);
        open.sort_unstable();
        let mut is_open = vec![false; level.moments.len()];
        for &place in &open {
            is_open[place] = true;
        }
        for length in 1..=LONGEST {
            for step in [1, level.width].into_iter().take(length.min(2)) {
                for &place in &open {
                    let row = |step| (0..length).map(move |k| place + k * step);
                    let is_run = row(step).all(|at| is_open.get(at) == Some(&true))
                        && (step > 1 || place % level.width + length <= level.width);
                    if !is_run {
                        continue;
                    }
                    let n: f64 = row(step).map(|at| level.moments[at].count).sum();
                    if n < FILLED * full * length as f64 {
                        continue;
                    }
                    let all = row(step).map(region).reduce(|a, b| a.joined(&b)).unwrap_or_default();
                    let flat = Flat::of(&all.moments);
                    if is_flat(&all, &flat, settings) {
                        let number = nodes.regions.len() as i32;
                        nodes.regions.push(all);
                        nodes.flats.push(flat);
                        for at in row(step) {
                            is_open[at] = false;
                            claim(pyramid, k, at, number, &mut nodes.of_cell);
                        }
                    }
                }
            }
        }
        if k > 0 {
            let below = &pyramid.levels[k - 1];
            let rest = open.iter().filter(|&&place| is_open[place]);
            open = rest.flat_map(|&place| children(level, below, place)).collect();
        }
    }
    nodes
}

fn weighted(moments: &[Moments], noise: &[f64]) -> Vec<f64> {
    moments.iter().zip(noise).map(|(own, sigma)| own.count * sigma * sigma).collect()
}

/// Whether a cell is: by chance its variances are as 6 to 1 in 48 points, farther apart in fewer.
fn is_flat(region: &Region, flat: &Flat, settings: &Accepting) -> bool {
    let [thin, middle, long] = flat.variances;
    let n = region.moments.count;
    middle > (settings.flat_by_chance / n).max(settings.flat.1) * thin
        && middle > LINE * long
        && thin.sqrt() <= ROUGH * region.sigma(flat)
}

fn claim(pyramid: &Pyramid, k: usize, place: usize, number: i32, of_cell: &mut [i32]) {
    if k == 0 {
        of_cell[place] = number;
        return;
    }
    for child in children(&pyramid.levels[k], &pyramid.levels[k - 1], place) {
        claim(pyramid, k - 1, child, number, of_cell);
    }
}

/// Pairs of nodes that touch in the grid of the smallest cells, or have one cell between them that
/// is in none; each once a side, sorted.
fn touching(of_cell: &[i32], width: usize, is_ring: bool, n: usize) -> Vec<Vec<u32>> {
    let mut touching = vec![Vec::new(); n];
    let mut join = |a: i32, b: i32| {
        if a != NOBODY && b != NOBODY && a != b {
            touching[a as usize].push(b as u32);
            touching[b as usize].push(a as u32);
        }
    };
    for (i, &own) in of_cell.iter().enumerate() {
        for (step, room) in [(1, width - 1 - i % width), (width, (of_cell.len() - 1 - i) / width)] {
            if room >= 1 {
                let next = of_cell[i + step];
                join(own, next);
                if next == NOBODY && room >= 2 {
                    join(own, of_cell[i + 2 * step]);
                }
            }
        }
    }
    for row in of_cell.chunks(width).filter(|_| is_ring) {
        join(row[0], row[width - 1]);
    }
    for others in &mut touching {
        others.sort_unstable();
        others.dedup();
    }
    touching
}

/// Region of each node: grown from the nodes in order of size and flatness over nodes that touch.
fn grow(nodes: &Nodes, touching: &[Vec<u32>]) -> (Vec<i32>, Vec<Region>) {
    let n = nodes.regions.len();
    let mut order: Vec<usize> = (0..n).collect();
    let rank = |k: usize| {
        let off = nodes.flats[k].variances[0].sqrt() / nodes.regions[k].sigma(&nodes.flats[k]);
        (nodes.regions[k].moments.count, -off)
    };
    order.sort_by(|&a, &b| {
        let (a, b) = (rank(a), rank(b));
        b.0.total_cmp(&a.0).then(b.1.total_cmp(&a.1))
    });
    let mut of_node = vec![NOBODY; n];
    let mut grown: Vec<Region> = Vec::new();
    let mut queue = Vec::new();
    for seed in order {
        if of_node[seed] != NOBODY {
            continue;
        }
        let number = grown.len() as i32;
        let mut region = nodes.regions[seed];
        let mut flat = nodes.flats[seed];
        let mut fitted = region.moments.count;
        of_node[seed] = number;
        queue.clear();
        queue.push(seed as u32);
        let mut k = 0;
        while k < queue.len() {
            for &next in &touching[queue[k] as usize] {
                let other = &nodes.regions[next as usize];
                if of_node[next as usize] == NOBODY
                    && fits(&region, &flat, other, &nodes.flats[next as usize])
                {
                    of_node[next as usize] = number;
                    region = region.joined(other);
                    queue.push(next);
                    if region.moments.count > REFIT * fitted {
                        flat = Flat::of(&region.moments);
                        fitted = region.moments.count;
                    }
                }
            }
            k += 1;
        }
        grown.push(region);
    }
    (of_node, grown)
}

/// Whether a cell lies on a region's plane as well as noise allows.
fn fits(region: &Region, plane: &Flat, other: &Region, own: &Flat) -> bool {
    let sigma = other.sigma(own).max(region.sigma(plane));
    other.off(plane) <= (ROUGH * sigma).powi(2)
}

/// Puts touching regions together as long as one plane explains both; number of each after it.
pub fn merge(
    regions: &mut [Region],
    touching: Vec<BTreeMap<usize, f64>>,
    settings: &Merging,
) -> Vec<i32> {
    let flats = regions.iter().map(|region| Flat::of(&region.moments)).collect();
    let into = agglomerate(&mut Planes { regions, flats, settings }, touching);
    into.into_iter().map(|k| k as i32).collect()
}

/// Regions that may be one plane.
struct Planes<'a> {
    regions: &'a mut [Region],
    flats: Vec<Flat>,
    settings: &'a Merging,
}

impl Clusters for Planes<'_> {
    fn gain(&self, a: usize, b: usize, _bonus: f64) -> Option<f64> {
        let (first, second) = (&self.regions[a], &self.regions[b]);
        if first.moments.count.min(second.moments.count) < LEAST {
            return None;
        }
        let both = first.joined(second);
        let flats = [self.flats[a], self.flats[b], Flat::of(&both.moments)];
        let squares = |region: &Region, flat: &Flat| flat.variances[0] * region.moments.count;
        let rise =
            squares(&both, &flats[2]) - squares(first, &flats[0]) - squares(second, &flats[1]);
        let (m, k) = (first.moments.count, second.moments.count);
        let variance = |region: &Region, flat: &Flat| {
            let least = region.sigma(flat).powi(2);
            flat.variances[0].clamp(least, ROUGH * ROUGH * least)
        };
        let (v, w) = (variance(first, &flats[0]), variance(second, &flats[1]));
        let &Merging { unequal, plane, move_smooth, .. } = self.settings;
        let variance = v.max(w).min(unequal * v.min(w));
        let worth = plane * (m + k).ln() + move_smooth * m.min(k);
        let gain = (worth - rise / variance) / (m + k);
        (gain > 0.0).then_some(gain)
    }

    fn join(&mut self, a: usize, b: usize) {
        self.regions[a] = self.regions[a].joined(&self.regions[b]);
        self.flats[a] = Flat::of(&self.regions[a].moments);
    }
}
