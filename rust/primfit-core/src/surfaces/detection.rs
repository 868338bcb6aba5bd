//! The surfaces of a cloud: planes, spheres, cylinders, cones and tori in competition.

use super::cloud::{Cloud, square};
use super::competition::{compete, members, merged, numbered, refitted};
use super::contrast::are_clear;
use super::growing::{Flood, Grown, NOBODY, best_of};
use super::hypotheses::{EXPLAINED, Seed, hypotheses, smooth_hypotheses};
use super::surface::{Kind, Surface};
use crate::neighbors::PointTree;
use crate::{Error, Workers};
use rayon::prelude::{IndexedParallelIterator, IntoParallelRefMutIterator, ParallelIterator};

/// Points outside of planes, and within them, that surfaces are looked for around.
const SEEDS: usize = 700;
const SEEDS_WITHIN: usize = 90;
/// Points of the smooth balls that what is left starts again from, and how many there are of each.
const BALLS: [usize; 4] = [6000, 2000, 600, 150];
const N_BALLS: usize = 96;
/// Mean square misfit that such a ball may have: 1.3 standard deviations.
const EXPLAINED_BALL: f64 = 1.69;
/// Share of a seed's points that must be free.
const FREE: f64 = 0.5;
/// Share of a flat part that must be free for it to become a plane as it is.
const FREE_PART: f64 = 0.7;
/// Rounds of merging, competition and refits, and sweeps of competition in each.
const ROUNDS: usize = 3;
const SWEEPS: usize = 6;
/// Bytes of a point that the search takes.
const BYTES: usize = 480;

/// The surfaces of a cloud.
pub struct Surfaces {
    /// Those found, the one with the most points first.
    pub surfaces: Vec<Surface>,
    /// Surface of each point in the order of the tree; -1 for none.
    pub labels: Vec<i32>,
}

/// Finds surfaces with at least `least` points; `sigma` is the noise of each point and `parts` its
/// flat part, -1 for none, in the order of the tree.
///
/// # Errors
/// [`Error::Stopped`] when the caller does not want to go on.
pub fn detect(
    tree: &PointTree,
    sigma: &[f64],
    parts: &[i32],
    least: usize,
    workers: &Workers,
) -> Result<Surfaces, Error> {
    let n = tree.points().len();
    workers.room(BYTES * n)?;
    let mut labels = vec![NOBODY; n];
    if n < least.max(Kind::Torus.n_parameters() + 1) {
        return Ok(Surfaces { surfaces: Vec::new(), labels });
    }
    let cloud = Cloud::new(tree, sigma, workers)?;
    let n_parts = parts.iter().max().map_or(0, |&most| (most + 1) as usize);
    let parts = members(parts, n_parts);
    let mut search = Search {
        cloud: &cloud,
        least,
        labels: &mut labels,
        surfaces: Vec::new(),
        floods: Kind::ALL.map(|_| Flood::new(n)).into(),
    };
    let first = hypotheses(tree, &cloud, &places(&parts, n), workers)?;
    search.grow_all(first, EXPLAINED, workers)?;
    for size in BALLS {
        let free: Vec<u32> =
            (0..n as u32).filter(|&place| search.labels[place as usize] == NOBODY).collect();
        let some: Vec<u32> = evenly(&free, N_BALLS);
        let balls = smooth_hypotheses(&cloud, search.labels, &some, size, EXPLAINED_BALL, workers)?;
        search.grow_all(balls, EXPLAINED_BALL, workers)?;
    }
    search.take_parts(&parts);
    let mut surfaces = search.surfaces;
    for _ in 0..ROUNDS {
        merged(&cloud, &mut labels, &mut surfaces, workers)?;
        for _ in 0..SWEEPS {
            labels = compete(&cloud, &labels, &surfaces, workers)?;
        }
        surfaces = numbered(&mut labels, &surfaces, least);
        surfaces = refitted(&cloud, &members(&labels, surfaces.len()), &surfaces, workers);
        workers.check()?;
    }
    labels = compete(&cloud, &labels, &surfaces, workers)?;
    let own = members(&labels, surfaces.len());
    let clear = are_clear(tree, &cloud, &own, &surfaces, workers)?;
    for label in labels.iter_mut().filter(|label| **label != NOBODY && !clear[**label as usize]) {
        *label = NOBODY;
    }
    let surfaces = numbered(&mut labels, &surfaces, least);
    Ok(Surfaces { surfaces, labels })
}

/// Where surfaces are looked for: outside of flat parts, in each of them, and in the large ones more.
fn places(parts: &[Vec<u32>], n: usize) -> Vec<u32> {
    let mut is_flat = vec![false; n];
    let flat: Vec<u32> = parts.concat();
    for &place in &flat {
        is_flat[place as usize] = true;
    }
    let others: Vec<u32> = (0..n as u32).filter(|&place| !is_flat[place as usize]).collect();
    let mut places = evenly(&others, SEEDS);
    places.extend(evenly(&flat, SEEDS_WITHIN));
    places.extend(parts.iter().filter_map(|part| part.get(part.len() / 2)));
    places.sort_unstable();
    places.dedup();
    places
}

/// At most so many of some places.
fn evenly(places: &[u32], most: usize) -> Vec<u32> {
    let n = places.len().min(most);
    (0..n).map(|i| places[i * places.len() / n]).collect()
}

/// Surfaces that grow one after the other.
struct Search<'a> {
    cloud: &'a Cloud<'a>,
    least: usize,
    labels: &'a mut Vec<i32>,
    surfaces: Vec<Surface>,
    floods: Vec<Flood>,
}

impl Search<'_> {
    /// Lets the surfaces of each seed grow, and takes the best where it explains its points.
    fn grow_all(
        &mut self,
        seeds: Vec<Seed>,
        explained: f64,
        workers: &Workers,
    ) -> Result<(), Error> {
        for seed in seeds {
            workers.check()?;
            let is_free = |place: &&u32| self.labels[**place as usize] == NOBODY;
            let n_free = seed.start.iter().filter(is_free).count() as f64;
            if self.labels[seed.place as usize] != NOBODY || n_free < FREE * seed.start.len() as f64
            {
                continue;
            }
            if let Some(best) = workers.install(|| self.grown(&seed)) {
                self.accept(best, explained);
            }
        }
        Ok(())
    }

    fn grown(&mut self, seed: &Seed) -> Option<Grown> {
        let Self { cloud, labels, floods, .. } = self;
        let (cloud, labels): (&Cloud, &[i32]) = (cloud, labels);
        let grown: Vec<Option<Grown>> = floods[..seed.surfaces.len()]
            .par_iter_mut()
            .zip(&seed.surfaces)
            .map(|(flood, first)| flood.grow(cloud, labels, seed.place, &seed.start, *first))
            .collect();
        best_of(cloud, grown.into_iter().flatten().collect())
    }

    fn accept(&mut self, grown: Grown, explained: f64) {
        let Grown { surface, members } = grown;
        let squares = members.iter().map(|&place| {
            let place = place as usize;
            square(&surface, &self.cloud.points[place], self.cloud.sigma[place])
        });
        if members.len() < self.least || squares.sum::<f64>() > explained * members.len() as f64 {
            return;
        }
        let number = self.surfaces.len() as i32;
        for &place in &members {
            self.labels[place as usize] = number;
        }
        self.surfaces.push(surface);
    }

    /// Flat parts that are still free become planes as they are.
    fn take_parts(&mut self, parts: &[Vec<u32>]) {
        for part in parts {
            let free: Vec<u32> = part
                .iter()
                .copied()
                .filter(|&place| self.labels[place as usize] == NOBODY)
                .collect();
            if (free.len() as f64) < FREE_PART * part.len() as f64 || free.len() < self.least {
                continue;
            }
            let sample = self.cloud.sample(&free, usize::MAX);
            let Some(surface) = sample.fitted(Kind::Plane, None) else { continue };
            let number = self.surfaces.len() as i32;
            for &place in &free {
                self.labels[place as usize] = number;
            }
            self.surfaces.push(surface);
        }
    }
}
