//! The surfaces of a cloud: planes, spheres, cylinders, cones and tori in competition.

use super::bending::Flatness;
use super::cloud::{Cloud, square};
use super::competition::{compete, members, merged, numbered, refitted, shared, without};
use super::contrast::are_clear;
use super::growing::{Flood, Grown, NOBODY, best_of};
use super::hypotheses::{EXPLAINED, Seed, hypotheses, smooth_hypotheses};
use super::surface::{Kind, Surface};
use crate::neighbors::{PointTree, Search as Near};
use crate::{Error, Vector, Workers};
use rayon::prelude::{IndexedParallelIterator, IntoParallelRefMutIterator, ParallelIterator};

/// Points outside of planes that surfaces are looked for around.
const SEEDS: usize = 700;
/// What is outside of planes is searched by itself first where that is at most one of so many points:
/// it costs as small a share of what is saved where nothing curved is among them.
const PROBED: usize = 4;
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
/// Points of a flat part that tells how many points err as one.
const TELLS_AREA: usize = 150;
/// Bytes of a point that the search takes.
const BYTES: usize = 480;

/// The surfaces of a cloud.
pub struct Surfaces {
    /// Those found, the one with the most points first.
    pub surfaces: Vec<Surface>,
    /// Surface of each point in the order of the tree; -1 for none.
    pub labels: Vec<i32>,
    /// Whether it lies where its surface meets another one.
    pub is_shared: Vec<bool>,
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
        return Ok(Surfaces { surfaces: Vec::new(), labels, is_shared: vec![false; n] });
    }
    let parts = FlatPart::all(tree, sigma, parts, workers)?;
    let area = FlatPart::usual_area(&parts);
    let is_whole = |part: &&FlatPart| part.is_whole && part.members.len() >= least;
    let mut rest = vec![true; n];
    for part in parts.iter().filter(is_whole) {
        part.members.iter().for_each(|&place| rest[place as usize] = false);
    }
    let rest: Vec<u32> = (0..n as u32).filter(|&place| rest[place as usize]).collect();
    if PROBED * rest.len() <= n && !bends(tree.points(), sigma, area, &rest, least, workers)? {
        for (number, part) in (0..).zip(&parts) {
            part.members.iter().for_each(|&place| labels[place as usize] = number);
        }
        let planes: Vec<Surface> = parts.iter().map(|part| part.flatness.plane).collect();
        let surfaces = numbered(&mut labels, &planes, least);
        return Ok(Surfaces { surfaces, labels, is_shared: vec![false; n] });
    }
    let cloud = Cloud::new(tree, sigma, area, workers)?;
    let mut search = Search::new(&cloud, least);
    for part in parts.iter().filter(is_whole) {
        search.take(&part.members, part.flatness.plane);
    }
    search.run(tree, &rest, workers)?;
    search.take_parts(&parts);
    let Search { mut surfaces, mut labels, .. } = search;
    for _ in 0..ROUNDS {
        merged(&cloud, &mut labels, &mut surfaces, workers)?;
        labels = compete(&cloud, &labels, &surfaces, SWEEPS, workers)?;
        surfaces = numbered(&mut labels, &surfaces, least);
        let is_shared = shared(&cloud, &labels, &surfaces, workers)?;
        let own = without(members(&labels, surfaces.len()), &is_shared);
        surfaces = refitted(&cloud, &own, &surfaces, workers);
        workers.check()?;
    }
    labels = compete(&cloud, &labels, &surfaces, 1, workers)?;
    let own = members(&labels, surfaces.len());
    let clear = are_clear(tree, &cloud, &own, &surfaces, workers)?;
    for label in labels.iter_mut().filter(|label| **label != NOBODY && !clear[**label as usize]) {
        *label = NOBODY;
    }
    let surfaces = numbered(&mut labels, &surfaces, least);
    let is_shared = shared(&cloud, &labels, &surfaces, workers)?;
    Ok(Surfaces { surfaces, labels, is_shared })
}

/// A flat part of the cloud.
struct FlatPart {
    members: Vec<u32>,
    flatness: Flatness,
    /// Whether it is a plane, and no cut of a curved surface.
    is_whole: bool,
    /// Number of points whose errors are one.
    area: f64,
}

impl FlatPart {
    /// Those of which no three points are on a line, by their labels.
    fn all(
        tree: &PointTree,
        sigma: &[f64],
        labels: &[i32],
        workers: &Workers,
    ) -> Result<Vec<Self>, Error> {
        let n_parts = labels.iter().max().map_or(0, |&most| (most + 1) as usize);
        let own = members(labels, n_parts);
        let mut found: Vec<Option<(Flatness, bool, f64)>> = (0..n_parts).map(|_| None).collect();
        workers.fill(&mut found, 1, Near::default, |search, i, found| {
            let points = tree.points();
            let pairs = own[i].iter().map(|&at| (&points[at as usize], sigma[at as usize]));
            found[0] = Flatness::of(own[i].len(), pairs).map(|flatness| {
                let is_whole = flatness.is_whole(tree, sigma, &own[i], labels, search);
                let area = flatness.area(tree, sigma, &own[i], labels, search);
                (flatness, is_whole, area)
            });
        })?;
        let pairs = own.into_iter().zip(found);
        let parts = pairs.filter_map(|(members, found)| {
            let (flatness, is_whole, area) = found?;
            Some(Self { members, flatness, is_whole, area })
        });
        Ok(parts.collect())
    }

    /// Number of points whose errors are one: the median over those in parts that tell.
    fn usual_area(parts: &[Self]) -> f64 {
        let mut areas: Vec<(f64, usize)> = parts
            .iter()
            .filter(|part| part.members.len() >= TELLS_AREA)
            .map(|part| (part.area, part.members.len()))
            .collect();
        areas.sort_by(|a, b| a.0.total_cmp(&b.0));
        let half = areas.iter().map(|pair| pair.1).sum::<usize>() / 2;
        let mut below = 0;
        let middle = areas.iter().find(|pair| {
            below += pair.1;
            below > half
        });
        middle.map_or(1.0, |pair| pair.0)
    }
}

/// Whether some points of a cloud, by themselves, hold a curved surface.
fn bends(
    points: &[Vector],
    sigma: &[f64],
    area: f64,
    some: &[u32],
    least: usize,
    workers: &Workers,
) -> Result<bool, Error> {
    if some.len() < least.max(Kind::Torus.n_parameters() + 1) {
        return Ok(false);
    }
    let own: Vec<Vector> = some.iter().map(|&place| points[place as usize]).collect();
    let tree = PointTree::within_memory(&own, workers)?;
    let sigma: Vec<f64> =
        tree.rows().iter().map(|&row| sigma[some[row as usize] as usize]).collect();
    let cloud = Cloud::new(&tree, &sigma, area, workers)?;
    let mut search = Search::new(&cloud, least);
    search.run(&tree, &(0..own.len() as u32).collect::<Vec<u32>>(), workers)?;
    Ok(search.surfaces.iter().any(|surface| surface.kind != Kind::Plane))
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
    labels: Vec<i32>,
    surfaces: Vec<Surface>,
    floods: Vec<Flood>,
}

impl<'a> Search<'a> {
    fn new(cloud: &'a Cloud<'a>, least: usize) -> Self {
        let n = cloud.points.len();
        let floods = Kind::ALL.map(|_| Flood::new(n)).into();
        Self { cloud, least, labels: vec![NOBODY; n], surfaces: Vec::new(), floods }
    }

    /// Surfaces from small neighbourhoods of some places, then from smooth balls of what is left.
    fn run(&mut self, tree: &PointTree, places: &[u32], workers: &Workers) -> Result<(), Error> {
        let some = evenly(places, SEEDS);
        let first = hypotheses(tree, self.cloud, &self.labels, &some, workers)?;
        self.grow_all(first, EXPLAINED, workers)?;
        for size in BALLS {
            let free: Vec<u32> =
                places.iter().copied().filter(|&at| self.labels[at as usize] == NOBODY).collect();
            let some = evenly(&free, N_BALLS);
            let balls =
                smooth_hypotheses(self.cloud, &self.labels, &some, size, EXPLAINED_BALL, workers)?;
            self.grow_all(balls, EXPLAINED_BALL, workers)?;
        }
        Ok(())
    }

    fn take(&mut self, members: &[u32], surface: Surface) {
        let number = self.surfaces.len() as i32;
        for &place in members {
            self.labels[place as usize] = number;
        }
        self.surfaces.push(surface);
    }

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
        self.take(&members, surface);
    }

    /// Flat parts that are still free become planes as they are.
    fn take_parts(&mut self, parts: &[FlatPart]) {
        for FlatPart { members: part, .. } in parts {
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
            self.take(&free, surface);
        }
    }
}
