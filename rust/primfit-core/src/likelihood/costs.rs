//! What prisms cost that are tried in the place of one solid.
//!
//! Each lane holds a prism, and one beam after the other meets them. Prisms that are alike have the
//! same walls beside a beam, and those that it passes cost next to nothing.

use super::beams::{BeamBlocks, Candidate};
use super::ellipse::Ellipse;
use super::meeting::{Beam, Real, Walls};
use crate::instructions::widest;
use crate::lanes::{Isa, Lanes};
use crate::{Error, Vector, Workers};
use rayon::prelude::*;

/// Prisms side by side.
const LANES: usize = 8;

/// Groups of prisms between two questions to the caller, and in one task.
const CHUNK: usize = 64;
const TASK: usize = 8;

/// Pairs of a prism and a beam that are done sooner than other threads would begin.
const FEW: usize = 1 << 19;

/// Beams that are summed up in single precision.
const RUN: usize = 16;

/// Negative log-likelihood of the ranges for each candidate, up to a constant.
///
/// A return that the model foresees costs half its squared residual in sigmas, at the most what an
/// outlier costs; a return without a surface in range costs as an outlier, a missing return its
/// own price. Beams meet walls from both sides and the top from above. The sums run in the order
/// of the beams.
///
/// # Errors
/// [`Error::Stopped`] when the caller does not want to go on.
pub fn prism_costs(
    beams: &BeamBlocks,
    candidates: &[Candidate],
    workers: &Workers,
) -> Result<Vec<f64>, Error> {
    costs(&beams.beams, beams.middle, candidates, workers)
}

/// Of candidates of one kind with equally many corners, by beams relative to their middle.
pub(super) fn costs(
    beams: &[Beam<Real>],
    middle: Vector,
    candidates: &[Candidate],
    workers: &Workers,
) -> Result<Vec<f64>, Error> {
    let groups: Vec<_> =
        candidates.chunks(LANES).map(|group| side_by_side(group, middle)).collect();
    let sums = |groups: &[_]| sums_of_costs(beams, groups);
    let mut costs = Vec::with_capacity(groups.len());
    if candidates.len() * beams.len() < FEW {
        costs = sums(&groups);
    } else {
        for groups in groups.chunks(CHUNK) {
            workers.check()?;
            workers.install(|| costs.par_extend(groups.par_chunks(TASK).flat_map(sums)));
        }
    }
    let mut costs = costs.into_flattened();
    costs.truncate(candidates.len());
    Ok(costs)
}

/// Some prisms in lanes, the last of them in those that are left.
fn side_by_side(group: &[Candidate], middle: Vector) -> Walls<[Real; LANES]> {
    let lanes = |value: &dyn Fn(&Candidate) -> f64| {
        std::array::from_fn(|i| value(&group[i.min(group.len() - 1)]) as Real)
    };
    let [x, y, z] = middle;
    let is_round = group[0].is_round;
    Walls {
        corners: (0..if is_round { 0 } else { group[0].footprint.len() })
            .map(|k| {
                [lanes(&|each| each.footprint[k][0] - x), lanes(&|each| each.footprint[k][1] - y)]
            })
            .collect(),
        ellipse: is_round.then(|| Ellipse::of(lanes, [x, y])),
        bottom: lanes(&|each| each.bottom - z),
        top: lanes(&|each| each.top - z),
        is_open: group[0].is_open,
    }
}

widest! {
fn sums_of_costs(
    beams: &[Beam<Real>],
    groups: &[Walls<[Real; LANES]>],
) -> Vec<[f64; LANES]> {
    type Lane = <Set as Isa>::Eight;
    let mut costs = vec![[0.0; LANES]; groups.len()];
    let mut sums = vec![Lane::splat(0.0); groups.len()];
    for run in beams.chunks(RUN) {
        sums.fill(Lane::splat(0.0));
        for beam in run {
            for (walls, sum) in groups.iter().zip(&mut sums) {
                let nearest = beam.meet(walls, Lane::splat(beam.background));
                *sum = *sum + beam.costs(nearest);
            }
        }
        for (costs, sums) in costs.iter_mut().zip(&sums) {
            for (cost, sum) in costs.iter_mut().zip(sums.store()) {
                *cost += f64::from(sum);
            }
        }
    }
    costs
}
}
