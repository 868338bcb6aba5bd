//! The planes of an organised cloud: its image tells which points are neighbours.

mod acceptance;
mod cells;
mod growth;
mod noise;
mod refinement;
mod rows;

use crate::segmentation::SegmentationSettings;
use crate::spread::Sums;
use crate::{Error, Vector, Workers};
use acceptance::{Part, Seen};
use cells::{Image, Pyramid};
use growth::{NOBODY, Region};
use refinement::Plane;
use rows::NOWHERE;

/// Bytes of a pixel that the search takes at most, with a copy in line.
const BYTES: usize = 120;

/// The planes of an image.
pub struct ImageSegmentation {
    /// Plane of each pixel, numbered by falling size; -1 for none.
    pub labels: Vec<i32>,
    /// Noise around each pixel across its surface, given or estimated.
    pub sigma: Vec<f64>,
}

/// Segments an image of rows of `width` pixels, where NaN is no point; `sigma` is the noise of each
/// pixel, if known.
///
/// # Errors
/// [`Error::Stopped`] when the caller does not want to go on; [`Error::Memory`] when it is short.
pub fn segment_image(
    points: &[Vector],
    width: usize,
    sigma: Option<&[f64]>,
    workers: &Workers,
) -> Result<ImageSegmentation, Error> {
    workers.room(BYTES * points.len())?;
    let mut image = Image { points, width, height: points.len() / width, is_ring: false };
    image.is_ring = rows::is_ring(&image);
    let Some(moved) = rows::in_line(&image) else {
        return segment_in_line(&image, sigma, workers);
    };
    let of_source = |sigma: &[f64]| {
        moved.source.iter().map(|&i| *sigma.get(i as usize).unwrap_or(&0.0)).collect()
    };
    let sigma: Option<Vec<f64>> = sigma.map(of_source);
    let image = Image { points: &moved.points, width: moved.width, ..image };
    let found = segment_in_line(&image, sigma.as_deref(), workers)?;
    let mut own =
        ImageSegmentation { labels: vec![NOBODY; points.len()], sigma: vec![0.0; points.len()] };
    for (i, &source) in moved.source.iter().enumerate().filter(|(_, source)| **source != NOWHERE) {
        own.labels[source as usize] = found.labels[i];
        own.sigma[source as usize] = found.sigma[i];
    }
    Ok(own)
}

/// The same for an image in which a surface goes on from row to row.
fn segment_in_line(
    image: &Image,
    sigma: Option<&[f64]>,
    workers: &Workers,
) -> Result<ImageSegmentation, Error> {
    let settings = &SegmentationSettings::default();
    let pyramid = Pyramid::of(image);
    workers.check()?;
    let noise = match sigma {
        Some(sigma) => noise::told(image, &pyramid, sigma),
        None => noise::estimate(image, &pyramid),
    };
    workers.check()?;
    let (of_cell, regions) = growth::regions(&pyramid, &noise.sigma, image.is_ring, settings);
    let planes: Vec<Plane> = regions.iter().map(Plane::of).collect();
    workers.check()?;
    let mut labels = refinement::assign(image, &pyramid, &of_cell, &planes);
    refinement::flow(image, &mut labels, &planes);
    refinement::compete(image, &mut labels, &planes, settings.competition.share);
    workers.check()?;
    let mut regions = fit(image, &pyramid, &noise.sigma, &labels, planes.len());
    let beside = refinement::beside(image, &labels, planes.len());
    let into = growth::merge(&mut regions, beside, &settings.merging);
    for label in labels.iter_mut().filter(|label| **label != NOBODY) {
        *label = into[*label as usize];
    }
    let (labels, n) = refinement::parts(image, &labels);
    let regions = fit(image, &pyramid, &noise.sigma, &labels, n);
    let labels = accept(image, &labels, &regions, noise.alike, settings, workers)?;
    let mut sigma = Vec::with_capacity(labels.len());
    for row in 0..image.height {
        sigma.extend((0..image.width).map(|x| noise.sigma[pyramid.cell_at(row, x)]));
    }
    Ok(ImageSegmentation { labels, sigma })
}

/// Labels of the parts that are planes, numbered by falling size.
fn accept(
    image: &Image,
    labels: &[i32],
    regions: &[Region],
    alike: f64,
    settings: &SegmentationSettings,
    workers: &Workers,
) -> Result<Vec<i32>, Error> {
    let members = members(labels, regions.len());
    let mut is_plane = vec![false; regions.len()];
    workers.fill(&mut is_plane, 1, Seen::default, |seen, k, is_plane| {
        let (places, plane) = (&members[k][..], Plane::of(&regions[k]));
        let part = Part { image, labels, label: k as i32, places, plane, alike, settings };
        is_plane[0] = part.is_plane(seen);
    })?;
    let mut order: Vec<usize> = (0..regions.len()).filter(|&k| is_plane[k]).collect();
    order.sort_by_key(|&k| std::cmp::Reverse(members[k].len()));
    let mut number = vec![NOBODY; regions.len()];
    for (&k, new) in order.iter().zip(0..) {
        number[k] = new;
    }
    let of = |&label: &i32| if label == NOBODY { NOBODY } else { number[label as usize] };
    Ok(labels.iter().map(of).collect())
}

/// Pixels of each of `n` labels, rising.
fn members(labels: &[i32], n: usize) -> Vec<Vec<u32>> {
    let mut counts = vec![0; n];
    for &label in labels.iter().filter(|&&label| label != NOBODY) {
        counts[label as usize] += 1;
    }
    let mut members: Vec<Vec<u32>> = counts.into_iter().map(Vec::with_capacity).collect();
    for (&label, i) in labels.iter().zip(0..).filter(|(label, _)| **label != NOBODY) {
        members[label as usize].push(i);
    }
    members
}

/// The points of each label.
fn fit(image: &Image, pyramid: &Pyramid, noise: &[f64], labels: &[i32], n: usize) -> Vec<Region> {
    let mut sums: Vec<Option<(Sums, f64)>> = vec![None; n];
    let rows = labels.chunks(image.width).zip(image.points.chunks(image.width));
    for (row, (labels, points)) in rows.enumerate() {
        for (x, (&label, point)) in labels.iter().zip(points).enumerate() {
            if label != NOBODY {
                let own = sums[label as usize].get_or_insert_with(|| (Sums::new(*point), 0.0));
                own.0.add(point);
                own.1 += noise[pyramid.cell_at(row, x)].powi(2);
            }
        }
    }
    sums.into_iter()
        .map(|own| {
            let (sums, noise) = own.unwrap_or_else(|| (Sums::new([0.0; 3]), 0.0));
            Region { moments: sums.moments(), noise }
        })
        .collect()
}
