//! The readings of one sensor from many poses.

#![allow(clippy::inline_always)]

use super::caster::{Hit, RayCaster, Way};
use super::query::{Query, by_axis, unit};
use super::tiles::Tiles;
use crate::{Error, Vector, Workers};
use rayon::prelude::*;
use std::borrow::Cow;

/// Rays between two questions to the caller, about.
const CHUNK: usize = 1 << 16;
/// Rays of a task, about.
const TASK: usize = 1 << 11;

/// A rigid transform by rows: rotation and place.
pub type Transform = [f64; 16];

/// How a sensor makes readings of true ranges.
#[derive(Clone, Copy, Debug)]
pub struct Gate {
    /// A true range below has no reading.
    pub min_range: f64,
    /// A true range above has no reading.
    pub max_range: f64,
    /// Standard deviation of the noise.
    pub sigma: f64,
    /// Step to which readings are rounded; none when not positive.
    pub resolution: f64,
}

impl Gate {
    /// The reading of a true range; infinite for none.
    #[inline(always)]
    fn reading(&self, range: f64, noise: f64) -> f64 {
        if !(range >= self.min_range && range <= self.max_range) {
            return f64::INFINITY;
        }
        let reading = range + self.sigma * noise;
        if self.resolution > 0.0 {
            return (reading / self.resolution).round_ties_even() * self.resolution;
        }
        reading
    }
}

/// Rows for the readings of all beams, pose by pose.
pub struct Readings<'a> {
    /// Where beams end; NaN without a reading.
    pub points: &'a mut [Vector],
    /// Measured ranges; infinite without a reading.
    pub ranges: &'a mut [f64],
    /// What beams meet, within the gate or not.
    pub ids: &'a mut [i64],
}

impl RayCaster {
    /// Fills in what `beams` read from each pose, pose by pose. `noise` is standard normal, one a
    /// reading, or empty.
    ///
    /// Neighbouring beams are found once for all poses.
    ///
    /// # Errors
    /// [`Error::NoDirection`] for a beam without one, [`Error::Stopped`] when the caller does not
    /// want to go on.
    ///
    /// # Panics
    /// When there is not a row for each beam of each pose.
    pub fn scan(
        &self,
        poses: &[Transform],
        beams: &[Vector],
        gate: Gate,
        noise: &[f64],
        readings: Readings,
        workers: &Workers,
    ) -> Result<(), Error> {
        let n = poses.len() * beams.len();
        let Readings { points, ranges, ids } = readings;
        assert!(points.len() == n && ranges.len() == n && ids.len() == n, "one row a reading");
        assert!(noise.is_empty() || noise.len() == n, "one noise a reading, or none");
        let beams = units(beams)?;
        let way = self.way(Tiles::of(&beams).filter(|tiles| tiles.is_within(self.largest_tile())));
        // Whole bands of tiles.
        let band = if let Way::Packets(tiles) = way { tiles.band() } else { 1 };
        let part = band * TASK.div_ceil(band);
        let mut parts = Vec::new();
        let mut rest = (noise, points, ranges, ids);
        for pose in poses {
            for beams in beams.chunks(part) {
                let (noise, points, ranges, ids) = rest;
                let (noise, later_noise) = noise.split_at(beams.len().min(noise.len()));
                let (points, later_points) = points.split_at_mut(beams.len());
                let (ranges, later_ranges) = ranges.split_at_mut(beams.len());
                let (ids, later_ids) = ids.split_at_mut(beams.len());
                rest = (later_noise, later_points, later_ranges, later_ids);
                let readings = Readings { points, ranges, ids };
                parts.push(Part { pose, beams, gate, noise, names: self.names(), readings });
            }
        }
        for parts in parts.chunks_mut(CHUNK.div_ceil(part.min(beams.len().max(1)))) {
            workers.check()?;
            // A pose that is none may leave a beam without a direction.
            let all_have_directions =
                workers.install(|| parts.par_iter_mut().all(|part| self.cast_part(way, part)));
            if !all_have_directions {
                return Err(Error::NoDirection { row: 0 });
            }
        }
        Ok(())
    }
}

/// The unit directions of `beams` in the world from each pose, pose by pose: those that
/// [`RayCaster::scan`] casts.
///
/// # Errors
/// [`Error::NoDirection`] for a beam without one.
pub fn turned(poses: &[Transform], beams: &[Vector]) -> Result<Vec<Vector>, Error> {
    let beams = units(beams)?;
    let turn = |pose, beam| {
        let direction = rotated(pose, beam);
        unit(direction).unwrap_or(direction)
    };
    Ok(poses
        .par_iter()
        .flat_map_iter(|pose| beams.iter().map(move |&beam| turn(pose, beam)))
        .collect())
}

/// The beams at unit length, copied only where that is needed.
fn units(beams: &[Vector]) -> Result<Cow<'_, [Vector]>, Error> {
    if beams.iter().all(|&beam| unit(beam) == Some(beam)) {
        return Ok(Cow::Borrowed(beams));
    }
    beams
        .iter()
        .enumerate()
        .map(|(row, &beam)| unit(beam).ok_or(Error::NoDirection { row }))
        .collect()
}

#[inline(always)]
fn rotated(pose: &Transform, [x, y, z]: Vector) -> Vector {
    std::array::from_fn(|k| {
        let row = &pose[4 * k..4 * k + 3];
        row[0] * x + row[1] * y + row[2] * z
    })
}

/// Some beams from one pose.
struct Part<'a> {
    pose: &'a Transform,
    beams: &'a [Vector],
    gate: Gate,
    noise: &'a [f64],
    names: Option<&'a [i64]>,
    readings: Readings<'a>,
}

impl Query for Part<'_> {
    #[inline(always)]
    fn len(&self) -> usize {
        self.beams.len()
    }

    #[inline(always)]
    fn origin(&self, _: usize) -> Vector {
        [self.pose[3], self.pose[7], self.pose[11]]
    }

    #[inline(always)]
    fn direction(&self, row: usize) -> Vector {
        rotated(self.pose, self.beams[row])
    }

    #[inline(always)]
    fn origins<const N: usize>(&self, _: [u32; N]) -> [[f64; N]; 3] {
        let [x, y, z] = self.origin(0);
        [[x; N], [y; N], [z; N]]
    }

    #[inline(always)]
    fn directions<const N: usize>(&self, rows: [u32; N]) -> [[f64; N]; 3] {
        let [x, y, z] = by_axis(self.beams, rows);
        let mut turned = [[0.0; N]; 3];
        for i in 0..N {
            let direction = rotated(self.pose, [x[i], y[i], z[i]]);
            for k in 0..3 {
                turned[k][i] = direction[k];
            }
        }
        turned
    }

    #[inline(always)]
    fn answer(&mut self, row: usize, direction: Vector, hit: Hit) {
        let reading = self.gate.reading(hit.range, self.noise.get(row).copied().unwrap_or(0.0));
        let origin = self.origin(row);
        // No reading is no point.
        let way = if reading < f64::INFINITY { reading } else { f64::NAN };
        self.readings.points[row] = std::array::from_fn(|k| direction[k] * way + origin[k]);
        self.readings.ranges[row] = reading;
        self.readings.ids[row] = hit.id(self.names);
    }
}
