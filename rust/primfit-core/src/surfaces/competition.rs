//! Surfaces as sets of labelled points: which belongs to which, which two are one, of which kind.

use super::bending::Flatness;
use super::cloud::{Cloud, FAR, square};
use super::growing::{NOBODY, worth};
use super::surface::{Kind, Surface};
use super::vectors::along;
use crate::{Error, Workers};
use rayon::prelude::{IntoParallelRefIterator, ParallelIterator};
use std::collections::BTreeSet;

/// Points that a surface is fitted to between two competitions.
const MOST_FITTED: usize = 3000;
/// Points of another surface that are looked at before both are fitted together.
const LOOKED_AT: usize = 64;
/// Mean square misfit of those from which they are not.
const UNLIKE: f64 = 4.0;
/// Rise of the cost of each point, beyond the price of the parameters, up to which two are one.
const RISE: f64 = 0.02;
/// What a point without a surface costs, in the units of squared standard deviations.
const ALONE: f64 = FAR;
/// Weight of the share of neighbours, and least share.
const NEIGHBORS: f64 = 2.0;
const LEAST_SHARE: f64 = 0.02;

/// Points of each label, rising.
pub fn members(labels: &[i32], n: usize) -> Vec<Vec<u32>> {
    let mut members = vec![Vec::new(); n];
    for (place, &label) in (0..).zip(labels) {
        if label != NOBODY {
            members[label as usize].push(place);
        }
    }
    members
}

/// Sweeps in which each point takes the best label among its neighbours', or none. All look at the
/// labels of the last sweep (an auto-logistic prior, as in the competition of planes); those near
/// which none changed in it would choose as before.
///
/// # Errors
/// [`Error::Stopped`] when the caller does not want to go on.
pub fn compete(
    cloud: &Cloud,
    labels: &[i32],
    surfaces: &[Surface],
    n_sweeps: usize,
    workers: &Workers,
) -> Result<Vec<i32>, Error> {
    let mut labels = labels.to_vec();
    let mut has_changed = vec![true; labels.len()];
    for _ in 0..n_sweeps {
        let next = swept(cloud, &labels, surfaces, &has_changed, workers)?;
        for ((changed, new), old) in has_changed.iter_mut().zip(&next).zip(&labels) {
            *changed = new != old;
        }
        labels = next;
        if !has_changed.contains(&true) {
            break;
        }
    }
    Ok(labels)
}

fn swept(
    cloud: &Cloud,
    labels: &[i32],
    surfaces: &[Surface],
    has_changed: &[bool],
    workers: &Workers,
) -> Result<Vec<i32>, Error> {
    let mut next = labels.to_vec();
    workers.fill(&mut next, 1, Vec::<(i32, f64)>::new, |counts, i, best| {
        let near = cloud.graph.of(i);
        if !has_changed[i] && !near.iter().any(|&other| has_changed[other as usize]) {
            return;
        }
        counts.clear();
        counts.push((NOBODY, 0.0));
        for label in near.iter().map(|&other| labels[other as usize]).chain([labels[i]]) {
            match counts.iter_mut().find(|entry| entry.0 == label) {
                Some(entry) => entry.1 += 1.0,
                None => counts.push((label, 1.0)),
            }
        }
        best[0] = NOBODY;
        if counts.len() == 1 {
            return;
        }
        let at = |label: i32, place: usize| {
            square(&surfaces[label as usize], &cloud.points[place], cloud.sigma[place])
        };
        counts.retain(|entry| entry.0 == NOBODY || at(entry.0, i) <= FAR);
        counts.sort_by_key(|entry| entry.0);
        // Where surfaces touch without an edge a point alone cannot tell whose it is.
        let is_shared = counts.iter().filter(|entry| entry.0 != NOBODY).count() > 1;
        let all = near.len() as f64 + 1.0;
        let mut least = f64::INFINITY;
        for &(label, count) in counts.iter() {
            let cost = if label == NOBODY {
                ALONE
            } else if is_shared {
                let others = near.iter().map(|&other| at(label, other as usize).min(FAR));
                (others.sum::<f64>() + at(label, i)) / all
            } else {
                at(label, i)
            };
            let cost = 0.5 * cost - NEIGHBORS * (count / all + LEAST_SHARE).ln();
            if cost < least {
                (least, best[0]) = (cost, label);
            }
        }
    })?;
    Ok(next)
}

/// Which points lie where their surface meets another that it touches: whose foot on theirs is within
/// three standard deviations of the other. Such a point may be the other's; of feet, which errors
/// across the surface do not move, a choice makes no bias.
///
/// # Errors
/// [`Error::Stopped`] when the caller does not want to go on.
pub fn shared(
    cloud: &Cloud,
    labels: &[i32],
    surfaces: &[Surface],
    workers: &Workers,
) -> Result<Vec<bool>, Error> {
    let mut touching = vec![BTreeSet::new(); surfaces.len()];
    for (place, &label) in labels.iter().enumerate().filter(|pair| *pair.1 != NOBODY) {
        for &other in cloud.graph.of(place) {
            let other = labels[other as usize];
            if other != NOBODY && other != label {
                touching[label as usize].insert(other as usize);
                touching[other as usize].insert(label as usize);
            }
        }
    }
    let mut shared = vec![false; labels.len()];
    workers.fill(
        &mut shared,
        1,
        || (),
        |(), i, shared| {
            if labels[i] == NOBODY {
                return;
            }
            let own = labels[i] as usize;
            let at = surfaces[own].sight(&cloud.points[i]);
            let foot = along(&cloud.points[i], &at.normal, -at.distance);
            let is_near = |other: &usize| square(&surfaces[*other], &foot, cloud.sigma[i]) <= FAR;
            shared[0] = touching[own].iter().any(is_near);
        },
    )?;
    Ok(shared)
}

/// Members without those that are shared, where most are not.
pub fn without(mut members: Vec<Vec<u32>>, is_shared: &[bool]) -> Vec<Vec<u32>> {
    for own in &mut members {
        let n_shared = own.iter().filter(|&&place| is_shared[place as usize]).count();
        if 2 * n_shared < own.len() {
            own.retain(|&place| !is_shared[place as usize]);
        }
    }
    members
}

/// Each surface fitted to its points, of the kind that is worth its parameters.
pub fn refitted(
    cloud: &Cloud,
    members: &[Vec<u32>],
    surfaces: &[Surface],
    workers: &Workers,
) -> Vec<Surface> {
    let numbers: Vec<usize> = (0..surfaces.len()).collect();
    workers.install(|| {
        numbers
            .par_iter()
            .map(|&i| chosen(cloud, &members[i], &[surfaces[i]]).map_or(surfaces[i], |best| best.1))
            .collect()
    })
}

/// The kind that is worth its parameters for some points, with its cost; known surfaces are starts too.
fn chosen(cloud: &Cloud, places: &[u32], known: &[Surface]) -> Option<(f64, Surface)> {
    if places.len() <= Kind::Torus.n_parameters() {
        return None;
    }
    let sample = cloud.sample(places, MOST_FITTED);
    let scale = places.len() as f64 / sample.points.len() as f64;
    let n = places.len() as f64;
    let pairs = sample.points.iter().zip(sample.sigma.iter().copied());
    let is_flat = Flatness::of(places.len(), pairs).is_some_and(|flat| flat.is_flat(cloud.area));
    let kinds = if is_flat { &Kind::ALL[..1] } else { &Kind::ALL[..] };
    let mut best: Option<(f64, Surface)> = None;
    for &kind in kinds {
        let starts = known.iter().filter(|one| one.kind == kind).map(|one| Some(*one));
        let found = starts
            .chain([None])
            .filter_map(|start| sample.fitted(kind, start))
            .map(|surface| {
                let squares = sample.squares(&surface).map(|square| square.min(FAR));
                (scale * squares.sum::<f64>(), surface)
            })
            .min_by(|a, b| a.0.total_cmp(&b.0));
        let Some(found) = found else { continue };
        best = Some(match best {
            Some(best) if best.0 - found.0 < worth(best.1.kind, kind, n, cloud.area) => best,
            _ => found,
        });
    }
    best
}

/// Puts surfaces together that one explains: those that touch, and curved ones over gaps.
///
/// # Errors
/// [`Error::Stopped`] when the caller does not want to go on.
pub fn merged(
    cloud: &Cloud,
    labels: &mut [i32],
    surfaces: &mut [Surface],
    workers: &Workers,
) -> Result<(), Error> {
    let mut own = members(labels, surfaces.len());
    let mut order: Vec<usize> = (0..surfaces.len()).filter(|&i| !own[i].is_empty()).collect();
    order.sort_by_key(|&i| (usize::MAX - own[i].len(), i));
    let mut into: Vec<usize> = (0..surfaces.len()).collect();
    for (rank, &i) in order.iter().enumerate() {
        workers.check()?;
        if into[i] != i {
            continue;
        }
        for &j in &order[rank + 1..] {
            if into[j] != j {
                continue;
            }
            let touching = touch(cloud, labels, i as i32, &own[j]);
            let are_flat = surfaces[i].kind == Kind::Plane || surfaces[j].kind == Kind::Plane;
            let alike =
                is_near(cloud, &surfaces[i], &own[j]) || is_near(cloud, &surfaces[j], &own[i]);
            // Strips of a torus are cylinders that do not look alike.
            if !(touching && (alike || !are_flat) || alike && !are_flat) {
                continue;
            }
            let mut both = [own[i].as_slice(), own[j].as_slice()].concat();
            both.sort_unstable();
            let known = [surfaces[i], surfaces[j]];
            let Some((cost, surface)) = workers.install(|| chosen(cloud, &both, &known)) else {
                continue;
            };
            let apart =
                cost_of(cloud, &surfaces[i], &own[i]) + cost_of(cloud, &surfaces[j], &own[j]);
            let n = both.len() as f64;
            let n_fewer = known.iter().map(|one| one.kind.n_parameters()).sum::<usize>() as f64
                - surface.kind.n_parameters() as f64;
            if cost - apart <= (n_fewer + 2.0) * cloud.area * n.ln() + RISE * n {
                surfaces[i] = surface;
                into[j] = i;
                for &place in &own[j] {
                    labels[place as usize] = i as i32;
                }
                own[i] = both;
                own[j].clear();
            }
        }
    }
    Ok(())
}

fn cost_of(cloud: &Cloud, surface: &Surface, places: &[u32]) -> f64 {
    let cost = |&place: &u32| {
        let place = place as usize;
        square(surface, &cloud.points[place], cloud.sigma[place]).min(FAR)
    };
    places.iter().map(cost).sum()
}

/// Whether some points lie about on a surface.
fn is_near(cloud: &Cloud, surface: &Surface, places: &[u32]) -> bool {
    cloud.sample(places, LOOKED_AT).misfit(surface) < UNLIKE
}

/// Whether any of some points touches one with a label.
fn touch(cloud: &Cloud, labels: &[i32], label: i32, places: &[u32]) -> bool {
    let touches = |place: &u32| {
        cloud.graph.of(*place as usize).iter().any(|&other| labels[other as usize] == label)
    };
    places.iter().any(touches)
}

/// Numbers of the labels with at least `least` points, the most first, and their surfaces.
pub fn numbered(labels: &mut [i32], surfaces: &[Surface], least: usize) -> Vec<Surface> {
    let sizes: Vec<usize> = members(labels, surfaces.len()).iter().map(Vec::len).collect();
    let mut order: Vec<usize> = (0..surfaces.len()).filter(|&i| sizes[i] >= least).collect();
    order.sort_by_key(|&i| (usize::MAX - sizes[i], i));
    let mut numbers = vec![NOBODY; surfaces.len()];
    for (number, &i) in (0..).zip(&order) {
        numbers[i] = number;
    }
    for label in labels.iter_mut().filter(|label| **label != NOBODY) {
        *label = numbers[*label as usize];
    }
    order.iter().map(|&i| surfaces[i]).collect()
}
