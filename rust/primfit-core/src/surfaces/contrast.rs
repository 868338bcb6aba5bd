//! Whether points lie on a surface, or it lies among scattered points.

use super::cloud::Cloud;
use super::surface::Surface;
use crate::neighbors::{PointTree, Search};
use crate::{Error, Workers};

/// Points of a surface around which all points are counted.
const LOOKED_AT: usize = 96;
/// Half the thickness of a layer that is evenly filled, in terms of its root mean square.
const HALF: f64 = 1.732;
/// Radius of the ball around each, in half thicknesses, and the volumes within it of the layer and of
/// what is within twice its thickness beside it.
const BALL: f64 = 2.4;
const VOLUMES: (f64, f64) = (10.85, 6.85);
/// Density of the layer over that beside it from which it is a surface: 1 among scattered points, 2 at
/// their border, 7 for normal noise.
const CLEAR: f64 = 3.0;

/// Which surfaces are denser than what is beside them.
///
/// # Errors
/// [`Error::Stopped`] when the caller does not want to go on.
pub fn are_clear(
    tree: &PointTree,
    cloud: &Cloud,
    members: &[Vec<u32>],
    surfaces: &[Surface],
    workers: &Workers,
) -> Result<Vec<bool>, Error> {
    let mut clear = vec![false; surfaces.len()];
    workers.fill(&mut clear, 1, Search::default, |search, i, clear| {
        let (surface, own) = (&surfaces[i], &members[i]);
        if own.is_empty() {
            return;
        }
        let off = |place: u32| surface.distance(&cloud.points[place as usize]).abs();
        let mean_square =
            own.iter().map(|&place| off(place).powi(2)).sum::<f64>() / own.len() as f64;
        let half = HALF * mean_square.sqrt();
        let (mut within, mut beside) = (0.0, 0.0);
        for &place in own.iter().step_by(own.len().div_ceil(LOOKED_AT)) {
            for other in tree.within(&cloud.points[place as usize], BALL * half, search) {
                let off = off(other.place);
                if off <= half {
                    within += 1.0;
                } else if off <= 2.0 * half {
                    beside += 1.0;
                }
            }
        }
        clear[0] = within / VOLUMES.0 > CLEAR * beside / VOLUMES.1;
    })?;
    Ok(clear)
}
