//! Whether points near a plane lie on a curved surface.

use super::settings::Curving;
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
    /// Share of the sum of squares that bending explains.
    pub share: f64,
}

impl Bend {
    /// Of the paraboloid that fits the points best; None when they do not tell one.
    pub fn of<'a>(points: impl Iterator<Item = &'a Vector>, spread: &Spread) -> Option<Self> {
        let mut heights = Heights::over(spread);
        for point in points {
            heights.add(point);
        }
        heights.bend()
    }

    /// Whether the points lie on a curved surface, if their noise is white.
    pub(super) fn is_clear(&self, settings: &Curving) -> bool {
        self.turn > settings.turn && self.evidence > settings.evidence
    }
}

/// Sums from which the paraboloid follows that fits heights over a plane by least squares.
pub struct Heights {
    mean: Vector,
    axes: [Vector; 3],
    unit: f64,
    normal_matrix: SMatrix<f64, 6, 6>,
    right: SVector<f64, 6>,
    squares: f64,
}

/// Coefficients of 1, u, v, u u / 2, u v, v v / 2 in units of the plane's extent.
pub struct Paraboloid(SVector<f64, 6>);

impl Heights {
    /// None yet.
    pub fn over(spread: &Spread) -> Self {
        let [first, second] = axes_across(&spread.normal);
        Self {
            mean: spread.mean,
            axes: [first, second, spread.normal],
            unit: spread.variances[1].sqrt(),
            normal_matrix: SMatrix::zeros(),
            right: SVector::zeros(),
            squares: 0.0,
        }
    }

    /// One more point.
    pub fn add(&mut self, point: &Vector) {
        let (row, height) = self.terms(point);
        self.normal_matrix += row * row.transpose();
        self.right += row * height;
        self.squares += height * height;
    }

    /// Number of points.
    pub fn count(&self) -> f64 {
        self.normal_matrix[(0, 0)]
    }

    /// The paraboloid that fits best; None when the points do not tell one.
    pub fn paraboloid(&self) -> Option<Paraboloid> {
        Some(Paraboloid(self.normal_matrix.cholesky()?.solve(&self.right)))
    }

    /// Height of a point over a paraboloid.
    pub fn above(&self, paraboloid: &Paraboloid, point: &Vector) -> f64 {
        let (row, height) = self.terms(point);
        self.unit * (height - row.dot(&paraboloid.0))
    }

    /// How much the paraboloid bends.
    pub fn bend(&self) -> Option<Bend> {
        let Paraboloid(terms) = self.paraboloid()?;
        let count = self.count();
        let explained = terms.dot(&self.right);
        let variance = (self.squares - explained).max(0.0) / (count - 6.0);
        let moments = [(1, 1), (1, 2), (2, 2)].map(|place| self.normal_matrix[place]);
        let [a, b, c] = [terms[3], terms[4], terms[5]];
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
        let share = explained / self.squares.max(f64::MIN_POSITIVE);
        Some(Bend { turn, evidence: explained / variance.max(f64::MIN_POSITIVE), share })
    }

    fn terms(&self, point: &Vector) -> (SVector<f64, 6>, f64) {
        let away: Vector = std::array::from_fn(|k| (point[k] - self.mean[k]) / self.unit);
        let [u, v, height] = self.axes.map(|axis| dot(&away, &axis));
        (SVector::from([1.0, u, v, u * u / 2.0, u * v, v * v / 2.0]), height)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;
    use crate::spread::Moments;

    fn saddle(a: f64, b: f64, size: f64) -> Vec<Vector> {
        let side = (0..21).map(|i| f64::from(i - 10) / 10.0);
        side.clone()
            .flat_map(|u| side.clone().map(move |v| (u, v)))
            .map(|(u, v)| [u, v, f64::midpoint(a * u * u, b * v * v)].map(|x| x * size + 5.0))
            .collect()
    }

    #[test]
    fn the_turn_is_curvature_times_width_at_any_scale() {
        for size in [0.01, 1.0, 100.0] {
            let points = saddle(0.02, -0.1, size);
            let spread = Moments::of(points.iter(), &points[0]).spread();
            let bend = Bend::of(points.iter(), &spread).unwrap();
            // The deviation of 21 even steps over a width of 2 stands for a width of 2.1.
            assert!((bend.turn - 0.1 * 2.1).abs() < 0.005, "{bend:?}");
            assert!(bend.is_clear(&Curving::default()));
        }
    }

    #[test]
    fn a_paraboloid_goes_through_its_points() {
        let points = saddle(0.3, 0.1, 1.0);
        let mut heights = Heights::over(&Moments::of(points.iter(), &points[0]).spread());
        for point in &points {
            heights.add(point);
        }
        let surface = heights.paraboloid().unwrap();
        assert_eq!(heights.count(), points.len() as f64);
        let off = |point: &Vector| heights.above(&surface, point);
        assert!(points.iter().all(|point| off(point).abs() < 1e-12));
        assert!((off(&[5.0, 5.0, 5.5]).abs() - 0.5).abs() < 1e-12);
    }

    #[test]
    fn four_points_tell_no_bend() {
        let points = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.3]];
        let spread = Moments::of(points.iter(), &points[0]).spread();
        assert_eq!(Bend::of(points.iter(), &spread), None);
    }
}
