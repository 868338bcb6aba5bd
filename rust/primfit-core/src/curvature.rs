//! Whether points near a plane lie on a curved surface.

use crate::Vector;
use crate::spread::{Spread, axes_across, dot};
use nalgebra::{SMatrix, SVector};

/// How much a surface bends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bend {
    /// Angle in radians by which the normal turns from one side of the points to the other.
    pub turn: f64,
    /// Fall of the sum of squares that bending explains, in variances.
    pub evidence: f64,
}

impl Bend {
    /// Of the paraboloid that fits the points best by least squares of their heights over the
    /// plane; None when they do not tell one.
    pub fn of<'a>(points: impl Iterator<Item = &'a Vector>, spread: &Spread) -> Option<Self> {
        let [first, second] = axes_across(&spread.normal);
        let unit = spread.variances[1].sqrt();
        let mut normal_matrix = SMatrix::<f64, 6, 6>::zeros();
        let mut right = SVector::<f64, 6>::zeros();
        let (mut squares, mut count) = (0.0, 0.0);
        let mut moments = [0.0; 3];
        for point in points {
            let away: Vector = std::array::from_fn(|k| (point[k] - spread.mean[k]) / unit);
            let (u, v, height) =
                (dot(&away, &first), dot(&away, &second), dot(&away, &spread.normal));
            let row = SVector::<f64, 6>::from([1.0, u, v, u * u / 2.0, u * v, v * v / 2.0]);
            normal_matrix += row * row.transpose();
            right += row * height;
            squares += height * height;
            count += 1.0;
            moments = [moments[0] + u * u, moments[1] + u * v, moments[2] + v * v];
        }
        let solution = normal_matrix.cholesky()?.solve(&right);
        let explained = solution.dot(&right);
        let variance = (squares - explained).max(0.0) / (count - 6.0);
        let [a, b, c] = [solution[3], solution[4], solution[5]];
        // Principal curvatures and their directions.
        let (middle, half) = (f64::midpoint(a, c), (a - c) / 2.0);
        let radius = half.hypot(b);
        let along = if radius > 0.0 { [half / radius, b / radius] } else { [1.0, 0.0] };
        let turn = [1.0, -1.0]
            .map(|side| {
                // Variance along the direction whose doubled angle has this cosine and sine.
                let variance = f64::midpoint(moments[0], moments[2])
                    + side * (along[0] * (moments[0] - moments[2]) / 2.0 + along[1] * moments[1]);
                (middle + side * radius).abs() * (12.0 * variance / count).sqrt()
            })
            .into_iter()
            .fold(0.0, f64::max);
        Some(Self { turn, evidence: explained / variance.max(f64::MIN_POSITIVE) })
    }
}
