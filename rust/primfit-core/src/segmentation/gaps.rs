//! Planes in two pieces that lie in one plane by chance: between them is nothing.

use crate::Vector;
use crate::spread::{Moments, Spread, axes_across, dot};

/// Directions in which a gap is looked for.
const DIRECTIONS: u32 = 8;
/// Points of a plane that are looked at, and fewest that tell.
const MOST: usize = 1024;
const FEWEST: usize = 200;
/// Share of the points that may be in a gap, as those of other planes near the noise of which it
/// lies are, and share at either end that is left out, since there they are always sparse.
const WITHIN: usize = 32;
const END: usize = 20;
/// How much wider than the next widest stretch with as many points a gap is.
const WIDER: f64 = 2.0;
/// Least width of a piece, over the distance from the middle of one to that of the other: rows of a
/// scan are no pieces.
const NARROWEST: f64 = 0.25;

/// A straight cut: points whose product with `along` is greater than `at` are the second part.
#[derive(Debug, Clone, Copy)]
pub struct Cut {
    pub along: Vector,
    pub at: f64,
}

/// The cut in the clearest gap between the points of a plane, if there is one.
pub fn gap(points: &[Vector], places: &[u32], spread: &Spread) -> Option<Cut> {
    if places.len() < FEWEST {
        return None;
    }
    let step = places.len().div_ceil(MOST);
    let [first, second] = axes_across(&spread.normal);
    let mut best = None;
    let mut best_ratio = WIDER;
    for k in 0..DIRECTIONS {
        let (sin, cos) = (std::f64::consts::PI * f64::from(k) / f64::from(DIRECTIONS)).sin_cos();
        let along: Vector = std::array::from_fn(|axis| cos * first[axis] + sin * second[axis]);
        let mut at: Vec<f64> = places
            .iter()
            .step_by(step)
            .map(|&place| dot(&along, &points[place as usize]))
            .collect();
        at.sort_unstable_by(f64::total_cmp);
        if let Some((ratio, middle)) = widest(&at).filter(|found| found.0 > best_ratio) {
            best_ratio = ratio;
            best = Some(Cut { along, at: middle });
        }
    }
    best.filter(|cut| are_pieces(points, places, cut))
}

/// Whether both parts have a width; one may be empty where values differ by rounding alone.
fn are_pieces(points: &[Vector], places: &[u32], cut: &Cut) -> bool {
    let some = places.iter().map(|&place| &points[place as usize]);
    let (after, before): (Vec<&Vector>, Vec<&Vector>) =
        some.partition(|point| dot(&cut.along, point) > cut.at);
    if before.is_empty() || after.is_empty() {
        return false;
    }
    let parts = [before, after].map(|part| Moments::of(part.iter().copied(), part[0]).spread());
    let away: Vector = std::array::from_fn(|axis| parts[0].mean[axis] - parts[1].mean[axis]);
    let least = NARROWEST * dot(&away, &away).sqrt();
    parts.iter().all(|part| (12.0 * part.variances[1]).sqrt() >= least)
}

/// How much wider than any other stretch of few points the widest one is among places in order,
/// and the middle of its emptiest part.
fn widest(at: &[f64]) -> Option<(f64, f64)> {
    let few = 1 + at.len() / WITHIN;
    let stretches = at.len() / END..at.len() - at.len() / END - few;
    let width = |i: usize| at[i + few] - at[i];
    let by_width = |&i: &usize, &j: &usize| width(i).total_cmp(&width(j));
    let start = stretches.clone().max_by(by_width)?;
    let others = stretches.filter(|i| i.abs_diff(start) >= few);
    let next = others.max_by(by_width).map(width)?;
    let empty = |i: usize| at[i + 1] - at[i];
    let gap = (start..start + few).max_by(|&i, &j| empty(i).total_cmp(&empty(j)))?;
    Some((width(start) / next, f64::midpoint(at[gap], at[gap + 1])))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    /// Points of a tilted plane where `is_there` says so of u and v in 0 to 1.
    fn plane(is_there: impl Fn(f64, f64) -> bool) -> Vec<Vector> {
        (0..4000_u32)
            .map(|i| (f64::from(i) * 0.618_034 % 1.0, f64::from(i) * 0.754_878 % 1.0))
            .filter(|&(u, v)| is_there(u, v))
            .map(|(u, v)| [u, v, 0.3 * u - 0.2 * v])
            .collect()
    }

    fn cut(points: &[Vector]) -> Option<Cut> {
        let places: Vec<u32> = (0..points.len() as u32).collect();
        gap(points, &places, &Moments::of(points.iter(), &points[0]).spread())
    }

    #[test]
    fn two_pieces_are_cut_between_them() {
        for few in [0.0, 0.02] {
            let points = plane(|u, v| !(0.4..0.6).contains(&u) || v < few);
            let Cut { along, at } = cut(&points).unwrap();
            let is_second = |point: &Vector| dot(&along, point) > at;
            let one = is_second(&[0.0, 0.5, -0.1]);
            let is_clear = |point: &&Vector| !(0.4..0.6).contains(&point[0]);
            assert!(points.iter().filter(is_clear).all(|p| is_second(p) == (one == (p[0] < 0.5))));
        }
    }

    #[test]
    fn what_is_in_one_piece_is_not_cut() {
        let whole: [fn(f64, f64) -> bool; 4] = [
            |_, _| true,
            |u, v| u < 0.3 || v < 0.3,
            |u, v| !(0.2..0.8).contains(&u) || !(0.2..0.8).contains(&v),
            |u, v| (u - 0.5).hypot(v - 0.5) < 0.5,
        ];
        for is_there in whole {
            assert!(cut(&plane(is_there)).is_none());
        }
    }

    #[test]
    fn rows_of_a_scan_are_no_pieces() {
        for rows in [2.0, 3.0, 4.0] {
            let points = plane(|_, v| (v * rows).fract() < 0.02);
            assert!(cut(&points).is_none(), "{rows}");
        }
    }

    #[test]
    fn a_cut_that_rounding_moved_beside_all_points_is_none() {
        let points = plane(|_, _| true);
        let places: Vec<u32> = (0..points.len() as u32).collect();
        for at in [-1.0, 2.0] {
            assert!(!are_pieces(&points, &places, &Cut { along: [1.0, 0.0, 0.0], at }));
        }
    }
}
