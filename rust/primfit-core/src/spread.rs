//! How points spread about their mean: moments that add, and their principal axes.

use crate::Vector;

/// Rounds after which a symmetric matrix counts as diagonal; six are usual.
const MOST_ROUNDS: usize = 32;

/// Steps of Newton's method; four to eight are usual.
const MOST_STEPS: usize = 20;
/// Product of the differences of the smallest variance to the others, over the square of their
/// sum, above which it is a root apart.
const APART: f64 = 1e-3;

/// Number, mean and scatter of some points.
///
/// Two of them add without loss of digits (Chan, Golub, `LeVeque`: Updating formulae and a pairwise
/// algorithm for computing sample variances, 1979).
#[derive(Debug, Clone, Copy, Default)]
pub struct Moments {
    /// Number of points.
    pub count: f64,
    /// Mean of the points.
    pub mean: Vector,
    /// Sums of the products xx, xy, xz, yy, yz, zz of the differences to the mean.
    pub scatter: [f64; 6],
}

impl Moments {
    /// Of points, in their order, with digits kept near `origin`.
    pub fn of<'a>(points: impl Iterator<Item = &'a Vector>, origin: &Vector) -> Self {
        let mut sums = Sums::new(*origin);
        for point in points {
            sums.add(point);
        }
        sums.moments()
    }

    /// Of the points of both.
    pub fn joined(&self, other: &Self) -> Self {
        let count = self.count + other.count;
        if other.count == 0.0 || count == 0.0 {
            return *self;
        }
        let apart: Vector = std::array::from_fn(|k| other.mean[k] - self.mean[k]);
        let share = other.count / count;
        let mean = std::array::from_fn(|k| self.mean[k] + share * apart[k]);
        let between = products(&apart);
        let weight = self.count * share;
        let scatter =
            std::array::from_fn(|k| self.scatter[k] + other.scatter[k] + weight * between[k]);
        Self { count, mean, scatter }
    }

    /// Principal variances and axes.
    pub fn spread(&self) -> Spread {
        Spread::of(&self.scatter.map(|sum| sum / self.count), self.mean)
    }
}

/// Moments about a fixed origin, to which points are added one by one.
#[derive(Debug, Clone, Copy)]
pub struct Sums {
    origin: Vector,
    count: f64,
    sum: Vector,
    squares: [f64; 6],
}

impl Sums {
    /// Nothing yet; the origin should lie among the points.
    pub fn new(origin: Vector) -> Self {
        Self { origin, count: 0.0, sum: [0.0; 3], squares: [0.0; 6] }
    }

    /// Adds one point.
    pub fn add(&mut self, point: &Vector) {
        let away: Vector = std::array::from_fn(|k| point[k] - self.origin[k]);
        let squares = products(&away);
        self.count += 1.0;
        self.sum = std::array::from_fn(|k| self.sum[k] + away[k]);
        self.squares = std::array::from_fn(|k| self.squares[k] + squares[k]);
    }

    /// Their moments.
    pub fn moments(&self) -> Moments {
        if self.count == 0.0 {
            return Moments::default();
        }
        let mean = self.sum.map(|sum| sum / self.count);
        let between = products(&mean);
        Moments {
            count: self.count,
            mean: std::array::from_fn(|k| self.origin[k] + mean[k]),
            scatter: std::array::from_fn(|k| self.squares[k] - self.count * between[k]),
        }
    }
}

/// Principal variances of points, rising, and the axis of the smallest.
#[derive(Debug, Clone, Copy)]
pub struct Spread {
    /// Mean of the points.
    pub mean: Vector,
    /// Variances, rising, never negative.
    pub variances: Vector,
    /// Unit axis of the smallest variance.
    pub normal: Vector,
}

impl Spread {
    /// By Newton's method for the least root of the characteristic polynomial, and the rows across
    /// its axis; where two variances are nearly alike, as along a line, by Jacobi's rotations. Both
    /// use nothing but arithmetic and square roots: the same bits on every machine.
    pub fn of(covariance: &[f64; 6], mean: Vector) -> Self {
        let [xx, _, _, yy, _, zz] = *covariance;
        let total = xx + yy + zz;
        let [xx, xy, xz, yy, yz, zz] = covariance.map(|sum| sum / total);
        let minors = xx * yy - xy * xy + xx * zz - xz * xz + yy * zz - yz * yz;
        let determinant =
            xx * (yy * zz - yz * yz) - xy * (xy * zz - xz * yz) + xz * (xy * yz - xz * yy);
        let mut least = 0.0;
        for _ in 0..MOST_STEPS {
            let value = ((least - 1.0) * least + minors) * least - determinant;
            let step = value / ((3.0 * least - 2.0) * least + minors);
            least -= step;
            if step.abs() <= f64::EPSILON {
                break;
            }
        }
        let rows = [[xx - least, xy, xz], [xy, yy - least, yz], [xz, yz, zz - least]];
        let (normal, square) = [(0, 1), (0, 2), (1, 2)]
            .map(|(i, j)| cross(&rows[i], &rows[j]))
            .map(|normal| (normal, dot(&normal, &normal)))
            .into_iter()
            .fold(([0.0; 3], 0.0), |a, b| if b.1 > a.1 { b } else { a });
        let length = square.sqrt();
        // What is no number is not apart either.
        if length > APART {
            let half = 0.5 * (1.0 - least);
            let product = minors - 2.0 * least * half;
            let long = half + (half * half - product).max(0.0).sqrt();
            let variances = [least, product / long, long].map(|share| (share * total).max(0.0));
            return Self { mean, variances, normal: normal.map(|x| x / length) };
        }
        Self::by_rotations(covariance, mean)
    }

    fn by_rotations(covariance: &[f64; 6], mean: Vector) -> Self {
        let [xx, xy, xz, yy, yz, zz] = *covariance;
        let mut a = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]];
        let mut axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        for _ in 0..MOST_ROUNDS {
            let off = a[0][1] * a[0][1] + a[0][2] * a[0][2] + a[1][2] * a[1][2];
            let on = a[0][0] * a[0][0] + a[1][1] * a[1][1] + a[2][2] * a[2][2];
            if off <= 1e-34 * on || !off.is_finite() {
                break;
            }
            for (p, q) in [(0, 1), (0, 2), (1, 2)] {
                rotate(&mut a, &mut axes, p, q);
            }
        }
        let mut order = [0, 1, 2];
        order.sort_by(|&i, &j| a[i][i].total_cmp(&a[j][j]));
        let normal = std::array::from_fn(|k| axes[k][order[0]]);
        Self { mean, variances: order.map(|i| a[i][i].max(0.0)), normal }
    }

    /// Signed distance of a point to the plane of the two larger axes.
    pub fn distance(&self, point: &Vector) -> f64 {
        let away = |k: usize| self.normal[k] * (point[k] - self.mean[k]);
        away(0) + away(1) + away(2)
    }
}

/// Makes the element (p, q) zero.
fn rotate(a: &mut [[f64; 3]; 3], axes: &mut [[f64; 3]; 3], p: usize, q: usize) {
    if a[p][q] == 0.0 {
        return;
    }
    let theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
    let t = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
    let c = 1.0 / (t * t + 1.0).sqrt();
    let s = t * c;
    let r = 3 - p - q;
    let (apq, apr, aqr) = (a[p][q], a[p][r], a[q][r]);
    a[p][p] -= t * apq;
    a[q][q] += t * apq;
    (a[p][q], a[q][p]) = (0.0, 0.0);
    a[p][r] = c * apr - s * aqr;
    a[q][r] = s * apr + c * aqr;
    (a[r][p], a[r][q]) = (a[p][r], a[q][r]);
    for row in axes {
        (row[p], row[q]) = (c * row[p] - s * row[q], s * row[p] + c * row[q]);
    }
}

fn products(v: &Vector) -> [f64; 6] {
    [v[0] * v[0], v[0] * v[1], v[0] * v[2], v[1] * v[1], v[1] * v[2], v[2] * v[2]]
}

/// Orthonormal directions across a unit vector.
pub fn axes_across(normal: &Vector) -> [Vector; 2] {
    let least = (1..3).fold(0, |k, j| if normal[j].abs() < normal[k].abs() { j } else { k });
    let mut first = normal.map(|n| -n * normal[least]);
    first[least] += 1.0;
    let length = dot(&first, &first).sqrt();
    first = first.map(|x| x / length);
    [first, cross(normal, &first)]
}

/// Vector product.
fn cross(a: &Vector, b: &Vector) -> Vector {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Scalar product.
pub fn dot(a: &Vector, b: &Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn roots_and_rotations_agree(
            points in prop::collection::vec(prop::array::uniform3(-1.0..1.0), 3..20),
            flat in prop::sample::select(vec![0.0, 1e-9, 1e-4, 0.1]),
            far in -1e3..1e3,
        ) {
            let tilted = |[x, y, z]: &Vector| [x + far, *y, 0.5 * x - 0.3 * y + flat * z];
            let points: Vec<Vector> = points.iter().map(tilted).collect();
            let moments = Moments::of(points.iter(), &points[0]);
            let covariance = moments.scatter.map(|sum| sum / moments.count);
            let turned = Spread::by_rotations(&covariance, moments.mean);
            let spread = moments.spread();
            let [least, middle, most] = turned.variances;
            for (own, other) in spread.variances.into_iter().zip(turned.variances) {
                prop_assert!((own - other).abs() < 1e-13 * most);
            }
            // How well two variances that are nearly alike tell their axes apart.
            prop_assume!(middle - least > 1e-3 * most);
            prop_assert!(1.0 - dot(&spread.normal, &turned.normal).abs() < 1e-12);
        }
    }

    #[test]
    fn lines_and_single_points_have_some_normal() {
        for point in [[1.0, 2.0, 3.0], [0.0, 1e-3, 0.0], [0.0; 3]] {
            let points: Vec<Vector> = (0..5).map(|i| point.map(|x| x * f64::from(i))).collect();
            let normal = Moments::of(points.iter(), &points[0]).spread().normal;
            assert!((dot(&normal, &normal) - 1.0).abs() < 1e-12);
            assert!(dot(&normal, &point).abs() < 1e-7);
        }
    }
}
