//! Pixels: which region's plane each lies on, and the connected parts of each.

use super::cells::{Flat, Image, Pyramid};
use super::growth::{NOBODY, ROUGH, Region};
use std::array::from_fn;
use std::collections::BTreeMap;

/// Standard deviations within which a plane takes points.
const REACH: f64 = 3.5;
/// Half the logarithm of a turn: what a normal density's peak is below that of one of height 1.
const HALF_LOG_TAU: f64 = 0.918_938_533_204_672_8;
/// Sweeps of competition.
const SWEEPS: usize = 2;
/// Pixels within which the next one with a point is sought.
const NEXT: usize = 2;
/// Pixels without a point that a plane goes on over, along a row or a column.
const BRIDGE: usize = 3;

/// A plane with the noise of its points.
#[derive(Clone, Copy)]
pub struct Plane {
    /// The plane.
    pub flat: Flat,
    /// Standard deviation of its points, and its logarithm.
    pub sigma: f64,
    log_sigma: f64,
}

impl Plane {
    /// Of a region: its points about its plane, at least their noise and not much more.
    pub fn of(region: &Region) -> Self {
        let flat = Flat::of(&region.moments);
        let least = region.sigma(&flat);
        let sigma = flat.variances[0].sqrt().clamp(least, ROUGH * least);
        Self { flat, sigma, log_sigma: sigma.ln() }
    }

    fn cost(&self, point: &crate::Vector) -> Option<f64> {
        let off = self.flat.distance(point) / self.sigma;
        (off.abs() <= REACH).then(|| off * off / 2.0 + self.log_sigma)
    }
}

/// The nearest plane of each pixel among those of the cells around it.
pub fn assign(image: &Image, pyramid: &Pyramid, of_cell: &[i32], planes: &[Plane]) -> Vec<i32> {
    let (w, h) = (image.width, image.height);
    let width = pyramid.levels[0].width;
    let height = of_cell.len() / width;
    let mut labels = vec![NOBODY; image.points.len()];
    let mut near: Vec<i32> = Vec::new();
    for (cell, &own) in of_cell.iter().enumerate() {
        let (row, column) = (cell / width, cell % width);
        near.clear();
        near.extend((own != NOBODY).then_some(own));
        for r in row.saturating_sub(1)..(row + 2).min(height) {
            for c in column.saturating_sub(1)..(column + 2).min(width) {
                let other = of_cell[r * width + c];
                if other != NOBODY && !near.contains(&other) {
                    near.push(other);
                }
            }
        }
        if near.is_empty() {
            continue;
        }
        let (top, left) = (row * pyramid.cell.0, column * pyramid.cell.1);
        for i in (top..(top + pyramid.cell.0).min(h))
            .flat_map(|y| y * w + left..y * w + (left + pyramid.cell.1).min(w))
        {
            labels[i] = best(&image.points[i], near.iter().copied(), planes);
        }
    }
    labels
}

fn best(point: &crate::Vector, near: impl Iterator<Item = i32>, planes: &[Plane]) -> i32 {
    let mut best = (f64::INFINITY, NOBODY);
    for label in near {
        if let Some(cost) = planes[label as usize].cost(point)
            && (cost, label) < best
        {
            best = (cost, label);
        }
    }
    best.1
}

/// Lets labels flow to pixels without one that lie on the plane of a neighbour.
pub fn flow(image: &Image, labels: &mut [i32], planes: &[Plane]) {
    let mut front: Vec<u32> = (0..labels.len())
        .filter(|&i| labels[i] == NOBODY && image.is_point(i))
        .filter(|&i| around(image, i).any(|j| labels[j] != NOBODY))
        .map(|i| i as u32)
        .collect();
    while !front.is_empty() {
        let taken: Vec<(u32, i32)> = front
            .iter()
            .map(|&i| {
                let near = around(image, i as usize).map(|j| labels[j]).filter(|&l| l != NOBODY);
                (i, best(&image.points[i as usize], near, planes))
            })
            .filter(|(_, label)| *label != NOBODY)
            .collect();
        let mut next = Vec::new();
        for &(i, label) in &taken {
            labels[i as usize] = label;
        }
        for &(i, _) in &taken {
            next.extend(
                around(image, i as usize)
                    .filter(|&j| labels[j] == NOBODY && image.is_point(j))
                    .map(|j| j as u32),
            );
        }
        next.sort_unstable();
        next.dedup();
        front = next;
    }
}

/// The next pixels with a point on the four sides of one.
pub fn around<'a>(image: &'a Image, i: usize) -> impl Iterator<Item = usize> + use<'a> {
    let (w, n) = (image.width, image.points.len());
    let (x, image) = (i % w, *image);
    [(true, 1, x), (false, 1, w - 1 - x), (true, w, i / w), (false, w, (n - 1 - i) / w)]
        .into_iter()
        .filter_map(move |(is_back, step, room)| {
            (1..=room.min(NEXT))
                .map(|k| if is_back { i - k * step } else { i + k * step })
                .find(|&j| image.is_point(j))
        })
}

/// Sweeps of competition where the eight neighbours of a pixel do not agree with it: the distance's
/// likelihood times the share of neighbours with the label.
pub fn compete(image: &Image, labels: &mut [i32], planes: &[Plane], least: f64) {
    let (w, h) = (image.width, image.height);
    // Of so many neighbours alike among all, both at most eight.
    let logs: [[f64; 9]; 9] =
        from_fn(|n_all| from_fn(|n_alike| (n_alike as f64 / n_all.max(1) as f64 + least).ln()));
    for _ in 0..SWEEPS {
        let old = labels.to_vec();
        for (y, x) in (0..h).flat_map(|y| (0..w).map(move |x| (y, x))) {
            let i = y * w + x;
            if y > 0 && x > 0 && y + 1 < h && x + 1 < w {
                let own = old[i];
                if old[i - 1] == own && old[i + 1] == own && old[i - w] == own && old[i + w] == own
                {
                    continue;
                }
            }
            if !image.is_point(i) {
                continue;
            }
            let mut counts: [(i32, usize); 9] = [(NOBODY, 0); 9];
            let (mut n, mut total) = (1, 0);
            for r in y.saturating_sub(1)..(y + 2).min(h) {
                for c in x.saturating_sub(1)..(x + 2).min(w) {
                    let j = r * w + c;
                    if j == i || !image.is_point(j) {
                        continue;
                    }
                    total += 1;
                    match counts[..n].iter_mut().find(|(label, _)| *label == old[j]) {
                        Some((_, count)) => *count += 1,
                        None if n < 9 => {
                            counts[n] = (old[j], 1);
                            n += 1;
                        }
                        None => {}
                    }
                }
            }
            if total == 0 {
                continue;
            }
            let mut best = (f64::INFINITY, NOBODY);
            // Without a plane, a point may be anywhere within the reach of the noisiest beside it.
            let room = counts[1..n].iter().map(|&(label, _)| planes[label as usize].sigma);
            let room = room.fold(0.0, f64::max);
            if room > 0.0 {
                best = ((2.0 * REACH * room).ln() - logs[total][counts[0].1], NOBODY);
            }
            for &(label, count) in &counts[1..n] {
                let plane = &planes[label as usize];
                if let Some(cost) = plane.cost(&image.points[i]) {
                    let cost = cost + HALF_LOG_TAU - logs[total][count];
                    if (cost, label) < best {
                        best = (cost, label);
                    }
                }
            }
            labels[i] = best.1;
        }
    }
}

/// Labels that touch each other, each once a side, without a bonus.
pub fn beside(image: &Image, labels: &[i32], n: usize) -> Vec<BTreeMap<usize, f64>> {
    let w = image.width;
    let mut beside = vec![BTreeMap::new(); n];
    let mut join = |a: i32, b: i32| {
        if a != NOBODY && b != NOBODY && a != b {
            beside[a as usize].insert(b as usize, 0.0);
            beside[b as usize].insert(a as usize, 0.0);
        }
    };
    for (y, x) in (0..image.height).flat_map(|y| (0..w).map(move |x| (y, x))) {
        let i = y * w + x;
        let own = labels[i];
        if own == NOBODY {
            continue;
        }
        for (step, room) in [(1, w - 1 - x), (w, image.height - 1 - y)] {
            if room > 0 && labels[i + step] == own {
                continue;
            }
            let mut next = (1..=room.min(1 + BRIDGE)).map(|k| i + k * step);
            if let Some(j) = next.find(|&j| labels[j] != NOBODY || image.is_point(j)) {
                join(own, labels[j]);
            }
        }
        if image.is_ring && x == 0 {
            join(own, labels[i + w - 1]);
        }
    }
    beside
}

/// Connected parts of each label on the grid, numbered as they come; a part goes on over a few pixels
/// without a point.
pub fn parts(image: &Image, labels: &[i32]) -> (Vec<i32>, usize) {
    let (w, n) = (image.width, labels.len());
    let mut root: Vec<u32> = (0..n as u32).collect();
    for (y, x) in (0..image.height).flat_map(|y| (0..w).map(move |x| (y, x))) {
        let i = y * w + x;
        let own = labels[i];
        if own == NOBODY {
            continue;
        }
        if x > 0 && labels[i - 1] == own {
            root[i] = root[i - 1];
            // What is above was joined to what is beside.
            if i >= w && labels[i - w] == own && labels[i - w - 1] == own {
                continue;
            }
        }
        for (step, room) in [(1, x), (w, y)] {
            for k in 1..=room.min(1 + BRIDGE) {
                let j = i - k * step;
                if labels[j] == own {
                    join(&mut root, i as u32, j as u32);
                    break;
                }
                if image.is_point(j) {
                    break;
                }
            }
        }
        let above = [(x > 0).then_some(1), (x + 1 < w).then_some(-1)];
        for j in
            above.into_iter().flatten().filter_map(|k| i.checked_sub(w)?.checked_add_signed(-k))
        {
            if labels[j] == own {
                join(&mut root, i as u32, j as u32);
            }
        }
    }
    for i in (0..n).step_by(w).filter(|_| image.is_ring) {
        if labels[i] != NOBODY && labels[i + w - 1] == labels[i] {
            join(&mut root, i as u32, (i + w - 1) as u32);
        }
    }
    let mut numbers = vec![NOBODY; n];
    let mut count = 0;
    let mut parts = vec![NOBODY; n];
    for i in (0..n).filter(|&i| labels[i] != NOBODY) {
        let at = find(&mut root, i as u32) as usize;
        if numbers[at] == NOBODY {
            numbers[at] = count;
            count += 1;
        }
        parts[i] = numbers[at];
    }
    (parts, count as usize)
}

fn find(root: &mut [u32], mut i: u32) -> u32 {
    while root[i as usize] != i {
        root[i as usize] = root[root[i as usize] as usize];
        i = root[i as usize];
    }
    i
}

/// The lower place is the root.
fn join(root: &mut [u32], a: u32, b: u32) {
    let (a, b) = (find(root, a), find(root, b));
    root[a.max(b) as usize] = a.min(b);
}
