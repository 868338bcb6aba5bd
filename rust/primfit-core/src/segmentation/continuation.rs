//! Patches of curved surfaces that pass for planes: beyond their borders the surface goes on.

use super::context::Context;
use super::curvature::{Bend, Heights};
use super::growth::NOBODY;
use super::regions::{Members, Region};
use crate::spread::Spread;
use crate::{Error, Workers};
use std::collections::HashSet;

/// The labels of planes without those that are patches of curved surfaces, in the same order.
///
/// # Errors
/// [`Error::Stopped`] when the caller does not want to go on.
pub fn without_patches(
    context: &Context,
    labels: &[i32],
    workers: &Workers,
) -> Result<Vec<i32>, Error> {
    let regions = context.fit(labels, workers);
    let members = Members::of(labels);
    let planes: Vec<Spread> = regions.iter().map(Region::spread).collect();
    let mut is_patch = vec![false; regions.len()];
    workers.fill(
        &mut is_patch,
        1,
        || (),
        |(), k, is_patch| {
            let sigma = regions[k].sigma(&planes[k], context.surfaces, context.settings);
            let bend = continued(context, labels, members.get(k), &planes, sigma);
            is_patch[0] = bend.is_some();
        },
    )?;
    let mut n = 0;
    let number = |&is_patch: &bool| {
        n += i32::from(!is_patch);
        if is_patch { NOBODY } else { n - 1 }
    };
    let numbers: Vec<i32> = is_patch.iter().map(number).collect();
    Ok(labels.iter().map(|&k| if k == NOBODY { k } else { numbers[k as usize] }).collect())
}

/// How much the surface bends of which a region is a patch; None when it is none.
///
/// The paraboloid of its points takes what touches it and lies on it, step by step, of no plane or
/// of others. Beyond the border of a plane is nothing, an edge, or another plane; a patch has a
/// surface around it that the paraboloid explains at least as well as all those planes do, with
/// fewer parameters.
fn continued(
    context: &Context,
    labels: &[i32],
    places: &[u32],
    planes: &[Spread],
    sigma: f64,
) -> Option<Bend> {
    let (points, graph, settings) = (context.points(), context.graph, context.settings);
    let own = labels[places[0] as usize];
    let mut heights = Heights::over(&planes[own as usize]);
    for &place in places {
        heights.add(&points[place as usize]);
    }
    let n_own = heights.count();
    let mut enough = settings.curvature.growth * n_own;
    let mut seen = HashSet::new();
    let mut all = places.to_vec();
    let mut rim = 0..all.len();
    for _ in 0..settings.curvature.steps {
        let surface = heights.paraboloid()?;
        for at in rim.clone() {
            for &other in graph.of(all[at] as usize) {
                if labels[other as usize] != own
                    && heights.above(&surface, &points[other as usize]).abs()
                        <= settings.curvature.on * sigma
                    && seen.insert(other)
                {
                    all.push(other);
                }
            }
        }
        if rim.end == all.len() {
            return None;
        }
        rim = rim.end..all.len();
        for &place in &all[rim.clone()] {
            heights.add(&points[place as usize]);
        }
        if heights.count() >= enough {
            let bend = heights.bend().filter(|bend| bend.is_clear(&settings.curvature));
            if bend.is_some_and(|_| is_better(context, labels, &all, planes, sigma, &heights)) {
                return bend;
            }
            enough = settings.curvature.growth * heights.count();
            if enough > settings.curvature.most_growth * n_own {
                return None;
            }
        }
    }
    None
}

/// Whether a paraboloid explains points as well as their planes do, by the Bayesian information
/// criterion. Points of no plane are those of the first, or farther off than any has.
fn is_better(
    context: &Context,
    labels: &[i32],
    places: &[u32],
    planes: &[Spread],
    sigma: f64,
    heights: &Heights,
) -> bool {
    let Some(surface) = heights.paraboloid() else { return false };
    let reach = context.settings.competition.reach;
    let first = labels[places[0] as usize];
    let mut used = HashSet::new();
    let (mut flat, mut curved) = (0.0, 0.0);
    for &place in places {
        let point = &context.points()[place as usize];
        let label = if labels[place as usize] == NOBODY { first } else { labels[place as usize] };
        used.insert(label);
        flat += (planes[label as usize].distance(point) / sigma).powi(2).min(reach * reach);
        curved += (heights.above(&surface, point) / sigma).powi(2);
    }
    let price = (places.len() as f64).ln();
    curved + 6.0 * price < flat + 3.0 * used.len() as f64 * price
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::super::settings::Settings;
    use super::*;
    use crate::Vector;
    use crate::neighbors::PointTree;
    use crate::segmentation::graph::Graph;
    use crate::segmentation::roughness::Surfaces;

    const GO_ON: fn() -> bool = || true;
    const NOISE: f64 = 0.005;

    /// 60 x 60 points whose height over a sheet of 2 m is `off`, moved by `shift`.
    fn sheet(shift: f64, place: impl Fn(f64, f64, f64) -> Vector) -> Vec<Vector> {
        (0..3600_u32)
            .map(|i| {
                let (u, v) = (f64::from(i % 60) / 30.0 - 1.0, f64::from(i / 60) / 30.0 - 1.0);
                let off = NOISE * 1.7 * f64::from(i).powi(2).sin();
                place(u, v, off).map(|x| x + shift)
            })
            .collect()
    }

    /// What is left of the labels `label` gives to points.
    fn left(points: &[Vector], label: impl Fn(&Vector) -> i32) -> Vec<(Vector, i32)> {
        let workers = Workers::new(Some(1), &GO_ON).unwrap();
        let tree = PointTree::new(points);
        let graph = Graph::new(&tree, 10, 32, &workers).unwrap();
        let labels: Vec<i32> = tree.points().iter().map(label).collect();
        let noise = vec![NOISE as f32; points.len()];
        let (tree, graph, noise) = (&tree, &graph, &noise[..]);
        let context = Context {
            tree,
            graph,
            noise,
            surfaces: Surfaces::Smooth,
            settings: &Settings::default(),
        };
        let left = without_patches(&context, &labels, &workers);
        tree.points().iter().copied().zip(left.unwrap()).collect()
    }

    #[test]
    fn a_strip_of_a_cylinder_goes_and_planes_are_numbered_again() {
        let bent = |u: f64, v, off| [(1.0 + off) * u.cos(), (1.0 + off) * u.sin(), v];
        let mut points = sheet(0.0, bent);
        points.extend(sheet(10.0, |u, v, off| [u, v, off]));
        let strip = |p: &Vector| p[0] < 5.0 && p[1].abs() < 0.15;
        let label = |p: &Vector| match p {
            p if strip(p) => 0,
            p if p[0] > 5.0 => 1,
            _ => NOBODY,
        };
        for (point, label) in left(&points, label) {
            assert_eq!(label, if point[0] > 5.0 { 0 } else { NOBODY });
        }
    }

    #[test]
    fn a_face_stays_beside_another_that_has_no_label() {
        let fold = |u: f64, v, off: f64| if u < 0.0 { [u, v, off] } else { [off, v, -u] };
        let is_face = |p: &Vector| p[2].abs() < 3.0 * NOISE;
        let label = |p: &Vector| if is_face(p) { 0 } else { NOBODY };
        assert!(left(&sheet(0.0, fold), label).iter().all(|(p, found)| *found == label(p)));
    }

    #[test]
    fn half_of_a_plane_stays_whatever_the_other_half_is() {
        let label = |p: &Vector| if p[0] < 0.0 { 0 } else { NOBODY };
        let points = sheet(0.0, |u, v, off| [u, v, off]);
        assert!(left(&points, label).iter().all(|(p, found)| *found == label(p)));
    }
}
