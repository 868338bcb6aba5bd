//! The readings of one sensor from many poses.

#![allow(clippy::inline_always)]
// Lazy operators would be branches; lanes are counted, so that the compiler sees whole vectors.
#![allow(clippy::needless_bitwise_bool, clippy::needless_range_loop)]

use super::caster::{RayCaster, Way};
use super::depth::DepthGate;
use super::query::{Nearest, Query, by_axis, unit};
use super::tiles::Tiles;
use crate::{Error, Vector, Workers};
use rand_distr::{Distribution, StandardNormal};
use rand_xoshiro::SplitMix64;
use rand_xoshiro::rand_core::SeedableRng;
use rayon::prelude::*;
use std::borrow::Cow;

/// Rays between two questions to the caller, about.
const CHUNK: usize = 1 << 16;
/// Rays of a task, about.
const TASK: usize = 1 << 11;
/// Bytes that a direction in the world takes while all are put together.
const DIRECTION_BYTES: usize = 96;

/// Odd, so that states stay apart for all numbers, and not the step of the generator.
const APART: u64 = 0xd1b5_4a32_d192_ed03;

/// A rigid transform by rows: rotation and place.
pub type Transform = [f64; 16];

/// How a sensor makes readings of true ranges.
#[derive(Clone, Copy, Debug)]
pub enum Gate {
    /// By how far a beam goes.
    Range(RangeGate),
    /// By how far that is along the optical axis.
    Depth(DepthGate),
}

/// How a sensor makes readings of true ranges by these alone.
#[derive(Clone, Copy, Debug)]
pub struct RangeGate {
    /// A true range below has no reading.
    pub min_range: f64,
    /// A true range above has no reading.
    pub max_range: f64,
    /// Standard deviation of the noise.
    pub sigma: f64,
    /// What the noise is drawn from, with the number of the beam.
    pub seed: u64,
    /// Step to which readings are rounded; none when not positive.
    pub resolution: f64,
}

impl RangeGate {
    /// True ranges themselves.
    const EXACT: Self =
        Self { min_range: 0.0, max_range: f64::INFINITY, sigma: 0.0, seed: 0, resolution: 0.0 };

    /// What beams of some numbers read of true ranges; infinite for nothing.
    #[inline(always)]
    fn readings<const N: usize>(&self, ranges: &[f64; N], numbers: [u64; N]) -> [f64; N] {
        let mut readings = *ranges;
        for range in &mut readings {
            let is_within = (*range >= self.min_range) & (*range <= self.max_range);
            *range = if is_within { *range } else { f64::INFINITY };
        }
        if self.sigma > 0.0 {
            let noise = Noise { seed: self.seed };
            for (reading, number) in readings.iter_mut().zip(numbers) {
                *reading += self.sigma * noise.of(number);
            }
        }
        if self.resolution > 0.0 {
            for reading in &mut readings {
                *reading = rounded(*reading, self.resolution);
            }
        }
        readings
    }
}

/// The whole number of steps that is nearest.
#[inline(always)]
pub(super) fn rounded(value: f64, step: f64) -> f64 {
    (value / step).round_ties_even() * step
}

/// Numbers that depend on a seed and on the beam alone.
#[derive(Clone, Copy)]
pub(super) struct Noise {
    pub seed: u64,
}

impl Noise {
    /// The standard normal noise of the beam of a number, whichever thread asks for it.
    #[inline(always)]
    pub fn of(self, number: u64) -> f64 {
        let state = self.seed.wrapping_add(number.wrapping_mul(APART));
        StandardNormal.sample(&mut SplitMix64::seed_from_u64(state))
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
    /// Fills in what `beams` read from each pose, pose by pose; the first beam of all has the number
    /// `first`.
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
        first: u64,
        readings: Readings,
        workers: &Workers,
    ) -> Result<(), Error> {
        let n = poses.len() * beams.len();
        let Readings { points, ranges, ids } = readings;
        assert!(points.len() == n && ranges.len() == n && ids.len() == n, "one row a reading");
        let beams = units(beams)?;
        match gate {
            Gate::Range(gate) => {
                let readings = Readings { points, ranges, ids };
                self.scan_by_range(poses, &beams, gate, first, readings, workers)
            }
            Gate::Depth(gate) => {
                let exact = Readings { points: &mut *points, ranges: &mut *ranges, ids };
                self.scan_by_range(poses, &beams, RangeGate::EXACT, first, exact, workers)?;
                gate.read(poses, &beams, first, points, ranges, workers)
            }
        }
    }

    fn scan_by_range(
        &self,
        poses: &[Transform],
        beams: &[Vector],
        gate: RangeGate,
        first: u64,
        readings: Readings,
        workers: &Workers,
    ) -> Result<(), Error> {
        let Readings { points, ranges, ids } = readings;
        let way = self.way(Tiles::of(beams).filter(|tiles| tiles.is_within(self.largest_tile())));
        // Whole bands of tiles.
        let band = if let Way::Packets(tiles) = way { tiles.band() } else { 1 };
        let part = band * TASK.div_ceil(band);
        let mut parts = Vec::new();
        let mut rest = (first, points, ranges, ids);
        for pose in poses {
            for beams in beams.chunks(part) {
                let (first, points, ranges, ids) = rest;
                let (points, later_points) = points.split_at_mut(beams.len());
                let (ranges, later_ranges) = ranges.split_at_mut(beams.len());
                let (ids, later_ids) = ids.split_at_mut(beams.len());
                rest = (first + beams.len() as u64, later_points, later_ranges, later_ids);
                let readings = Readings { points, ranges, ids };
                parts.push(Part { pose, beams, gate, first, names: self.names(), readings });
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
/// [`Error::NoDirection`] for a beam without one, and [`Error::Memory`].
pub fn turned(
    poses: &[Transform],
    beams: &[Vector],
    workers: &Workers,
) -> Result<Vec<Vector>, Error> {
    workers.room(DIRECTION_BYTES.saturating_mul(poses.len() * beams.len()))?;
    let beams = units(beams)?;
    let turn = |pose, beam| {
        let direction = rotated(pose, beam);
        unit(direction).unwrap_or(direction)
    };
    Ok(workers.install(|| {
        poses
            .par_iter()
            .flat_map_iter(|pose| beams.iter().map(move |&beam| turn(pose, beam)))
            .collect()
    }))
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
pub(super) fn rotated(pose: &Transform, [x, y, z]: Vector) -> Vector {
    std::array::from_fn(|k| {
        let row = &pose[4 * k..4 * k + 3];
        row[0] * x + row[1] * y + row[2] * z
    })
}

/// Some beams from one pose.
struct Part<'a> {
    pose: &'a Transform,
    beams: &'a [Vector],
    gate: RangeGate,
    first: u64,
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
    fn answer<const N: usize>(
        &mut self,
        rows: [u32; N],
        count: usize,
        directions: &[[f64; N]; 3],
        hits: &Nearest<N>,
    ) {
        let readings =
            self.gate.readings(&hits.ranges, rows.map(|row| self.first + u64::from(row)));
        let origin = self.origin(0);
        let mut ends = [[0.0; N]; 3];
        for k in 0..3 {
            for i in 0..N {
                // No reading is no point.
                let way = if readings[i] < f64::INFINITY { readings[i] } else { f64::NAN };
                ends[k][i] = directions[k][i] * way + origin[k];
            }
        }
        for i in 0..count {
            let row = rows[i] as usize;
            self.readings.points[row] = [ends[0][i], ends[1][i], ends[2][i]];
            self.readings.ranges[row] = readings[i];
            self.readings.ids[row] = hits.get(i).id(self.names);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noise(seed: u64) -> Vec<f64> {
        (0..200_000).map(|number| Noise { seed }.of(number)).collect()
    }

    fn mean(values: impl ExactSizeIterator<Item = f64>) -> f64 {
        let n = values.len() as f64;
        values.sum::<f64>() / n
    }

    #[test]
    fn noise_is_standard_normal() {
        for seed in [0, 1, u64::MAX] {
            let noise = noise(seed);
            let error = 5.0 / (noise.len() as f64).sqrt();
            for (power, moment) in [(1, 0.0), (2, 1.0), (3, 0.0), (4, 3.0)] {
                // The variance of a power is the moment of twice the power less a square.
                let spread = [1.0_f64, 2.0, 15.0, 96.0][power as usize - 1].sqrt();
                let off = mean(noise.iter().map(|x| x.powi(power))) - moment;
                assert!(off.abs() < error * spread, "power {power}: {off}");
            }
            let beyond = mean(noise.iter().map(|x| f64::from(x.abs() > 3.0)));
            assert!((beyond - 0.0027).abs() < error * 0.0027_f64.sqrt(), "{beyond}");
        }
    }

    #[test]
    fn neighbors_and_seeds_share_no_noise() {
        let (one, other) = (noise(7), noise(8));
        let error = 5.0 / (one.len() as f64).sqrt();
        for apart in [1, 2, 16, 100, 800, 1024] {
            let pairs = one.iter().zip(&one[apart..]).map(|(a, b)| a * b);
            assert!(mean(pairs).abs() < error * 1.01, "{apart} beams apart");
        }
        assert!(mean(one.iter().zip(&other).map(|(a, b)| a * b)).abs() < error);
    }
}
