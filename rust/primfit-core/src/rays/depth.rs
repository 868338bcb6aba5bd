//! Readings of a depth camera: what its image is of true ranges, row by row.

use super::query::unit;
use super::scan::{Noise, Transform, rotated, rounded};
use crate::{Error, Vector, Workers};
use rayon::prelude::*;

/// Pixels between two questions to the caller, about.
const CHUNK: usize = 1 << 18;

/// How a depth camera makes readings of true depths, which are ranges times the cosine between a
/// beam and the optical axis, the third of the sensor.
#[derive(Clone, Copy, Debug)]
pub struct DepthGate {
    /// A true depth below has no reading.
    pub min_depth: f64,
    /// A true depth above has no reading.
    pub max_depth: f64,
    /// `[a, b, c]`: the standard deviation of a depth z is `a + b (z - c)^2`.
    pub sigma: [f64; 3],
    /// What the noise is drawn from, with the number of the beam.
    pub seed: u64,
    /// Step to which depths are rounded; none when not positive.
    pub resolution: f64,
    /// Pixels of a row.
    pub width: usize,
    /// The second eye, which disparities are measured from.
    pub eye: Eye,
}

/// A projector or second camera beside a depth camera, whose rows are those of the camera.
#[derive(Clone, Copy, Debug)]
pub struct Eye {
    /// Focal length in pixels times the distance along rows: the disparity of a depth of 1, negative
    /// where the eye is on the side of the first pixel; 0 for none.
    pub disparity: f64,
    /// Standard deviation of a disparity, pixels.
    pub sigma: f64,
    /// Step to which disparities are rounded, pixels; none when not positive.
    pub step: f64,
    /// Whether there is no reading where something hides a point from the eye; then no reading tells
    /// nothing, and is NaN.
    pub has_shadow: bool,
    /// Whether there is no reading of points outside an image of the eye as wide as that of the
    /// camera; then no reading tells nothing, either.
    pub is_camera: bool,
}

impl DepthGate {
    /// Turns true ranges of images, pose by pose, into readings, and sets their points. The first
    /// beam has the number `first`.
    ///
    /// # Errors
    /// [`Error::Stopped`] when the caller does not want to go on.
    pub(super) fn read(
        &self,
        poses: &[Transform],
        beams: &[Vector],
        first: u64,
        points: &mut [Vector],
        ranges: &mut [f64],
        workers: &Workers,
    ) -> Result<(), Error> {
        let width = self.width.max(1);
        let in_image = beams.len().div_ceil(width).max(1);
        let at_once = CHUNK.div_ceil(width) * width;
        let chunks = points.chunks_mut(at_once).zip(ranges.chunks_mut(at_once));
        for (chunk, (points, ranges)) in chunks.enumerate() {
            workers.check()?;
            let rows = points.par_chunks_mut(width).zip(ranges.par_chunks_mut(width)).enumerate();
            workers.install(|| {
                rows.for_each(|(row, (points, ranges))| {
                    let row = chunk * (at_once / width) + row;
                    let number = first + (row * width) as u64;
                    let pose = &poses[row / in_image];
                    let place = row % in_image * width;
                    let beams = &beams[place..beams.len().min(place + width)];
                    self.read_row(pose, beams, number, points, ranges);
                });
            });
        }
        Ok(())
    }

    fn read_row(
        &self,
        pose: &Transform,
        beams: &[Vector],
        number: u64,
        points: &mut [Vector],
        ranges: &mut [f64],
    ) {
        let noise = Noise { seed: self.seed };
        let mut depths: Vec<f64> =
            beams.iter().zip(ranges.iter()).map(|(beam, range)| range * beam[2]).collect();
        let is_seen = self.eye.sees(&depths);
        let has_noise = self.sigma_of(self.min_depth) > 0.0 || self.sigma_of(self.max_depth) > 0.0;
        // Without the second eye there is no depth, whether something is there or not.
        let missing = if is_seen.is_some() { f64::NAN } else { f64::INFINITY };
        for (i, depth) in depths.iter_mut().enumerate() {
            let is_within = *depth >= self.min_depth && *depth <= self.max_depth;
            if !(is_within && is_seen.as_ref().is_none_or(|is_seen| is_seen[i])) {
                *depth = missing;
                continue;
            }
            if has_noise {
                *depth += self.sigma_of(*depth) * noise.of(number + i as u64);
            }
            *depth = self.eye.rounded(*depth);
            if self.resolution > 0.0 {
                *depth = rounded(*depth, self.resolution);
            }
            // No image says so of what the camera sees.
            if *depth <= 0.0 || *depth == f64::INFINITY {
                *depth = missing;
            }
        }
        for (i, beam) in beams.iter().enumerate() {
            ranges[i] = depths[i] / beam[2];
            let way = if ranges[i] < f64::INFINITY { ranges[i] } else { f64::NAN };
            let turned = rotated(pose, *beam);
            let direction = unit(turned).unwrap_or(turned);
            points[i] = std::array::from_fn(|k| direction[k] * way + pose[4 * k + 3]);
        }
    }

    /// Standard deviation of a depth before it is rounded.
    fn sigma_of(&self, depth: f64) -> f64 {
        let [constant, square, offset] = self.sigma;
        let axial = constant + square * (depth - offset) * (depth - offset);
        if self.eye.sigma > 0.0 {
            // A disparity d changes by dz d / z.
            let of_disparity = self.eye.sigma * depth * depth / self.eye.disparity;
            (axial * axial + of_disparity * of_disparity).sqrt()
        } else {
            axial
        }
    }
}

impl Eye {
    /// Whether the eye sees what pixels of a row see at some depths; none when it does not matter.
    ///
    /// Along a row, what is farther on the side of the eye is so for the eye, too, unless something
    /// nearer comes between.
    fn sees(&self, depths: &[f64]) -> Option<Vec<bool>> {
        if self.disparity == 0.0 || !(self.has_shadow || self.is_camera) {
            return None;
        }
        let side = self.disparity.signum();
        let width = depths.len();
        let mut sees = vec![true; width];
        let mut nearest = f64::INFINITY;
        for step in 0..width {
            // From the side of the eye to the other one.
            let pixel = if side > 0.0 { width - 1 - step } else { step };
            let place = pixel as f64 - self.disparity / depths[pixel];
            if self.has_shadow {
                sees[pixel] &= side * place < nearest;
                nearest = nearest.min(side * place);
            }
            if self.is_camera {
                sees[pixel] &= place >= -0.5 && place <= width as f64 - 0.5;
            }
        }
        Some(sees)
    }

    /// The depth of a disparity in whole steps; infinite where that is none.
    fn rounded(&self, depth: f64) -> f64 {
        if self.disparity == 0.0 || self.step <= 0.0 {
            return depth;
        }
        let disparity = rounded(self.disparity.abs() / depth, self.step);
        if disparity > 0.0 { self.disparity.abs() / disparity } else { f64::INFINITY }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn eye(disparity: f64) -> Eye {
        Eye { disparity, sigma: 0.0, step: 0.0, has_shadow: true, is_camera: false }
    }

    /// A near board before a wall throws a shadow as wide as its disparity exceeds that of the wall.
    #[test]
    fn a_board_throws_a_shadow_away_from_the_eye() {
        let depths: Vec<f64> =
            (0..40).map(|i| if (20..30).contains(&i) { 1.0 } else { 2.0 }).collect();
        let lost = |disparity| -> Vec<usize> {
            let sees = eye(disparity).sees(&depths).unwrap_or_default();
            (0..40).filter(|&i| !sees[i]).collect()
        };
        // Disparities of 10 and 5 pixels.
        assert_eq!(lost(10.0), [15, 16, 17, 18, 19]);
        assert_eq!(lost(-10.0), [30, 31, 32, 33, 34]);
        assert!(eye(0.0).sees(&depths).is_none());
    }

    #[test]
    fn a_second_camera_does_not_see_all_of_the_first() {
        let eye = Eye { has_shadow: false, is_camera: true, ..eye(10.0) };
        let sees = eye.sees(&[2.0; 40]).unwrap_or_default();
        assert_eq!(sees.iter().position(|&sees| sees), Some(5));
        assert!(sees[5..].iter().all(|&sees| sees));
    }

    #[test]
    fn disparities_come_in_steps() {
        let eye = Eye { step: 0.5, ..eye(10.0) };
        assert_eq!(eye.rounded(4.1), 4.0);
        assert_eq!(eye.rounded(1e3), f64::INFINITY);
        assert_eq!(super::Eye { step: 0.0, ..eye }.rounded(4.1), 4.1);
    }
}
