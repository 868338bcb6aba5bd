//! From a guess uphill along the smooth part of the likelihood.

use super::beams::BeamBlocks;
use super::expansion::expand;
use super::{Candidate, Family};
use nalgebra::{DMatrix, DVector, SymmetricEigen};

/// Log-likelihood that a step must promise to be worth taking.
const LEAST_GAIN: f64 = 0.1;
/// Least information that a combination of parameters is taken to have, as a share of that of each:
/// the sums over the beams are in single precision.
const LEAST_TOLD: f64 = 1e-5;

/// Where a climb ended.
pub struct Climb {
    /// Of the family.
    pub parameters: Vec<f64>,
    /// Negative log-likelihood.
    pub cost: f64,
    /// Inverse of the Fisher information of the ranges, rows first.
    pub covariance: Vec<f64>,
}

/// A prism whose footprint is of a family, in front of beams that count `weight` times each.
pub struct Slope<'a> {
    /// What tells the cost.
    pub beams: &'a BeamBlocks,
    /// What the footprint is.
    pub family: &'a Family,
    /// z of its lower end.
    pub bottom: f64,
    /// z of its upper end.
    pub top: f64,
    /// Whether it has no top face.
    pub is_open: bool,
    /// How many beams each stands for.
    pub weight: f64,
}

/// A cost with its first and second derivatives by the parameters.
struct Local {
    cost: f64,
    gradient: DVector<f64>,
    information: DMatrix<f64>,
}

impl Slope<'_> {
    /// Damped Gauss-Newton steps to the least cost, with the beams associated anew at each.
    #[must_use]
    pub fn climb(&self, start: &[f64], n_steps: usize) -> Climb {
        let mut parameters = DVector::from_column_slice(start);
        let mut here = self.at(&parameters);
        let mut damping = 1e-3;
        for _ in 0..n_steps {
            let mut damped = here.information.clone();
            let least = 1e-12 * damped.trace() + 1e-300;
            for k in 0..damped.nrows() {
                damped[(k, k)] += damping * (damped[(k, k)] + least);
            }
            if let Some(root) = damped.cholesky() {
                let descent = root.solve(&here.gradient);
                if 0.5 * descent.dot(&here.gradient) < LEAST_GAIN {
                    break;
                }
                let moved = &parameters - descent;
                if self.family.is_proper(moved.as_slice()) {
                    let there = self.at(&moved);
                    if there.cost < here.cost {
                        (parameters, here) = (moved, there);
                        damping /= 10.0;
                        continue;
                    }
                }
            }
            damping *= 10.0;
        }
        let widest = extent(self.family.footprint(parameters.as_slice()));
        let covariance = inverse(&here.information, widest);
        let parameters = parameters.as_slice().to_vec();
        Climb { parameters, cost: here.cost, covariance: covariance.as_slice().to_vec() }
    }

    fn at(&self, parameters: &DVector<f64>) -> Local {
        let footprint: Vec<[f64; 2]> = self.family.footprint(parameters.as_slice()).collect();
        let candidate = Candidate {
            footprint: &footprint,
            is_round: self.family.is_round(),
            bottom: self.bottom,
            top: self.top,
            is_open: self.is_open,
        };
        let found = expand(self.beams, &candidate, 0.0, 0.0);
        let n = found.gradient.len();
        let changes = self.family.changes(parameters.as_slice());
        let gradient = DVector::from_vec(found.gradient);
        let information = DMatrix::from_vec(n, n, found.information);
        Local {
            cost: self.weight * found.cost,
            gradient: self.weight * changes.tr_mul(&gradient),
            information: self.weight * changes.tr_mul(&(information * &changes)),
        }
    }
}

/// The longer side of the box around some corners.
fn extent(corners: impl Iterator<Item = [f64; 2]>) -> f64 {
    let none = [[f64::INFINITY; 2], [f64::NEG_INFINITY; 2]];
    let [low, high] = corners.fold(none, |[low, high], corner| {
        [
            [low[0].min(corner[0]), low[1].min(corner[1])],
            [high[0].max(corner[0]), high[1].max(corner[1])],
        ]
    });
    (high[0] - low[0]).max(high[1] - low[1])
}

/// Inverse of an information matrix; where the beams tell nothing, or nothing finite, as wide as
/// `widest`.
fn inverse(information: &DMatrix<f64>, widest: f64) -> DMatrix<f64> {
    let n = information.nrows();
    let scale = information.diagonal().map(|x| (x.max(0.0) + widest.powi(-2)).sqrt());
    let scaled = DMatrix::from_fn(n, n, |i, j| information[(i, j)] / (scale[i] * scale[j]));
    if !scaled.iter().all(|x| x.is_finite()) {
        return DMatrix::from_diagonal_element(n, n, widest * widest);
    }
    let eigen = SymmetricEigen::new(scaled);
    let mut root = eigen.eigenvectors;
    for (mut column, value) in root.column_iter_mut().zip(&eigen.eigenvalues) {
        column /= value.max(LEAST_TOLD).sqrt();
        column.component_div_assign(&scale);
    }
    &root * root.transpose()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_inverse_of_what_is_told_and_of_what_is_not() {
        let information = DMatrix::from_row_slice(2, 2, &[4e6, 1e6, 1e6, 9e6]);
        let product = inverse(&information, 1e3) * &information;
        assert!((product - DMatrix::identity(2, 2)).abs().max() < 1e-9);
        let nothing = inverse(&DMatrix::zeros(2, 2), 3.0);
        assert!(nothing[(0, 0)] >= 9.0 && nothing[(0, 1)] == 0.0);
        let unknown = inverse(&DMatrix::from_element(2, 2, f64::NAN), 3.0);
        assert!(unknown == DMatrix::from_diagonal_element(2, 2, 9.0));
    }
}
