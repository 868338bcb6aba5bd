//! The beams of one sensor from many poses.

use super::caster::{Hits, RayCaster, Way, normalized, unit};
use super::tiles::Tiles;
use crate::{Error, Vector, Workers};
use rayon::prelude::*;

/// Rays between two questions to the caller, about.
const CHUNK: usize = 1 << 16;
/// Rays of a task, about.
const TASK: usize = 1 << 11;

/// A rigid transform by rows: rotation and place.
pub type Transform = [f64; 16];

impl RayCaster {
    /// What `beams` hit from each pose, pose by pose, and their directions in the world.
    ///
    /// Neighbouring beams are found once for all poses.
    ///
    /// # Errors
    /// [`Error::NoDirection`] for a beam without one, [`Error::Stopped`] when the caller does not
    /// want to go on.
    pub fn scan(
        &self,
        poses: &[Transform],
        beams: &[Vector],
        workers: &Workers,
    ) -> Result<(Vec<Vector>, Hits), Error> {
        let beams = beams
            .iter()
            .enumerate()
            .map(|(row, &beam)| unit(beam).ok_or(Error::NoDirection { row }))
            .collect::<Result<Vec<_>, _>>()?;
        let way = self.way(Tiles::of(&beams).filter(|tiles| tiles.is_within(self.largest_tile())));
        // Whole bands of tiles.
        let band = if let Way::Packets(tiles) = way { tiles.band() } else { 1 };
        let part = (band * TASK.div_ceil(band)).min(beams.len().max(1));
        let n = poses.len() * beams.len();
        let mut directions = vec![[0.0; 3]; n];
        let mut hits = Hits { ranges: vec![0.0; n], ids: vec![0; n] };
        let mut parts: Vec<_> = Vec::new();
        let (mut directions_left, mut ranges_left, mut ids_left) =
            (&mut directions[..], &mut hits.ranges[..], &mut hits.ids[..]);
        for pose in poses {
            for beams in beams.chunks(part) {
                let (these, later) = directions_left.split_at_mut(beams.len());
                directions_left = later;
                let (ranges, later) = ranges_left.split_at_mut(beams.len());
                ranges_left = later;
                let (ids, later) = ids_left.split_at_mut(beams.len());
                ids_left = later;
                parts.push((pose, beams, these, ranges, ids));
            }
        }
        for parts in parts.chunks_mut(CHUNK.div_ceil(part)) {
            workers.check()?;
            workers.install(|| {
                parts.par_iter_mut().for_each(|(pose, beams, directions, ranges, ids)| {
                    for (direction, &beam) in directions.iter_mut().zip(*beams) {
                        *direction = rotated(pose, beam);
                    }
                    let origins = vec![[pose[3], pose[7], pose[11]]; beams.len()];
                    self.cast_part(way, &origins, directions, ranges, ids);
                });
            });
        }
        Ok((directions, hits))
    }
}

/// A beam in the world, at unit length.
#[inline]
fn rotated(pose: &Transform, [x, y, z]: Vector) -> Vector {
    let turned = std::array::from_fn(|k| {
        let row = &pose[4 * k..4 * k + 3];
        row[0] * x + row[1] * y + row[2] * z
    });
    normalized(turned).unwrap_or(turned)
}
