//! How well points support each of many plane hypotheses.

use crate::{Error, Vector, Workers};
use rayon::prelude::*;

/// Points that stay in the first-level cache while every hypothesis passes over them.
const BLOCK: usize = 1024;
/// Hypotheses between two questions to the caller.
const CHUNK: usize = 256;
/// Hypotheses that one task scores.
const TASK: usize = 16;
/// Sums side by side, as many as the widest registers hold.
const LANES: usize = 8;
/// What a perfect inlier adds to an MSAC score. Scores are sums of whole numbers, which float64
/// holds exactly, so that their order does not matter.
const WHOLE: f64 = 65536.0;
/// Adding and subtracting it rounds a small number to a whole one.
const ROUND: f64 = 6_755_399_441_055_744.0;

/// What supports a plane.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Score {
    /// Each inlier counts one.
    Count,
    /// Each inlier counts one less the square of its distance over the threshold
    /// (Torr and Zisserman: MLESAC, CVIU 78, 2000), to a resolution of 2^-16.
    Msac,
}

/// Points by coordinate, in blocks; a block is `ROWS` runs of `BLOCK` numbers.
struct Blocks<const ROWS: usize>(Vec<[[f64; BLOCK]; ROWS]>);

impl<const ROWS: usize> Blocks<ROWS> {
    /// The last block is filled up with NaN, which no threshold admits.
    fn new<const SETS: usize>(sets: [&[Vector]; SETS]) -> Self {
        let n_points = sets[0].len();
        let mut blocks = vec![[[f64::NAN; BLOCK]; ROWS]; n_points.div_ceil(BLOCK)];
        for (set, vectors) in sets.into_iter().enumerate() {
            for (block, vectors) in blocks.iter_mut().zip(vectors.chunks(BLOCK)) {
                for (i, vector) in vectors.iter().enumerate() {
                    for k in 0..3 {
                        block[3 * set + k][i] = vector[k];
                    }
                }
            }
        }
        Self(blocks)
    }
}

/// The support of each plane `[a, b, c, d]` by the points within `threshold` of it.
///
/// The distance is perpendicular; with `directions`, the unit direction of each point's beam, it
/// is taken along the beam, and planes that the beam meets from behind are passed over. Normals
/// must have unit length. No product is fused with a sum, so every instruction set scores alike.
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
    match (directions, score) {
        (None, Score::Count) => {
            over(&Blocks::<3>::new([points]), equations, threshold, workers, near_count)
        }
        (None, Score::Msac) => {
            over(&Blocks::<3>::new([points]), equations, threshold, workers, near_msac)
        }
        (Some(directions), Score::Count) => over(
            &Blocks::<6>::new([points, directions]),
            equations,
            threshold,
            workers,
            front_count,
        ),
        (Some(directions), Score::Msac) => {
            over(&Blocks::<6>::new([points, directions]), equations, threshold, workers, front_msac)
        }
    }
}

fn over<const ROWS: usize>(
    blocks: &Blocks<ROWS>,
    equations: &[[f64; 4]],
    threshold: f64,
    workers: &Workers,
    kernel: impl Fn(&[[f64; BLOCK]; ROWS], &[f64; 4], f64) -> f64 + Sync,
) -> Result<Vec<f64>, Error> {
    let mut scores = vec![0.0; equations.len()];
    for (scores, equations) in scores.chunks_mut(CHUNK).zip(equations.chunks(CHUNK)) {
        workers.check()?;
        workers.install(|| {
            scores.par_chunks_mut(TASK).zip(equations.par_chunks(TASK)).for_each(
                |(scores, equations)| {
                    for block in &blocks.0 {
                        for (score, equation) in scores.iter_mut().zip(equations) {
                            *score += kernel(block, equation, threshold);
                        }
                    }
                },
            );
        });
    }
    Ok(scores)
}

/// Compiles a kernel once for each instruction set, and chooses when it is called.
macro_rules! for_each_instruction_set {
    ($name:ident, $body:ident, $rows:literal) => {
        fn $name(block: &[[f64; BLOCK]; $rows], plane: &[f64; 4], threshold: f64) -> f64 {
            #[cfg(target_arch = "x86_64")]
            {
                #[target_feature(enable = "avx512f,avx512vl,avx512dq")]
                fn avx512(block: &[[f64; BLOCK]; $rows], plane: &[f64; 4], t: f64) -> f64 {
                    $body(block, plane, t)
                }
                #[target_feature(enable = "avx2")]
                fn avx2(block: &[[f64; BLOCK]; $rows], plane: &[f64; 4], t: f64) -> f64 {
                    $body(block, plane, t)
                }
                if is_x86_feature_detected!("avx512f")
                    && is_x86_feature_detected!("avx512vl")
                    && is_x86_feature_detected!("avx512dq")
                {
                    // SAFETY: the processor has what the function is compiled for.
                    return unsafe { avx512(block, plane, threshold) };
                }
                if is_x86_feature_detected!("avx2") {
                    // SAFETY: the processor has what the function is compiled for.
                    return unsafe { avx2(block, plane, threshold) };
                }
            }
            $body(block, plane, threshold)
        }
    };
}

for_each_instruction_set!(near_count, near_count_body, 3);
for_each_instruction_set!(near_msac, near_msac_body, 3);
for_each_instruction_set!(front_count, front_count_body, 6);
for_each_instruction_set!(front_msac, front_msac_body, 6);

/// Sums what `term` gives for every point of a block, `LANES` sums side by side.
// A plain function would not be compiled for the instruction set of its caller.
#[allow(clippy::inline_always)]
#[inline(always)]
fn sum_block(term: impl Fn(usize) -> f64) -> f64 {
    let mut sums = [0.0; LANES];
    for first in (0..BLOCK).step_by(LANES) {
        for (lane, sum) in sums.iter_mut().enumerate() {
            *sum += term(first + lane);
        }
    }
    sums.iter().sum()
}

#[allow(clippy::inline_always)]
#[inline(always)]
fn near_count_body(block: &[[f64; BLOCK]; 3], [a, b, c, d]: &[f64; 4], threshold: f64) -> f64 {
    let [x, y, z] = block;
    sum_block(|i| {
        let distance = a * x[i] + b * y[i] + c * z[i] + d;
        if distance.abs() <= threshold { 1.0 } else { 0.0 }
    })
}

#[allow(clippy::inline_always)]
#[inline(always)]
fn near_msac_body(block: &[[f64; BLOCK]; 3], [a, b, c, d]: &[f64; 4], threshold: f64) -> f64 {
    let [x, y, z] = block;
    sum_block(|i| {
        let distance = a * x[i] + b * y[i] + c * z[i] + d;
        msac(distance, threshold)
    })
}

#[allow(clippy::inline_always)]
#[inline(always)]
fn front_count_body(block: &[[f64; BLOCK]; 6], [a, b, c, d]: &[f64; 4], threshold: f64) -> f64 {
    let [x, y, z, ux, uy, uz] = block;
    sum_block(|i| {
        let distance = a * x[i] + b * y[i] + c * z[i] + d;
        let approach = -(a * ux[i] + b * uy[i] + c * uz[i]);
        // A beam from behind has a negative approach, and no distance is below that.
        if distance.abs() <= threshold * approach { 1.0 } else { 0.0 }
    })
}

#[allow(clippy::inline_always)]
#[inline(always)]
fn front_msac_body(block: &[[f64; BLOCK]; 6], [a, b, c, d]: &[f64; 4], threshold: f64) -> f64 {
    let [x, y, z, ux, uy, uz] = block;
    sum_block(|i| {
        let distance = a * x[i] + b * y[i] + c * z[i] + d;
        let approach = -(a * ux[i] + b * uy[i] + c * uz[i]);
        msac(distance, threshold * approach)
    })
}

#[allow(clippy::inline_always)]
#[inline(always)]
fn msac(distance: f64, limit: f64) -> f64 {
    let ratio = distance / limit;
    let gain = (1.0 - ratio * ratio) * WHOLE;
    if distance.abs() <= limit { (gain + ROUND - ROUND) / WHOLE } else { 0.0 }
}
