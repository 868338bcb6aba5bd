//! How many points support each of many plane hypotheses.

use crate::{Error, Vector, Workers};
use rayon::prelude::*;

/// Points that stay in the first-level cache while every hypothesis passes over them.
const BLOCK: usize = 1024;
/// Hypotheses between two questions to the caller.
const CHUNK: usize = 256;
/// Hypotheses that one task scores.
const TASK: usize = 16;

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

/// The beams of the points, for scoring along the beam and on the seen side only.
#[derive(Clone, Copy)]
pub struct Front<'a> {
    /// Unit direction of the beam of each point.
    pub directions: &'a [Vector],
}

/// Counts the points within `threshold` of each plane `[a, b, c, d]`.
///
/// The distance is perpendicular; with `front` it is taken along the beam of each point, and
/// planes that the beam meets from behind are passed over. Normals must have unit length. No
/// product is fused with a sum, so every instruction set counts alike.
///
/// # Errors
/// [`Error::Stopped`] when the caller does not want to go on.
pub fn count_inliers(
    points: &[Vector],
    front: Option<Front>,
    equations: &[[f64; 4]],
    threshold: f64,
    workers: &Workers,
) -> Result<Vec<u64>, Error> {
    match front {
        None => {
            let blocks = Blocks::<3>::new([points]);
            count(&blocks, equations, workers, |block, planes, counts| {
                near(block, planes, threshold, counts);
            })
        }
        Some(front) => {
            let blocks = Blocks::<6>::new([points, front.directions]);
            count(&blocks, equations, workers, |block, planes, counts| {
                in_front(block, planes, threshold, counts);
            })
        }
    }
}

fn count<const ROWS: usize>(
    blocks: &Blocks<ROWS>,
    equations: &[[f64; 4]],
    workers: &Workers,
    kernel: impl Fn(&[[f64; BLOCK]; ROWS], &[[f64; 4]], &mut [u64]) + Sync,
) -> Result<Vec<u64>, Error> {
    let mut counts = vec![0; equations.len()];
    for (counts, equations) in counts.chunks_mut(CHUNK).zip(equations.chunks(CHUNK)) {
        workers.check()?;
        workers.install(|| {
            counts.par_chunks_mut(TASK).zip(equations.par_chunks(TASK)).for_each(
                |(counts, equations)| {
                    for block in &blocks.0 {
                        kernel(block, equations, counts);
                    }
                },
            );
        });
    }
    Ok(counts)
}

/// Compiles a kernel once for each instruction set, and chooses when it is called.
macro_rules! for_each_instruction_set {
    ($name:ident, $body:ident, $rows:literal) => {
        fn $name(block: &[[f64; BLOCK]; $rows], planes: &[[f64; 4]], t: f64, counts: &mut [u64]) {
            #[cfg(target_arch = "x86_64")]
            {
                #[target_feature(enable = "avx512f,avx512vl,avx512dq")]
                fn avx512(b: &[[f64; BLOCK]; $rows], p: &[[f64; 4]], t: f64, c: &mut [u64]) {
                    $body(b, p, t, c);
                }
                #[target_feature(enable = "avx2")]
                fn avx2(b: &[[f64; BLOCK]; $rows], p: &[[f64; 4]], t: f64, c: &mut [u64]) {
                    $body(b, p, t, c);
                }
                if is_x86_feature_detected!("avx512f")
                    && is_x86_feature_detected!("avx512vl")
                    && is_x86_feature_detected!("avx512dq")
                {
                    // SAFETY: the processor has what the function is compiled for.
                    return unsafe { avx512(block, planes, t, counts) };
                }
                if is_x86_feature_detected!("avx2") {
                    // SAFETY: the processor has what the function is compiled for.
                    return unsafe { avx2(block, planes, t, counts) };
                }
            }
            $body(block, planes, t, counts);
        }
    };
}

for_each_instruction_set!(near, near_body, 3);
for_each_instruction_set!(in_front, in_front_body, 6);

// A plain function would not be compiled for the instruction set of its caller.
#[allow(clippy::inline_always)]
#[inline(always)]
fn near_body(block: &[[f64; BLOCK]; 3], planes: &[[f64; 4]], threshold: f64, counts: &mut [u64]) {
    let [x, y, z] = block;
    for (count, [a, b, c, d]) in counts.iter_mut().zip(planes) {
        let mut inliers = 0_u64;
        for i in 0..BLOCK {
            let distance = a * x[i] + b * y[i] + c * z[i] + d;
            inliers += u64::from(distance.abs() <= threshold);
        }
        *count += inliers;
    }
}

// A plain function would not be compiled for the instruction set of its caller.
#[allow(clippy::inline_always)]
#[inline(always)]
fn in_front_body(
    block: &[[f64; BLOCK]; 6],
    planes: &[[f64; 4]],
    threshold: f64,
    counts: &mut [u64],
) {
    let [x, y, z, ux, uy, uz] = block;
    for (count, [a, b, c, d]) in counts.iter_mut().zip(planes) {
        let mut inliers = 0_u64;
        for i in 0..BLOCK {
            let distance = a * x[i] + b * y[i] + c * z[i] + d;
            let approach = -(a * ux[i] + b * uy[i] + c * uz[i]);
            // A beam from behind has a negative approach, and no distance is below that.
            inliers += u64::from(distance.abs() <= threshold * approach);
        }
        *count += inliers;
    }
}
