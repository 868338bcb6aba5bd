//! The noise around every point, from neighbourhoods that are flat.

use crate::graph::Graph;
use crate::normals::LocalPlane;
use crate::{Error, Workers};

/// Standard deviation of the noise of all points of the graph, of which every `step`-th has a
/// local plane.
///
/// A flat neighbourhood tells it; from there it spreads over the graph, since edges, corners and
/// scattered points have no neighbourhood that tells anything. NaN where it does not get.
///
/// # Errors
/// [`Error::Stopped`] when the caller does not want to go on.
pub fn spread_noise(
    graph: &Graph,
    local: &[LocalPlane],
    step: usize,
    n_points: usize,
    workers: &Workers,
) -> Result<Vec<f32>, Error> {
    let mut noise = vec![f32::NAN; n_points];
    for (plane, i) in local.iter().zip((0..).step_by(step)).filter(|(plane, _)| plane.is_flat) {
        noise[i] = plane.sigma as f32;
    }
    let mut unknown: Vec<u32> =
        (0..n_points as u32).filter(|&i| noise[i as usize].is_nan()).collect();
    let mut n_before = n_points + 1;
    while unknown.len() < n_before {
        n_before = unknown.len();
        let mut told = vec![f32::NAN; unknown.len()];
        workers.fill(
            &mut told,
            1,
            || (),
            |(), k, told| {
                told[0] = mean(graph.of(unknown[k] as usize), &noise);
            },
        )?;
        for (&i, told) in unknown.iter().zip(&told) {
            noise[i as usize] = *told;
        }
        unknown.retain(|&i| noise[i as usize].is_nan());
    }
    Ok(noise)
}

/// Geometric mean of what is known, NaN when nothing is.
fn mean(places: &[u32], noise: &[f32]) -> f32 {
    let (mut sum, mut count) = (0.0, 0.0);
    for known in places.iter().map(|&place| noise[place as usize]).filter(|known| !known.is_nan()) {
        sum += f64::from(known.max(f32::MIN_POSITIVE)).ln();
        count += 1.0;
    }
    f64::exp(sum / count) as f32
}
