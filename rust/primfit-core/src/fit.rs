//! The plane that fits given points best, and how well it is known.

use crate::Vector;
use crate::spread::Moments;
use nalgebra::{DMatrix, Matrix3, Matrix4, Matrix4x3, SymmetricEigen, Vector3, Vector4};

/// Steps of Gauss and Newton after which the fit to ranges is taken as it is.
const MAX_STEPS: usize = 30;

/// A plane with what the points say of it.
#[derive(Debug, Clone, PartialEq)]
pub struct PlaneFit {
    /// `[a, b, c, d]` with a unit normal.
    pub equation: [f64; 4],
    /// Covariance of `equation`, rows first; the normal moves on the unit sphere only.
    pub covariance: [f64; 16],
    /// Weighted root mean square of the residuals.
    pub rms: f64,
}

/// Fits by weighted least squares of the perpendicular distances.
///
/// The normal is sought in the space that the orthonormal vectors of `normal_space` span: all
/// three axes for any plane, two for planes that hold the third, one for a given normal. The
/// covariance takes `weights` as inverse variances. None when the points do not tell a plane.
#[must_use]
pub fn fit_plane(points: &[Vector], weights: &[f64], normal_space: &[Vector]) -> Option<PlaneFit> {
    let total: f64 = weights.iter().sum();
    let mean = weighted_mean(points, weights, total)?;
    let mut scatter = Matrix3::zeros();
    for (point, weight) in points.iter().zip(weights) {
        let r = Vector3::from(*point) - mean;
        scatter += *weight * r * r.transpose();
    }
    let (normal, covariance) = tell(mean, &scatter, total, normal_space)?;
    // From the points, not from the scatter, whose rounding would show as a residual.
    let squares: f64 = points
        .iter()
        .zip(weights)
        .map(|(point, weight)| weight * normal.dot(&(Vector3::from(*point) - mean)).powi(2))
        .sum();
    Some(PlaneFit {
        equation: [normal.x, normal.y, normal.z, -normal.dot(&mean)],
        covariance: rows(&covariance),
        rms: (squares / total).sqrt(),
    })
}

/// The same of points of one weight, by their moments; the residuals are left to the caller.
#[must_use]
pub fn fit_moments(moments: &Moments, weight: f64, normal_space: &[Vector]) -> Option<PlaneFit> {
    let [xx, xy, xz, yy, yz, zz] = moments.scatter;
    let scatter = weight * Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
    let mean = Vector3::from(moments.mean);
    let (normal, covariance) = tell(mean, &scatter, weight * moments.count, normal_space)?;
    Some(PlaneFit {
        equation: [normal.x, normal.y, normal.z, -normal.dot(&mean)],
        covariance: rows(&covariance),
        rms: 0.0,
    })
}

/// The normal, and the covariance of the equation, that weighted points tell by their scatter.
fn tell(
    mean: Vector3<f64>,
    scatter: &Matrix3<f64>,
    total: f64,
    normal_space: &[Vector],
) -> Option<(Vector3<f64>, Matrix4<f64>)> {
    let rank = normal_space.len();
    let space = DMatrix::from_fn(3, rank, |k, j| normal_space[j][k]);
    let eigen = SymmetricEigen::new(space.transpose() * scatter * &space);
    let mut order: Vec<usize> = (0..rank).collect();
    order.sort_by(|&i, &j| eigen.eigenvalues[i].total_cmp(&eigen.eigenvalues[j]));
    let axis = |j: usize| -> Vector3<f64> {
        let axis = &space * eigen.eigenvectors.column(order[j]);
        Vector3::new(axis[0], axis[1], axis[2]).normalize()
    };
    let normal = axis(0);
    let turns: Vec<(Vector3<f64>, f64)> =
        (1..rank).map(|j| (axis(j), eigen.eigenvalues[order[j]])).collect();
    let largest = turns.iter().map(|turn| turn.1).fold(0.0, f64::max);
    // A spread below rounding means that a whole sheaf of planes fits.
    if turns.iter().any(|turn| turn.1 <= 1e-14 * largest || turn.1 <= 0.0) {
        return None;
    }
    let mut covariance = Matrix4::zeros();
    let offset = Vector4::new(0.0, 0.0, 0.0, 1.0);
    covariance += offset * offset.transpose() / total;
    for (turn, information) in turns {
        let change = Vector4::new(turn.x, turn.y, turn.z, -turn.dot(&mean));
        covariance += change * change.transpose() / information;
    }
    Some((normal, covariance))
}

/// Fits by least squares of the residuals along the beams, starting from `equation`.
///
/// The residual of a return is its range less the range at which its beam meets the plane. The
/// derivative is taken where the beam meets the plane, not at the noisy return, so the fit is
/// consistent. `normal_space` as in [`fit_plane`]. None when the beams do not tell a plane.
#[must_use]
pub fn fit_plane_to_ranges(
    points: &[Vector],
    directions: &[Vector],
    sigmas: &[f64],
    equation: [f64; 4],
    normal_space: &[Vector],
) -> Option<PlaneFit> {
    let origin = weighted_mean(points, &vec![1.0; points.len()], points.len() as f64)?;
    let mut normal = Vector3::new(equation[0], equation[1], equation[2]);
    let mut offset = equation[3] + normal.dot(&origin);
    let mut step = RangeStep::at(points, directions, sigmas, normal, offset, origin, normal_space)?;
    // Beams along the plane make the residuals far from linear: a step that overshoots is halved.
    let mut share = 1.0;
    for _ in 0..MAX_STEPS {
        if step.expected_gain <= 1e-9 * step.cost || share < 1e-3 {
            break;
        }
        let moved = (normal + share * step.turn).normalize();
        let shifted = offset + share * step.shift;
        let next = RangeStep::at(points, directions, sigmas, moved, shifted, origin, normal_space)?;
        if next.cost < step.cost {
            (normal, offset, step, share) = (moved, shifted, next, 1.0);
        } else {
            share /= 2.0;
        }
    }
    let mut to_equation = Matrix4x3::zeros();
    for (j, axis) in step.axes.iter().enumerate() {
        to_equation.set_column(j, &Vector4::new(axis.x, axis.y, axis.z, -axis.dot(&origin)));
    }
    to_equation.set_column(2, &Vector4::new(0.0, 0.0, 0.0, 1.0));
    let covariance = to_equation * step.covariance * to_equation.transpose();
    Some(PlaneFit {
        equation: [normal.x, normal.y, normal.z, offset - normal.dot(&origin)],
        covariance: rows(&covariance),
        rms: (step.cost / step.weight).sqrt(),
    })
}

/// One linearisation of the range residuals.
struct RangeStep {
    axes: Vec<Vector3<f64>>,
    turn: Vector3<f64>,
    shift: f64,
    covariance: Matrix3<f64>,
    cost: f64,
    expected_gain: f64,
    weight: f64,
}

impl RangeStep {
    fn at(
        points: &[Vector],
        directions: &[Vector],
        sigmas: &[f64],
        normal: Vector3<f64>,
        offset: f64,
        origin: Vector3<f64>,
        normal_space: &[Vector],
    ) -> Option<Self> {
        let axes = turning_axes(normal, normal_space);
        let mut information = Matrix3::zeros();
        let mut gradient = Vector3::zeros();
        let (mut cost, mut weight) = (0.0, 0.0);
        for ((point, direction), sigma) in points.iter().zip(directions).zip(sigmas) {
            let point = Vector3::from(*point) - origin;
            let direction = Vector3::from(*direction);
            let approach = normal.dot(&direction);
            if approach == 0.0 {
                return None;
            }
            let residual = (normal.dot(&point) + offset) / approach;
            let crossing = point - residual * direction;
            let mut row = Vector3::new(0.0, 0.0, 1.0);
            for (j, axis) in axes.iter().enumerate() {
                row[j] = axis.dot(&crossing);
            }
            row /= approach;
            let w = 1.0 / (sigma * sigma);
            information += w * row * row.transpose();
            gradient += w * residual * row;
            cost += w * residual * residual;
            weight += w;
        }
        let free = axes.len();
        // Directions that the constraint holds fixed neither move nor vary.
        for j in free..2 {
            information[(j, j)] = 1.0;
        }
        let mut covariance = information.cholesky()?.inverse();
        let change = -covariance * gradient;
        for j in free..2 {
            covariance[(j, j)] = 0.0;
        }
        let turn = axes.iter().enumerate().map(|(j, axis)| change[j] * axis).sum();
        let expected_gain = -change.dot(&gradient);
        Some(Self { axes, turn, shift: change[2], covariance, cost, expected_gain, weight })
    }
}

/// Orthonormal directions in which a normal may turn within `normal_space`.
fn turning_axes(normal: Vector3<f64>, normal_space: &[Vector]) -> Vec<Vector3<f64>> {
    let mut axes: Vec<Vector3<f64>> = Vec::with_capacity(2);
    let mut candidates: Vec<Vector3<f64>> = normal_space.iter().map(|&v| v.into()).collect();
    candidates.sort_by(|a, b| a.dot(&normal).abs().total_cmp(&b.dot(&normal).abs()));
    for candidate in candidates.into_iter().take(normal_space.len() - 1) {
        let mut axis = candidate - candidate.dot(&normal) * normal;
        for other in &axes {
            axis -= axis.dot(other) * other;
        }
        axes.push(axis.normalize());
    }
    axes
}

fn weighted_mean(points: &[Vector], weights: &[f64], total: f64) -> Option<Vector3<f64>> {
    if total.partial_cmp(&0.0) != Some(std::cmp::Ordering::Greater) {
        return None;
    }
    // Near the first point the sums keep their digits, wherever the cloud lies.
    let near = Vector3::from(*points.first()?);
    let sum: Vector3<f64> = points
        .iter()
        .zip(weights)
        .map(|(point, weight)| *weight * (Vector3::from(*point) - near))
        .sum();
    Some(near + sum / total)
}

fn rows(matrix: &Matrix4<f64>) -> [f64; 16] {
    std::array::from_fn(|k| matrix[(k / 4, k % 4)])
}
