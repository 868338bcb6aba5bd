//! Which parts are planes: too flat and too many to be chance, and not a patch of something curved.

use super::cells::{Flat, Image};
use super::growth::NOBODY;
use super::refinement::{Plane, around};
use crate::segmentation::SegmentationSettings;
use crate::segmentation::curvature::{Bend, Heights};
use crate::spread::Spread;

/// Least points of a plane.
const FEWEST: f64 = 10.0;
/// Pixels of a part that are looked at for purity and bending, about.
const SAMPLES: usize = 600;
/// Times its own points that a patch goes on over, at most.
const MOST: f64 = 16.0;
/// Steps from pixel to pixel beyond the border.
const STEPS: usize = 48;

/// A part and what is around it.
pub struct Part<'a> {
    /// The image.
    pub image: &'a Image<'a>,
    /// Labels of all pixels.
    pub labels: &'a [i32],
    /// Its label.
    pub label: i32,
    /// Its pixels, rising.
    pub places: &'a [u32],
    /// Its plane.
    pub plane: Plane,
    /// Points that count as one.
    pub alike: f64,
    /// What planes of clouds go by, too.
    pub settings: &'a SegmentationSettings,
}

/// Pixels that have been looked at, which a thread uses for one part after another.
#[derive(Default)]
pub struct Seen {
    turn: u32,
    turns: Vec<u32>,
}

impl Seen {
    fn begin(&mut self, n: usize) {
        self.turns.resize(n, 0);
        self.turn += 1;
    }

    fn has(&self, i: usize) -> bool {
        self.turns[i] == self.turn
    }

    fn insert(&mut self, i: usize) {
        self.turns[i] = self.turn;
    }
}

impl Part<'_> {
    /// Whether it is a plane.
    pub fn is_plane(&self, seen: &mut Seen) -> bool {
        let n = self.places.len() as f64;
        let [thin, middle, _] = self.plane.flat.variances;
        let acceptance = &self.settings.acceptance;
        let least = (acceptance.flat_by_chance / n).clamp(acceptance.flat.0, acceptance.flat.1);
        n >= FEWEST
            && middle > least * thin.max(self.plane.sigma.powi(2) / 4.0)
            && self.evidence() > 0.0
            && self.purity() >= acceptance.purity
            && !self.is_bent(seen)
    }

    /// Logarithm of the likelihood of its points on a plane over that of as many scattered as far
    /// across it as along it; less what the choice of a plane among all places costs.
    fn evidence(&self) -> f64 {
        let n = self.places.len() as f64 / self.alike;
        let [thin, middle, _] = self.plane.flat.variances;
        let thin = thin.max(self.plane.sigma.powi(2) / 4.0);
        let places = self.image.points.len() as f64;
        0.5 * n * (middle / thin).ln() - places.ln() - 1.5 * n.max(1.0).ln()
    }

    fn purity(&self) -> f64 {
        let (mut same, mut nobody) = (0, 0);
        let step = self.places.len().div_ceil(SAMPLES);
        for &i in self.places.iter().step_by(step) {
            for j in around(self.image, i as usize) {
                same += i64::from(self.labels[j] == self.label);
                nobody += i64::from(self.labels[j] == NOBODY);
            }
        }
        same as f64 / (same + nobody).max(1) as f64
    }

    /// Whether a paraboloid explains enough of `n` points' squared distances from their plane.
    fn is_clear(&self, bend: &Bend, n: f64) -> bool {
        let curvature = &self.settings.curvature;
        bend.turn > curvature.turn
            && bend.evidence > curvature.evidence * self.alike
            && bend.evidence > curvature.explained * (bend.evidence + n - 6.0)
    }

    /// Whether its points bend, or go on beyond its border on a surface that does.
    ///
    /// The paraboloid of its points takes what touches it and lies on it, whatever its label, step by
    /// step; beyond the border of a plane is nothing, another plane, or an edge.
    fn is_bent(&self, seen: &mut Seen) -> bool {
        let (image, w) = (self.image, self.image.width);
        let step = ((self.places.len() as f64 / SAMPLES as f64).sqrt().ceil() as usize).max(1);
        let is_sample = |i: usize| (i / w).is_multiple_of(step) && (i % w).is_multiple_of(step);
        let spread = as_spread(&self.plane.flat);
        let mut heights = Heights::over(&spread);
        let mut rim: Vec<usize> =
            self.places.iter().map(|&i| i as usize).filter(|&i| is_sample(i)).collect();
        for &i in &rim {
            heights.add(&image.points[i]);
        }
        let own = heights.count();
        if own < FEWEST {
            return false;
        }
        if heights.bend().is_some_and(|bend| self.is_clear(&bend, own)) {
            return true;
        }
        let reach = self.settings.curvature.on * self.plane.sigma;
        seen.begin(image.points.len());
        for &i in &rim {
            seen.insert(i);
        }
        for _ in 0..STEPS {
            let Some(surface) = heights.paraboloid() else { return false };
            let mut next = Vec::new();
            for &i in &rim {
                for j in stepped(image, i, step) {
                    if image.is_point(j)
                        && !seen.has(j)
                        && heights.above(&surface, &image.points[j]).abs() <= reach
                    {
                        seen.insert(j);
                        next.push(j);
                    }
                }
            }
            if next.is_empty() {
                return false;
            }
            for &i in &next {
                heights.add(&image.points[i]);
            }
            let n = heights.count();
            if n >= 2.0 * own && heights.bend().is_some_and(|bend| self.is_clear(&bend, n)) {
                return true;
            }
            if n >= MOST * own {
                return false;
            }
            rim = next;
        }
        false
    }
}

fn as_spread(flat: &Flat) -> Spread {
    Spread { mean: flat.mean, variances: flat.variances, normal: flat.normal }
}

/// The four pixels a few steps from one.
fn stepped(image: &Image, i: usize, step: usize) -> impl Iterator<Item = usize> + use<> {
    let (w, n) = (image.width, image.points.len());
    let x = i % w;
    [
        (x >= step).then(|| i - step),
        (x + step < w).then(|| i + step),
        (i >= step * w).then(|| i - step * w),
        (i + step * w < n).then(|| i + step * w),
    ]
    .into_iter()
    .flatten()
}
