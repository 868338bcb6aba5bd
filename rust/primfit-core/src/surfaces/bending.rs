//! Whether points that a plane fits bend: a test that costs one pass over them.

use super::cloud::FAR;
use super::correlation::area_of;
use super::growing::worth;
use super::surface::{Kind, Surface};
use super::vectors::{dot, minus};
use crate::Vector;
use crate::neighbors::{PointTree, Search};
use crate::spread::{Moments, axes_across};
use nalgebra::{SMatrix, SVector};

/// Terms of a height over a plane up to the third power of both places on it, and those of a plane.
const TERMS: usize = 10;
const FLAT: usize = 3;
/// Points that are looked at: the gain of a bend of half a standard deviation is then known to 10 %.
const MOST: usize = 3000;
/// Points whose residuals are compared with those of their nearest, and how many of these.
const COMPARED: usize = 1024;
const NEAREST: usize = 8;
/// Correlation of neighbouring residuals below which there is no bend. A cut of a curved surface ends
/// where it has bent by two standard deviations or more: 4/45 of the square of that sagitta, 0.36,
/// are added to the mean square of the residuals, of which they are 0.26 then.
const ALIKE: f64 = 0.13;
/// Standard errors of that correlation that this must be to tell.
const CLEAR: f64 = 3.0;

/// The plane of some points and what a bend gains.
pub struct Flatness {
    /// Through their mean.
    pub plane: Surface,
    /// Heights over it, in standard deviations times `scale`, by the terms of the third power.
    bend: SVector<f64, TERMS>,
    scale: f64,
    /// Fall of the sum of their squared distances in standard deviations.
    gain: f64,
    n: f64,
}

impl Flatness {
    /// Of points with their noise, which stand for `n` points; None where they lie on a line.
    pub fn of<'a>(
        n: usize,
        pairs: impl ExactSizeIterator<Item = (&'a Vector, f64)> + Clone,
    ) -> Option<Self> {
        let stride = pairs.len().div_ceil(MOST).max(1);
        let thinned = pairs.step_by(stride);
        let spread = Moments::of(thinned.clone().map(|pair| pair.0), thinned.clone().next()?.0);
        let spread = spread.spread();
        let plane =
            Surface { kind: Kind::Plane, place: spread.mean, axis: spread.normal, sizes: [0.0; 2] };
        let far = thinned.clone().map(|(point, _)| {
            let away = minus(point, &plane.place);
            dot(&away, &away)
        });
        let scale = 1.0 / far.fold(0.0, f64::max).sqrt();
        let [u, v] = axes_across(&plane.axis);
        let mut matrix = SMatrix::<f64, TERMS, TERMS>::zeros();
        let mut right = SVector::<f64, TERMS>::zeros();
        let mut counted = 0.0;
        for (point, sigma) in thinned {
            let away = minus(point, &plane.place);
            let off = dot(&away, &plane.axis) / sigma;
            counted += 1.0;
            // What a bend would leave out too does not tell of one.
            if off * off > 4.0 * FAR {
                continue;
            }
            let terms = terms_of(scale * dot(&away, &u), scale * dot(&away, &v));
            for a in 0..TERMS {
                let weighted = terms[a] / (sigma * sigma);
                right[a] += weighted * off * sigma;
                for b in 0..=a {
                    matrix[(a, b)] += weighted * terms[b];
                }
            }
        }
        let gain_of = |k: usize| {
            let mut matrix = matrix;
            let mut right = right;
            for a in k..TERMS {
                matrix.row_mut(a).fill(0.0);
                matrix[(a, a)] = 1.0;
                right[a] = 0.0;
            }
            let solved = matrix.cholesky()?.solve(&right);
            Some((solved, solved.dot(&right)))
        };
        let ((bend, bent), (_, flat)) = (gain_of(TERMS)?, gain_of(FLAT)?);
        let gain = (bent - flat) * n as f64 / counted;
        Some(Self { plane, bend, scale, gain, n: n as f64 })
    }

    /// Number of points whose errors are one, by what the bend leaves of the heights of these.
    pub fn area(
        &self,
        tree: &PointTree,
        sigma: &[f64],
        places: &[u32],
        labels: &[i32],
        search: &mut Search,
    ) -> f64 {
        let Some(&first) = places.first() else { return 1.0 };
        let [u, v] = axes_across(&self.plane.axis);
        let error = |place: u32| {
            let place = place as usize;
            if labels[place] != labels[first as usize] {
                return None;
            }
            let away = minus(&tree.points()[place], &self.plane.place);
            let terms = terms_of(self.scale * dot(&away, &u), self.scale * dot(&away, &v));
            let height = self.bend.iter().zip(&terms).map(|(a, b)| a * b).sum::<f64>();
            let off = (dot(&away, &self.plane.axis) - height) / sigma[place];
            (off * off <= FAR).then_some(off)
        };
        area_of(tree, places, COMPARED, error, search)
    }

    /// Whether no curved surface is worth its parameters for these points, so many of which err as
    /// one: all that are nearly flat are heights of the third power.
    pub fn is_flat(&self, area: f64) -> bool {
        self.gain < worth(Kind::Plane, Kind::Sphere, self.n, area)
    }

    /// Whether places of a tree, which these points are at, are no cut of a curved surface either,
    /// also none along a curve: the residuals of its middle and those of its borders would be alike.
    pub fn is_whole(
        &self,
        tree: &PointTree,
        sigma: &[f64],
        places: &[u32],
        labels: &[i32],
        search: &mut Search,
    ) -> bool {
        if !self.is_flat(1.0) {
            return false;
        }
        let residual = |place: u32| {
            let place = place as usize;
            let off = self.plane.distance(&tree.points()[place]) / sigma[place];
            if off * off > FAR { 0.0 } else { off }
        };
        let (mut squares, mut products, mut n_pairs) = (0.0, 0.0, 0.0);
        let (mut n, mut sum) = (0.0, 0.0);
        for &place in places.iter().step_by(places.len().div_ceil(COMPARED)) {
            let own = residual(place);
            (n, sum, squares) = (n + 1.0, sum + own, squares + own * own);
            for other in tree.nearest(&tree.points()[place as usize], NEAREST + 1, search) {
                let is_own = labels[other.place as usize] == labels[place as usize];
                if other.place != place && is_own {
                    products += own * residual(other.place);
                    n_pairs += 1.0;
                }
            }
        }
        // Each pair may come twice.
        let chance = (2.0_f64 / n_pairs).sqrt();
        squares > 0.0
            && CLEAR * chance < ALIKE
            && (products / n_pairs - (sum / n).powi(2)) * n < ALIKE * squares
    }
}

fn terms_of(x: f64, y: f64) -> [f64; TERMS] {
    [1.0, x, y, x * x, x * y, y * y, x * x * x, x * x * y, x * y * y, y * y * y]
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_distr::{Distribution, StandardNormal};
    use rand_xoshiro::Xoshiro256PlusPlus;
    use rand_xoshiro::rand_core::SeedableRng;

    const SIGMA: f64 = 0.003;

    /// Points over a strip that are off a plane by so many standard deviations, and noise.
    fn is_whole(n: usize, place: impl Fn(f64, f64) -> Vector) -> (bool, bool) {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(7);
        let points: Vec<Vector> = (0..n)
            .map(|i| {
                let (x, y) = (i as f64 / n as f64 - 0.5, (i as f64 * 0.618_034).fract() - 0.5);
                let noise: f64 = StandardNormal.sample(&mut rng);
                let [x, y, off] = place(x, y);
                [x, y, SIGMA * (off + noise)]
            })
            .collect();
        let tree = PointTree::new(&points);
        let sigma = vec![SIGMA; n];
        let pairs = tree.points().iter().map(|point| (point, SIGMA));
        let places: Vec<u32> = (0..n as u32).collect();
        let found = Flatness::of(n, pairs);
        found.map_or((false, false), |flat| {
            let labels = vec![0; n];
            let whole = flat.is_whole(&tree, &sigma, &places, &labels, &mut Search::default());
            (flat.is_flat(1.0), whole)
        })
    }

    #[test]
    fn a_bend_of_two_standard_deviations_is_told_from_none() {
        for n in [400, 1000, 20_000] {
            assert_eq!(is_whole(n, |x, y| [x, y, 0.0]), (true, true), "{n}");
            assert!(!is_whole(n, |x, y| [x, y, 8.0 * x * x]).1, "{n}");
        }
    }

    /// The side of a bend of a pipe, which no cubic fits.
    #[test]
    fn a_cut_along_a_curve_is_none_of_a_plane() {
        let bend = |x: f64, y: f64| {
            let (far, angle) = (1.0 + 0.2 * y, 3.0 * x);
            [far * angle.cos(), far * angle.sin(), -8.0 * y * y]
        };
        // Of 400 the nearest of a point reach across the strip.
        for n in [1500, 3000] {
            assert!(!is_whole(n, bend).1, "{n}");
        }
    }

    #[test]
    fn few_points_are_not_sure_to_be_whole() {
        assert_eq!(is_whole(60, |x, y| [x, y, 0.0]), (true, false));
    }
}
