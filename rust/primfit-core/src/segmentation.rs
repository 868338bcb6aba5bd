//! The planes of a cloud of which nothing is known: grown, in competition, cut, merged, tested.

mod acceptance;
mod context;
mod continuation;
pub(crate) mod curvature;
pub(crate) mod graph;
mod growth;
mod merging;
mod noise;
mod pieces;
mod regions;
mod roughness;
mod rows;
pub(crate) mod settings;
mod splitting;
mod strips;

use crate::neighbors::PointTree;
use crate::neighbors::normals::{LocalPlane, THICKEST};
use crate::{Error, Vector, Workers};
use acceptance::{accept, accept_parts};
use context::Context;
use continuation::without_patches;
use graph::Graph;
use growth::{FEWEST, NOBODY, Seed, grow};
use merging::merge;
use noise::{common_noise, spread_noise, without_steps};
use pieces::pieces;
use regions::compete;
use roughness::Surfaces;
pub use settings::Settings as SegmentationSettings;
use splitting::split;
use strips::join_strips;

/// Bytes of a point that the search takes at most, where each touches as many others as it may.
const BYTES: usize = 640;

/// The planes of a cloud.
pub struct Segmentation {
    /// Plane of each point in the order of the tree, numbered by falling size; -1 for none.
    pub labels: Vec<i32>,
    /// Noise around each point, given or estimated.
    pub sigma: Vec<f64>,
    /// Nearest points that a point touches.
    pub n_nearest: usize,
    /// One point in so many was enough to find the planes.
    pub stride: usize,
    surfaces: Surfaces,
}

/// Segments the points of a tree; `sigma` is the noise of each in the order of the tree, if known.
///
/// # Errors
/// [`Error::Stopped`] when the caller does not want to go on.
pub fn segment(
    tree: &PointTree,
    sigma: Option<&[f64]>,
    settings: &SegmentationSettings,
    workers: &Workers,
) -> Result<Segmentation, Error> {
    workers.room(BYTES * tree.points().len())?;
    if tree.points().len() < FEWEST {
        let n = tree.points().len();
        let sigma = sigma.map_or_else(|| vec![0.0; n], <[f64]>::to_vec);
        let labels = vec![NOBODY; n];
        return Ok(Segmentation {
            labels,
            sigma,
            n_nearest: 0,
            stride: 1,
            surfaces: Surfaces::Smooth,
        });
    }
    let stride = rows::stride(tree, &settings.rows);
    if stride == 1 {
        return segment_evenly(tree, sigma, settings, workers);
    }
    let points: Vec<Vector> = tree.points().iter().copied().step_by(stride).collect();
    let some = PointTree::new(&points);
    let own = |sigma: &[f64]| some.rows().iter().map(|&row| sigma[row as usize * stride]).collect();
    let own_sigma: Option<Vec<f64>> = sigma.map(own);
    let found = segment_evenly(&some, own_sigma.as_deref(), settings, workers)?;
    rows::told(tree, sigma, &some, &Segmentation { stride, ..found }, settings, workers)
}

/// The same for at least `FEWEST` points about as dense in all directions along the surface.
fn segment_evenly(
    tree: &PointTree,
    sigma: Option<&[f64]>,
    settings: &SegmentationSettings,
    workers: &Workers,
) -> Result<Segmentation, Error> {
    let points = tree.points();
    let step = points.len().div_ceil(settings.course.most_local).min(settings.course.most_step);
    let mut local = tree.local_planes(sigma, step, workers)?;
    let n_nearest =
        (median_size(&local) / 2).clamp(settings.course.nearest.0, settings.course.nearest.1);
    let n_looked_at = if points.len() < settings.course.large {
        settings.course.looked_at.1
    } else {
        settings.course.looked_at.0
    };
    let graph = Graph::new(tree, n_nearest, n_looked_at, workers)?;
    let (noise, surfaces): (Vec<f32>, _) = if let Some(sigma) = sigma {
        (sigma.iter().map(|&sigma| sigma as f32).collect(), Surfaces::Smooth)
    } else {
        let is_stepped = without_steps(tree, &mut local, step, &settings.noise);
        let noise = spread_noise(&graph, &local, step, points.len(), workers)?;
        tree.thin_planes(&mut local, &noise, step, workers)?;
        let surfaces = if is_stepped {
            Surfaces::Rough
        } else {
            Surfaces::of(tree, &local, step, &settings.roughness, workers)?
        };
        let common = common_noise(&local, &settings.noise).filter(|_| surfaces == Surfaces::Smooth);
        (common.map_or(noise, |sigma| vec![sigma as f32; points.len()]), surfaces)
    };
    let seeds = seeds(tree, &local, step, &noise);
    let context = &Context { tree, graph: &graph, noise: &noise, surfaces, settings };
    let mut labels = grow(context, &local, step, &seeds, workers)?;
    let swept = |labels: Vec<i32>| {
        (0..settings.course.sweeps).try_fold(labels, |labels, _| compete(context, &labels, workers))
    };
    let mut before = sizes(&labels);
    for _ in 0..settings.course.rounds {
        labels = swept(labels)?;
        labels = split(context, &labels, workers);
        labels = compete(context, &labels, workers)?;
        labels = merge(context, &labels, workers);
        let after = sizes(&labels);
        if have_settled(&before, &after, settings.course.settled) {
            break;
        }
        before = after;
    }
    labels = swept(accept(context, &labels, workers)?)?;
    labels = merge(context, &labels, workers);
    labels = pieces(context, &labels);
    labels = join_strips(context, &labels, workers)?;
    labels = accept_parts(context, &labels, workers)?;
    for _ in 0..settings.course.passes {
        labels = without_patches(context, &labels, workers)?;
    }
    let known =
        |i: usize| if noise[i].is_nan() { local[i / step].sigma } else { f64::from(noise[i]) };
    let sigma = (0..points.len()).map(known).collect();
    Ok(Segmentation { labels, sigma, n_nearest, stride: 1, surfaces })
}

/// Points of each label.
fn sizes(labels: &[i32]) -> Vec<usize> {
    let mut sizes = Vec::new();
    for label in labels.iter().filter_map(|&label| usize::try_from(label).ok()) {
        if label >= sizes.len() {
            sizes.resize(label + 1, 0);
        }
        sizes[label] += 1;
    }
    sizes
}

/// Whether planes keep all but one in so many of their points, by how many they had and have.
fn have_settled(before: &[usize], after: &[usize], share: usize) -> bool {
    let keeps = |(&a, &b): (&usize, &usize)| share * a.abs_diff(b) <= a.max(b);
    before.len() == after.len() && before.iter().zip(after).all(keeps)
}

fn median_size(local: &[LocalPlane]) -> usize {
    let mut sizes: Vec<u32> = local.iter().map(|plane| plane.size).collect();
    let middle = sizes.len() / 2;
    *sizes.select_nth_unstable(middle).1 as usize
}

/// Points from which planes may grow, the flattest first; those alike in the order of the points,
/// which are sorted by their coordinates.
fn seeds(tree: &PointTree, local: &[LocalPlane], step: usize, noise: &[f32]) -> Vec<Seed> {
    let mut seeds: Vec<(f64, Seed)> = local
        .iter()
        .zip((0..).step_by(step))
        .filter(|(plane, place)| {
            plane.is_flat || plane.sigma <= THICKEST * f64::from(noise[*place])
        })
        .map(|(plane, place)| (plane.flatness, Seed { place: place as u32, size: plane.size }))
        .collect();
    let at = |seed: &Seed| tree.rows()[seed.place as usize];
    seeds.sort_unstable_by(|(a, first), (b, second)| {
        b.total_cmp(a).then_with(|| at(first).cmp(&at(second)))
    });
    seeds.into_iter().map(|(_, seed)| seed).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planes_settle_when_each_keeps_its_points() {
        let before = sizes(&[vec![0; 200], vec![NOBODY; 9], vec![1; 50]].concat());
        assert_eq!(before, [200, 50]);
        assert!(have_settled(&before, &[202, 50], 100));
        for after in [&[203, 50][..], &[200, 49], &[200, 0], &[200], &[200, 50, 1]] {
            assert!(!have_settled(&before, after, 100), "{after:?}");
        }
    }
}
