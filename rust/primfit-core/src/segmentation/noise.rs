//! The noise around every point, from neighbourhoods that are flat.

use super::graph::Graph;
use super::settings::Noise;
use crate::neighbors::normals::{LocalPlane, MOST as MOST_POINTS};
use crate::neighbors::{PointTree, Search};
use crate::spread::dot;
use crate::{Error, Vector, Workers};

/// What rounding makes of the cosine between two that are parallel: the square of their angle.
const ROUNDING: f64 = 1e-8;
/// Parameters of a plane.
const PARAMETERS: f64 = 3.0;

/// Standard deviation of the noise of all points of the graph, of which every `step`-th has a
/// local plane.
///
/// A flat neighbourhood tells it; from there its logarithm spreads over the graph, since edges,
/// corners and scattered points have no neighbourhood that tells anything. NaN where it does not
/// get.
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
    let flat = || local.iter().zip((0..).step_by(step)).filter(|(plane, _)| plane.is_flat);
    let mut logs = vec![f32::NAN; n_points];
    for (plane, i) in flat() {
        logs[i] = plane.sigma.max(f64::from(f32::MIN_POSITIVE)).ln() as f32;
    }
    let mut unknown: Vec<u32> =
        (0..n_points as u32).filter(|&i| logs[i as usize].is_nan()).collect();
    let mut n_before = n_points + 1;
    while unknown.len() < n_before {
        n_before = unknown.len();
        let mut told = vec![f32::NAN; unknown.len()];
        workers.fill(
            &mut told,
            1,
            || (),
            |(), k, told| {
                told[0] = mean(graph.of(unknown[k] as usize), &logs);
            },
        )?;
        for (&i, told) in unknown.iter().zip(&told) {
            logs[i as usize] = *told;
        }
        unknown.retain(|&i| logs[i as usize].is_nan());
    }
    let mut noise = logs;
    for known in &mut noise {
        *known = known.exp();
    }
    for (plane, i) in flat() {
        noise[i] = plane.sigma as f32;
    }
    Ok(noise)
}

/// Whether values come in steps, as ranges and depths of some sensors do; then neighbourhoods
/// within one step, which are planes but for rounding, no longer pass as flat: they tell nothing.
///
/// Beside a step is the next one, parallel to it; a plane without noise has none.
pub fn without_steps(
    tree: &PointTree,
    local: &mut [LocalPlane],
    step: usize,
    settings: &Noise,
) -> bool {
    let n_flat = local.iter().filter(|plane| plane.is_flat).count() as f64;
    let is_exact = |plane: &LocalPlane| plane.is_flat && plane.flatness > settings.exact;
    let exact: Vec<usize> = (0..local.len()).filter(|&k| is_exact(&local[k])).collect();
    let share = exact.len() as f64 / n_flat;
    if !(share > settings.stepped.0 && share < settings.stepped.1) {
        return false;
    }
    let mut search = Search::default();
    let n_asked = exact.len().min(settings.asked);
    let n_beside = (0..n_asked)
        .map(|k| exact[k * exact.len() / n_asked])
        .filter(|&k| is_beside_another(tree, local, step, k, settings.exact, &mut search))
        .count();
    let is_stepped = share * n_beside as f64 / n_asked as f64 > settings.stepped.0;
    if is_stepped {
        for k in exact {
            local[k].is_flat = false;
        }
    }
    is_stepped
}

/// Whether there is a plane but for rounding parallel to another one within its vicinity.
fn is_beside_another(
    tree: &PointTree,
    local: &[LocalPlane],
    step: usize,
    k: usize,
    exact: f64,
    search: &mut Search,
) -> bool {
    let (points, own) = (tree.points(), &local[k]);
    let at = &points[k * step];
    tree.nearest(at, MOST_POINTS, search).iter().any(|near| {
        let place = near.place as usize;
        let away: Vector = std::array::from_fn(|axis| points[place][axis] - at[axis]);
        let other = &local[place / step];
        let off = dot(&own.normal, &away).abs();
        place.is_multiple_of(step)
            && other.is_flat
            && other.flatness > exact
            && 1.0 - dot(&own.normal, &other.normal).abs() < ROUNDING
            && off > ROUNDING.sqrt() * near.squared.sqrt()
    })
}

/// The noise of all points where flat neighbourhoods do not tell that it differs; None where they
/// do, or are too few.
///
/// The logarithm of a deviation from n points deviates by 1 / sqrt(2 n): of nine in ten, hardly more
/// than that, though the neighbourhoods overlap and were chosen to be flat.
pub fn common_noise(local: &[LocalPlane], settings: &Noise) -> Option<f64> {
    let flat: Vec<&LocalPlane> = local.iter().filter(|plane| plane.is_flat).collect();
    if flat.len() < settings.fewest {
        return None;
    }
    let mut sigmas: Vec<f64> = flat.iter().map(|plane| plane.sigma).collect();
    let (_, &mut median, _) = sigmas.select_nth_unstable_by(flat.len() / 2, f64::total_cmp);
    let off = |plane: &&LocalPlane| {
        let freedom = f64::from(plane.size) - PARAMETERS;
        (plane.sigma / median).ln().abs() * (2.0 * freedom).sqrt()
    };
    let mut off: Vec<f64> = flat.iter().map(off).collect();
    let (_, &mut most, _) = off.select_nth_unstable_by(9 * flat.len() / 10, f64::total_cmp);
    (most < settings.different).then_some(median)
}

/// Mean of what is known, NaN when nothing is.
fn mean(places: &[u32], values: &[f32]) -> f32 {
    let (mut sum, mut count) = (0.0, 0.0);
    for known in places.iter().map(|&place| values[place as usize]).filter(|known| !known.is_nan())
    {
        sum += f64::from(known);
        count += 1.0;
    }
    (sum / count) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Flat neighbourhoods of 100 points, each a little off its noise.
    fn flat(n: u32, noise: impl Fn(u32) -> f64) -> Vec<LocalPlane> {
        let off = |i: u32| 1.0 + 0.1 * (f64::from(i) * 0.618_034 % 1.0 - 0.5);
        let of = |i| LocalPlane { sigma: off(i) * noise(i), size: 100, ..LocalPlane::default() };
        (0..n).map(|i| LocalPlane { is_flat: true, ..of(i) }).collect()
    }

    #[test]
    fn noise_that_differs_by_chance_is_one() {
        let common = common_noise(&flat(500, |_| 0.02), &Noise::default());
        assert!(common.is_some_and(|sigma| (sigma / 0.02 - 1.0).abs() < 0.05));
    }

    #[test]
    fn noise_that_differs_is_not_one() {
        assert_eq!(
            common_noise(&flat(500, |i| if i % 4 == 0 { 0.03 } else { 0.02 }), &Noise::default()),
            None
        );
    }

    #[test]
    fn few_and_what_is_not_flat_tell_nothing() {
        let settings = Noise::default();
        assert_eq!(common_noise(&flat(settings.fewest as u32 - 1, |_| 0.02), &settings), None);
        let bent: Vec<LocalPlane> = flat(500, |_| 0.02)
            .into_iter()
            .map(|plane| LocalPlane { is_flat: false, ..plane })
            .collect();
        assert_eq!(common_noise(&bent, &Noise::default()), None);
    }
}
