//! How well points support each of many plane hypotheses.

mod kernels;

use crate::bounds::bounds;
use crate::instructions::Instructions;
use crate::{Error, Vector, Workers};
use kernels::{double, single};

/// Threshold over half the extent from which float32 tells inliers well enough to rank hypotheses:
/// its rounding, a quarter of a millionth at most, is a sixteenth of that.
const SINGLE_PRECISION: f64 = 4e-6;
/// Threshold, in metres, below which the numbers of float32 end.
const NARROWEST: f64 = 1e-30;

/// Bytes that a plane takes: itself, the sums of both its sides, and its scores.
const SCORE_BYTES: usize = 128;

/// What supports a plane.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Score {
    /// Each inlier counts one.
    Count,
    /// Each inlier counts one less the square of its distance over the threshold
    /// (Torr and Zisserman: MLESAC, CVIU 78, 2000), to a resolution of 2^-15.
    Msac,
}

/// The support of each plane `[a, b, c, d]` by the points within `threshold` of it.
///
/// The distance is perpendicular; with `directions`, the direction of each point's beam, it is
/// taken along the beam in lengths of the direction, and planes that the beam meets from behind
/// are passed over; then the scores of all planes are followed by those of the same planes turned
/// round, which cost next to nothing. Normals must have unit length. A generous threshold is tested in float32,
/// about the middle of the points. Products are fused with sums on every instruction set, and
/// scores are sums of whole numbers, so that all sets and numbers of threads score alike. A
/// threshold of zero leaves inliers nothing to differ by: they count one.
///
/// # Errors
/// [`Error::Stopped`] when the caller does not want to go on.
pub fn score_planes(
    points: &[Vector],
    directions: Option<&[Vector]>,
    equations: &[[f64; 4]],
    threshold: f64,
    score: Score,
    workers: &Workers,
) -> Result<Vec<f64>, Error> {
    let job = Job { points, directions, equations, threshold, score };
    job.run(Instructions::best(), workers)
}

/// What is to be scored.
struct Job<'a> {
    points: &'a [Vector],
    directions: Option<&'a [Vector]>,
    equations: &'a [[f64; 4]],
    threshold: f64,
    score: Score,
}

impl Job<'_> {
    fn run(&self, instructions: Instructions, workers: &Workers) -> Result<Vec<f64>, Error> {
        workers.room(SCORE_BYTES.saturating_mul(self.equations.len()))?;
        let [low, high] = bounds(self.points);
        let center = std::array::from_fn(|k| f64::midpoint(low[k], high[k]));
        let stretch = self.directions.map_or(1.0, |directions| half_side(bounds(directions)));
        let reach = self.threshold * stretch;
        if reach >= SINGLE_PRECISION * half_side([low, high]) && reach >= NARROWEST {
            workers.watch(|stop| single::run(self, center, instructions, stop))
        } else {
            workers.watch(|stop| double::run(self, center, instructions, stop))
        }
    }
}

/// Half the longest side of a box.
fn half_side([low, high]: [Vector; 2]) -> f64 {
    (0..3).map(|k| (high[k] - low[k]) / 2.0).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::{Instructions, Job, Score};
    use crate::{Vector, Workers};
    use proptest::prelude::*;

    fn vector() -> impl Strategy<Value = Vector> {
        [-1.0..1.0, -1.0..1.0, -1.0..1.0]
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(40))]

        /// On a processor without AVX-512 the sets up to AVX2 are compared.
        #[test]
        fn instruction_sets_and_threads_score_alike(
            beams in prop::collection::vec((vector(), vector()), 0..3000),
            planes in prop::collection::vec((vector(), -1.0..1.0), 1..20),
            threshold in prop::sample::select(vec![0.5, 0.03, 2e-6, 0.0]),
            has_beams in any::<bool>(),
            msac in any::<bool>(),
        ) {
            let (points, directions): (Vec<Vector>, Vec<Vector>) = beams.into_iter().unzip();
            // Some points lie in planes, some at the threshold.
            let equations: Vec<[f64; 4]> = planes
                .iter()
                .enumerate()
                .map(|(i, &([a, b, c], offset))| {
                    let [x, y, z] = points.get(i).copied().unwrap_or([0.0; 3]);
                    let through = -(a * x + b * y + c * z);
                    [a, b, c, [offset, through, through + threshold][i % 3]]
                })
                .collect();
            let job = Job {
                points: &points,
                directions: has_beams.then_some(&directions),
                equations: &equations,
                threshold,
                score: if msac { Score::Msac } else { Score::Count },
            };
            let run = |instructions, n_threads| {
                job.run(instructions, &Workers::new(Some(n_threads), &|| true).unwrap()).unwrap()
            };
            let expected = run(Instructions::Scalar, 1);
            for instructions in Instructions::available() {
                prop_assert_eq!(&run(instructions, 1), &expected);
                prop_assert_eq!(&run(instructions, 3), &expected);
            }
        }
    }
}
