//! The Student distribution of some parameters.

use nalgebra::{Cholesky, DMatrix, DVector};
use rand_distr::{Distribution, Exp1, StandardNormal};
use rand_xoshiro::Xoshiro256PlusPlus;
use std::f64::consts::PI;

/// Half the degrees of freedom: its tails are heavier than those of a jumping likelihood.
const HALF_DEGREES: usize = 3;
/// Least variance: with less, densities of several parameters leave the range of float64.
const LEAST: f64 = 1e-60;

/// A mean, and a scale by its root.
pub struct Student {
    mean: DVector<f64>,
    /// Cholesky factor of its scale, and the inverse of that.
    root: DMatrix<f64>,
    inverse: DMatrix<f64>,
    /// Density at the mean.
    peak: f64,
}

impl Student {
    pub fn new(mean: &DVector<f64>, scale: &DMatrix<f64>) -> Self {
        let d = mean.len();
        let root = root_of(scale);
        let inverse = root
            .solve_lower_triangular(&DMatrix::identity(d, d))
            .unwrap_or_else(|| DMatrix::zeros(d, d));
        let degrees = 2 * HALF_DEGREES;
        let volume = (degrees as f64 * PI).powf(d as f64 / 2.0) * root.diagonal().product();
        let peak = gamma_of_half(degrees + d) / gamma_of_half(degrees) / volume;
        Self { mean: mean.clone(), root, inverse, peak }
    }

    pub fn center(&self, draw: &mut [f64]) {
        draw.copy_from_slice(self.mean.as_slice());
    }

    pub fn draw(&self, rng: &mut Xoshiro256PlusPlus, draw: &mut [f64]) {
        self.center(draw);
        let halves: f64 = (0..HALF_DEGREES).map(|_| -> f64 { Exp1.sample(rng) }).sum();
        let stretch = (HALF_DEGREES as f64 / halves).sqrt();
        for j in 0..draw.len() {
            let normal: f64 = StandardNormal.sample(rng);
            for (i, x) in draw.iter_mut().enumerate().skip(j) {
                *x += self.root[(i, j)] * stretch * normal;
            }
        }
    }

    pub fn density(&self, draw: &[f64]) -> f64 {
        let d = draw.len();
        let mut square = 0.0;
        for i in 0..d {
            let standard: f64 =
                (0..=i).map(|j| self.inverse[(i, j)] * (draw[j] - self.mean[j])).sum();
            square += standard * standard;
        }
        let tail = 1.0 + square / (2 * HALF_DEGREES) as f64;
        let whole = self.peak / tail.powi((HALF_DEGREES + d / 2) as i32);
        if d.is_multiple_of(2) { whole } else { whole / tail.sqrt() }
    }
}

/// A square root of a covariance that may be singular.
fn root_of(covariance: &DMatrix<f64>) -> DMatrix<f64> {
    let d = covariance.nrows();
    let scale = covariance.diagonal().map(|x| x.max(LEAST).sqrt());
    let correlation = DMatrix::from_fn(d, d, |i, j| {
        covariance[(i, j)] / (scale[i] * scale[j]) + if i == j { 1e-10 } else { 0.0 }
    });
    let root = correlation.cholesky().map_or_else(|| DMatrix::identity(d, d), Cholesky::unpack);
    DMatrix::from_diagonal(&scale) * root
}

/// The gamma function of half a whole number above zero.
fn gamma_of_half(n: usize) -> f64 {
    match n {
        1 => PI.sqrt(),
        2 => 1.0,
        _ => (n as f64 / 2.0 - 1.0) * gamma_of_half(n - 2),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_xoshiro::rand_core::SeedableRng;

    #[test]
    fn gamma_of_halves() {
        let expected = [PI.sqrt(), 1.0, PI.sqrt() / 2.0, 1.0, 0.75 * PI.sqrt(), 2.0];
        for (n, expected) in (1..).zip(expected) {
            assert!((gamma_of_half(n) - expected).abs() < 1e-14);
        }
    }

    #[test]
    fn no_scale_is_too_small() {
        let mean = DVector::from_element(6, 1.0);
        let student = Student::new(&mean, &DMatrix::zeros(6, 6));
        assert!(student.density(mean.as_slice()).is_normal());
        assert_eq!(student.density(&[2.0; 6]), 0.0);
    }

    /// The density integrates to 1, and draws fall as it says.
    #[test]
    fn a_student_of_one_parameter() {
        let student =
            Student::new(&DVector::from_element(1, 2.0), &DMatrix::from_element(1, 1, 9.0));
        let step = 0.01;
        let at = |i: i32| 2.0 + f64::from(i) * step;
        let below = |x: f64| -> f64 {
            (-100_000..100_000)
                .map(at)
                .filter(|y| *y < x)
                .map(|y| step * student.density(&[y]))
                .sum()
        };
        assert!((below(f64::INFINITY) - 1.0).abs() < 1e-6);
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(1);
        let draws: Vec<f64> = (0..20_000)
            .map(|_| {
                let mut draw = [0.0];
                student.draw(&mut rng, &mut draw);
                draw[0]
            })
            .collect();
        for x in [-8.0, -1.0, 2.0, 3.0, 10.0] {
            let share = draws.iter().filter(|draw| **draw < x).count() as f64 / draws.len() as f64;
            let expected = below(x);
            let error = (expected * (1.0 - expected) / draws.len() as f64).sqrt();
            assert!((share - expected).abs() < 4.0 * error, "{x}: {share} for {expected}");
        }
    }
}
