//! A cloud as the search for surfaces sees it: points with noise, normals, and what touches them.

use super::initial::Oriented;
use super::refinement::{Effort, Measured, settled};
use super::surface::{Kind, Surface};
use super::vectors::dot;
use crate::neighbors::PointTree;
use crate::neighbors::vicinity::Vicinity;
use crate::segmentation::graph::Graph;
use crate::spread::Moments;
use crate::{Error, Vector, Workers};

/// Nearest points that a point touches, and those among which bridges over gaps are looked for.
const NEAREST: usize = 12;
const LOOKED_AT: usize = 48;
/// Points of a normal for each standard deviation of noise over the spacing: its error is then 0.08.
const PER_NOISE: f64 = 44.0;
/// Points that tell a normal, each tried only where the one before is too few.
const SIZES: [usize; 5] = [12, 24, 48, 96, 192];
/// Error of a normal from k points, times k, over noise and spacing: 2 sqrt(pi).
const ERROR: f64 = 3.545;
/// Standard deviations from which a point does not count.
const CUTOFF: f64 = 5.0;
/// Most steps of a fit, coarse and fine, and the square of one, in standard errors, that is none: a
/// tenth of one moves the sum of squares by a hundredth, where a parameter costs three and more.
const STEPS: usize = 10;
const STILL: f64 = 0.01;
/// Square of the standard deviations that the misfit of a point is at most.
pub const FAR: f64 = 9.0;
/// Largest radius in terms of the extent of the points: beyond, the sagitta of a patch that points
/// fill is below 1 / 64 of it, and a plane stands for it.
const FLATTEST: f64 = 8.0;

/// The points of a tree, in its order.
pub struct Cloud<'a> {
    pub points: &'a [Vector],
    /// Standard deviation of the noise of each.
    pub sigma: &'a [f64],
    pub normals: Vec<Vector>,
    /// Standard deviation of each normal, radians.
    pub errors: Vec<f64>,
    pub graph: Graph,
    /// Number of points whose errors are one.
    pub area: f64,
}

/// Some points, gathered.
#[derive(Default, Clone)]
pub struct Sample {
    pub points: Vec<Vector>,
    pub normals: Vec<Vector>,
    pub sigma: Vec<f64>,
}

impl<'a> Cloud<'a> {
    /// Finds the normals of a cloud and which points touch.
    ///
    /// # Errors
    /// [`Error::Stopped`] when the caller does not want to go on.
    pub fn new(
        tree: &'a PointTree,
        sigma: &'a [f64],
        area: f64,
        workers: &Workers,
    ) -> Result<Self, Error> {
        let points = tree.points();
        let graph = Graph::new(tree, NEAREST, LOOKED_AT, workers)?;
        let mut found = vec![([0.0; 3], 0.0); points.len()];
        let n_near = NEAREST.min(points.len() - 1) as f64;
        workers.fill(
            &mut found,
            1,
            || SIZES.map(|_| Vicinity::new(tree)),
            |vicinities, i, found| {
                let spacing = graph.reach(i, points) * (std::f64::consts::PI / n_near).sqrt();
                let ratio = if spacing > 0.0 { sigma[i] / spacing } else { f64::INFINITY };
                let wanted = PER_NOISE * ratio;
                let most = SIZES.len() - 1;
                let size = SIZES.iter().position(|&k| k as f64 >= wanted).unwrap_or(most);
                let near = vicinities[size].nearest_by_place(i, SIZES[size]).iter();
                let near = near.map(|&place| &points[place as usize]);
                let normal = Moments::of(near, &points[i]).spread().normal;
                found[0] = (normal, ERROR * ratio / SIZES[size] as f64);
            },
        )?;
        let (normals, errors) = found.into_iter().unzip();
        Ok(Self { points, sigma, normals, errors, graph, area })
    }

    /// Up to `most` of some points, evenly.
    pub fn sample(&self, places: &[u32], most: usize) -> Sample {
        let stride = places.len().div_ceil(most).max(1);
        let mut sample = Sample::default();
        for &place in places.iter().step_by(stride) {
            sample.points.push(self.points[place as usize]);
            sample.normals.push(self.normals[place as usize]);
            sample.sigma.push(self.sigma[place as usize]);
        }
        sample
    }
}

impl Sample {
    /// The surface of a kind that fits best, from a given one or from the normals; None where half of
    /// the points are far from it.
    pub fn fitted(&self, kind: Kind, start: Option<Surface>) -> Option<Surface> {
        let oriented = Oriented { points: &self.points, normals: &self.normals };
        let mut surface = match start {
            Some(start) => start,
            None => oriented.surface(kind)?,
        };
        if self.points.len() <= kind.n_parameters() {
            return None;
        }
        let off = self.median_misfit(&surface);
        if off > 1.0 {
            // From afar by a scale that lets half of the points count.
            let sigma: Vec<f64> = self.sigma.iter().map(|sigma| sigma * off).collect();
            surface = self.settled(&surface, &sigma);
            if self.median_misfit(&surface) > FAR.sqrt() {
                return None;
            }
        }
        surface = self.settled(&surface, &self.sigma);
        surface.is_sound(FLATTEST * self.extent()).then_some(surface)
    }

    fn settled(&self, start: &Surface, sigma: &[f64]) -> Surface {
        let how = Effort { cutoff: CUTOFF, n_steps: STEPS, still: STILL, is_isotropic: false };
        settled(start, &Measured { points: &self.points, sigma, beams: None }, &how).0
    }

    /// Mean square of the distances in standard deviations, none more than [`FAR`], for each degree
    /// of freedom.
    pub fn misfit(&self, surface: &Surface) -> f64 {
        let n = self.points.len() as f64;
        let freedom = (n - surface.kind.n_parameters() as f64).max(1.0);
        self.squares(surface).map(|square| square.min(FAR)).sum::<f64>() / freedom
    }

    /// Squares of the distances in standard deviations; infinite beyond the apex of a cone.
    pub fn squares<'b>(&'b self, surface: &'b Surface) -> impl Iterator<Item = f64> + 'b {
        self.points.iter().zip(&self.sigma).map(|(point, sigma)| square(surface, point, *sigma))
    }

    fn median_misfit(&self, surface: &Surface) -> f64 {
        let mut squares: Vec<f64> = self.squares(surface).collect();
        let middle = squares.len() / 2;
        squares.select_nth_unstable_by(middle, f64::total_cmp).1.sqrt()
    }

    fn extent(&self) -> f64 {
        let ends = |k: usize| {
            let along = self.points.iter().map(|point| point[k]);
            along.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(x), b.max(x)))
        };
        let sides = [ends(0), ends(1), ends(2)].map(|(low, high)| high - low);
        dot(&sides, &sides).sqrt()
    }
}

/// Square of the distance of a point in standard deviations; infinite beyond the apex of a cone.
pub fn square(surface: &Surface, point: &Vector, sigma: f64) -> f64 {
    let at = surface.sight(point);
    if surface.is_beyond_apex(&at) { f64::INFINITY } else { (at.distance / sigma).powi(2) }
}
