//! The planes of parts of a cloud, whose points are known: fitted, and their inliers.

use crate::fit::{fit_moments, fit_plane_to_ranges};
use crate::spread::{Moments, dot};
use crate::{Error, PlaneFit, Vector, Workers, residuals};
use rayon::prelude::{IntoParallelRefIterator, ParallelIterator};

/// Standard deviations within which a plane takes points that lie amid its own.
const REACH: f64 = 4.0;
/// How much farther from the wanted plane than from its own the points of a part may lie.
const WORSE: f64 = 1.5;
/// Least standard deviation as a fraction of the extent: exact ranges are stored rounded.
const FLOOR: f64 = 1e-6;
/// Sine of the angle between beam and plane below which a beam counts as along the plane: it would
/// weigh most, and is often that of a neighbour.
const GRAZING: f64 = 0.1;
/// What rounding may take from the cosine of a plane of exactly the wanted direction.
const ROUNDING: f64 = 1e-12;

/// Which planes are wanted.
pub struct Wanted<'a> {
    /// Orthonormal vectors that span the normals.
    pub normal_space: &'a [Vector],
    /// What the angle of a normal is taken to.
    pub axis: Vector,
    /// Least and greatest cosine of that angle.
    pub cosines: [f64; 2],
}

impl Wanted<'_> {
    fn admits(&self, equation: &[f64; 4]) -> bool {
        let cosine = dot(&normal_of(equation), &self.axis).abs();
        cosine >= self.cosines[0] - ROUNDING && cosine <= self.cosines[1] + ROUNDING
    }
}

/// The plane of a part.
pub struct PartPlane {
    /// The fit.
    pub fit: PlaneFit,
    /// Greatest distance of an inlier.
    pub reach: f64,
    /// Rows of the points that are near, rising.
    pub inliers: Vec<u32>,
}

/// The wanted plane through the points of each label, None where they lie on none; -1 is no label.
///
/// With `directions` of the beams planes are fitted to ranges, and face the sensor. `sigma` is the
/// noise around each point; `limit` the greatest distance of an inlier, if given.
///
/// # Errors
/// [`Error::Stopped`] when the caller does not want to go on.
pub fn fit_parts(
    points: &[Vector],
    directions: Option<&[Vector]>,
    labels: &[i64],
    sigma: &[f64],
    wanted: &Wanted,
    limit: Option<f64>,
    workers: &Workers,
) -> Result<Vec<Option<PartPlane>>, Error> {
    let members = members(labels);
    workers.watch(|stop| {
        let fitted = members.par_iter().map(|rows| {
            stop.check()?;
            let part = Part { points, directions, rows };
            let noise = median(rows.iter().map(|&i| sigma[i as usize]).collect());
            Ok(part.plane(noise, wanted, limit).map(|(fit, reach)| {
                let is_near =
                    |&&i: &&u32| height(&fit.equation, &points[i as usize]).abs() <= reach;
                PartPlane { inliers: rows.iter().filter(is_near).copied().collect(), fit, reach }
            }))
        });
        fitted.collect()
    })
}

/// Rows of each label, rising.
fn members(labels: &[i64]) -> Vec<Vec<u32>> {
    let mut counts = Vec::new();
    for k in labels.iter().filter_map(|&label| usize::try_from(label).ok()) {
        if k >= counts.len() {
            counts.resize(k + 1, 0);
        }
        counts[k] += 1;
    }
    let mut members: Vec<Vec<u32>> = counts.into_iter().map(Vec::with_capacity).collect();
    for (&label, i) in labels.iter().zip(0..) {
        if let Ok(k) = usize::try_from(label) {
            members[k].push(i);
        }
    }
    members
}

struct Part<'a> {
    points: &'a [Vector],
    directions: Option<&'a [Vector]>,
    rows: &'a [u32],
}

impl Part<'_> {
    /// The plane, and how near to it points are inliers.
    fn plane(&self, noise: f64, wanted: &Wanted, limit: Option<f64>) -> Option<(PlaneFit, f64)> {
        let first = self.own(self.points).next()?;
        let moments = Moments::of(self.own(self.points), first);
        let (mean, mut normal) = (moments.mean, moments.spread().normal);
        let far = self.own(self.points).fold(0.0_f64, |far, point| {
            (0..3).fold(far, |far, k| far.max((point[k] - mean[k]).abs()))
        });
        let spread = self.rms(&normal, &mean).max(noise).max(FLOOR * far).max(1e-100);
        if self.facing(&normal).is_sign_negative() {
            normal = normal.map(|x| -x);
        }
        // Where beams graze, or both sides are seen, only the distances tell the plane.
        let fit = self
            .along_beams(&normal, &mean, spread, wanted)
            .or_else(|| self.across(&normal, &moments, spread, wanted))?;
        let normal = normal_of(&fit.equation);
        let off = dot(&normal, &mean) + fit.equation[3];
        let from = std::array::from_fn(|k| mean[k] - off * normal[k]);
        let is_near = self.rms(&normal, &from) <= WORSE * spread;
        is_near.then(|| (fit, limit.unwrap_or(REACH * spread)))
    }

    fn own<'b>(&'b self, of: &'b [Vector]) -> impl Iterator<Item = &'b Vector> {
        self.rows.iter().map(|&i| &of[i as usize])
    }

    /// Root mean square distance from the plane through a point.
    fn rms(&self, normal: &Vector, through: &Vector) -> f64 {
        let square = |point: &Vector| {
            let away: Vector = std::array::from_fn(|k| point[k] - through[k]);
            dot(&away, normal).powi(2)
        };
        (self.own(self.points).map(square).sum::<f64>() / self.rows.len() as f64).sqrt()
    }

    /// Positive when a normal points to the sensor, or, when that is not known, along its largest
    /// component.
    fn facing(&self, normal: &Vector) -> f64 {
        match self.directions {
            Some(beams) => -self.own(beams).map(|beam| dot(beam, normal)).sum::<f64>(),
            None => normal.iter().fold(0.0, |a: f64, &b| if b.abs() > a.abs() { b } else { a }),
        }
    }

    /// By the distances; None when the points tell no plane, or one that is not wanted.
    fn across(
        &self,
        side: &Vector,
        moments: &Moments,
        sigma: f64,
        wanted: &Wanted,
    ) -> Option<PlaneFit> {
        let fit = fit_moments(moments, 1.0 / (sigma * sigma), wanted.normal_space)?;
        // From the points, not from their scatter, whose rounding would show as a residual.
        let rms = self.rms(&normal_of(&fit.equation), &moments.mean);
        wanted.admits(&fit.equation).then(|| facing_as(side, PlaneFit { rms, ..fit }))
    }

    /// By the ranges, where the beams are known; None also when most meet the plane from behind.
    fn along_beams(
        &self,
        side: &Vector,
        mean: &Vector,
        sigma: f64,
        wanted: &Wanted,
    ) -> Option<PlaneFit> {
        let of = self.directions?;
        let is_steep = |&&i: &&u32| dot(&of[i as usize], side).abs() > GRAZING;
        let n_steep = self.rows.iter().filter(is_steep).count();
        let takes_all = 2 * n_steep <= self.rows.len();
        let some = self.rows.iter().filter(|i| takes_all || is_steep(i)).map(|&i| i as usize);
        let (points, beams): (Vec<Vector>, Vec<Vector>) =
            some.map(|i| (self.points[i], of[i])).unzip();
        let start = [side[0], side[1], side[2], -dot(side, mean)];
        let sigmas = vec![sigma; points.len()];
        let fit = fit_plane_to_ranges(&points, &beams, &sigmas, start, wanted.normal_space)
            .filter(|fit| wanted.admits(&fit.equation))?;
        let fit = facing_as(side, fit);
        let met = residuals(&points, Some(&beams), fit.equation);
        let n_met = met.into_iter().filter(|residual| residual.is_finite()).count();
        (2 * n_met >= points.len()).then_some(fit)
    }
}

/// A fit with its normal on the side of another.
fn facing_as(side: &Vector, mut fit: PlaneFit) -> PlaneFit {
    if dot(&normal_of(&fit.equation), side).is_sign_negative() {
        fit.equation = fit.equation.map(|x| -x);
    }
    fit
}

fn normal_of(&[a, b, c, _]: &[f64; 4]) -> Vector {
    [a, b, c]
}

fn height(equation: &[f64; 4], point: &Vector) -> f64 {
    dot(&normal_of(equation), point) + equation[3]
}

/// The middle value, or the mean of the two.
fn median(mut values: Vec<f64>) -> f64 {
    let (n, middle) = (values.len(), values.len() / 2);
    if n == 0 {
        return 0.0;
    }
    let (below, &mut upper, _) = values.select_nth_unstable_by(middle, f64::total_cmp);
    if n % 2 == 1 {
        return upper;
    }
    f64::midpoint(below.iter().copied().fold(f64::NEG_INFINITY, f64::max), upper)
}
