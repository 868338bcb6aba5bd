//! How well points support each of many plane hypotheses.

use crate::{Error, Vector, Workers};
use rayon::prelude::*;

/// Points that stay in the first-level cache while several hypotheses pass over them.
const BLOCK: usize = 1024;
/// Hypotheses between two questions to the caller.
const CHUNK: usize = 256;
/// Hypotheses that one task scores.
const TASK: usize = 16;
/// What a perfect inlier adds to an MSAC score. Scores are sums of whole numbers, so that their
/// order does not matter; a block of them fits 32 bits.
const WHOLE: u16 = 1 << 15;
/// Threshold over extent from which float32 tells inliers well enough to rank hypotheses.
const SINGLE_PRECISION: f64 = 1e-5;

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
/// are passed over. Normals must have unit length. A generous threshold is tested in float32,
/// about the middle of the points. No product is fused with a sum, so that every instruction set
/// scores alike.
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
    let (center, extent) = bounds(points);
    let reach = directions.map_or(threshold, |directions| threshold * bounds(directions).1);
    let unit = match score {
        Score::Count => 1.0,
        Score::Msac => f64::from(WHOLE),
    };
    let scores = if reach >= SINGLE_PRECISION * extent {
        single::score(points, directions, equations, threshold, score, center, workers)?
    } else {
        double::score(points, directions, equations, threshold, score, center, workers)?
    };
    Ok(scores.into_iter().map(|sum| sum as f64 / unit).collect())
}

/// Middle and largest half extent of vectors.
fn bounds(vectors: &[Vector]) -> (Vector, f64) {
    let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for vector in vectors {
        for k in 0..3 {
            low[k] = low[k].min(vector[k]);
            high[k] = high[k].max(vector[k]);
        }
    }
    if vectors.is_empty() {
        return ([0.0; 3], 0.0);
    }
    let half = (0..3).map(|k| (high[k] - low[k]) / 2.0).fold(0.0, f64::max);
    (std::array::from_fn(|k| f64::midpoint(low[k], high[k])), half)
}

/// Compiles a kernel once for each instruction set, and chooses when it is called.
macro_rules! for_each_instruction_set {
    ($name:ident, $body:ident, $rows:literal, $float:ident, $bits:ident) => {
        fn $name(block: &Block<$rows>, plane: &Plane, threshold: $float) -> $bits {
            #[cfg(target_arch = "x86_64")]
            {
                #[target_feature(enable = "avx512f,avx512vl,avx512dq")]
                fn avx512(block: &Block<$rows>, plane: &Plane, threshold: $float) -> $bits {
                    $body(block, plane, threshold)
                }
                #[target_feature(enable = "avx2")]
                fn avx2(block: &Block<$rows>, plane: &Plane, threshold: $float) -> $bits {
                    $body(block, plane, threshold)
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

/// The scorer for one float type.
macro_rules! scorer {
    ($module:ident, $float:ident, $bits:ident, $round:literal) => {
        mod $module {
            use super::{
                BLOCK, CHUNK, Error, ParallelIterator, Score, TASK, Vector, WHOLE, Workers,
            };
            use rayon::prelude::{IndexedParallelIterator, ParallelSlice, ParallelSliceMut};

            /// Adding it to a small number leaves the rounded number in the lowest bits.
            const ROUND: $float = $round;

            type Plane = [$float; 4];
            /// Points by coordinate, then their directions if any.
            type Block<const ROWS: usize> = [[$float; BLOCK]; ROWS];

            pub fn score(
                points: &[Vector],
                directions: Option<&[Vector]>,
                equations: &[[f64; 4]],
                threshold: f64,
                score: Score,
                center: Vector,
                workers: &Workers,
            ) -> Result<Vec<u64>, Error> {
                let planes: Vec<Plane> = equations
                    .iter()
                    .map(|&[a, b, c, d]| {
                        let offset = a * center[0] + b * center[1] + c * center[2] + d;
                        [a, b, c, offset].map(|value| value as $float)
                    })
                    .collect();
                let t = threshold as $float;
                let Some(directions) = directions else {
                    let blocks = blocks::<3>(points, &[], center);
                    return match score {
                        Score::Count => over(&blocks, &planes, t, workers, near_count),
                        Score::Msac => over(&blocks, &planes, t, workers, near_msac),
                    };
                };
                let blocks = blocks::<6>(points, directions, center);
                match score {
                    Score::Count => over(&blocks, &planes, t, workers, front_count),
                    Score::Msac => over(&blocks, &planes, t, workers, front_msac),
                }
            }

            /// The last block is filled up with NaN, which no threshold admits.
            fn blocks<const ROWS: usize>(
                points: &[Vector],
                directions: &[Vector],
                center: Vector,
            ) -> Vec<Block<ROWS>> {
                let mut blocks = vec![[[$float::NAN; BLOCK]; ROWS]; points.len().div_ceil(BLOCK)];
                for (i, point) in points.iter().enumerate() {
                    for k in 0..3 {
                        blocks[i / BLOCK][k][i % BLOCK] = (point[k] - center[k]) as $float;
                    }
                }
                for (i, direction) in directions.iter().enumerate() {
                    for k in 0..3 {
                        blocks[i / BLOCK][3 + k][i % BLOCK] = direction[k] as $float;
                    }
                }
                blocks
            }

            fn over<const ROWS: usize>(
                blocks: &[Block<ROWS>],
                planes: &[Plane],
                threshold: $float,
                workers: &Workers,
                kernel: impl Fn(&Block<ROWS>, &Plane, $float) -> $bits + Sync,
            ) -> Result<Vec<u64>, Error> {
                let mut scores = vec![0; planes.len()];
                for (scores, planes) in scores.chunks_mut(CHUNK).zip(planes.chunks(CHUNK)) {
                    workers.check()?;
                    workers.install(|| {
                        scores.par_chunks_mut(TASK).zip(planes.par_chunks(TASK)).for_each(
                            |(scores, planes)| {
                                for block in blocks {
                                    for (score, plane) in scores.iter_mut().zip(planes) {
                                        *score += u64::from(kernel(block, plane, threshold));
                                    }
                                }
                            },
                        );
                    });
                }
                Ok(scores)
            }

            for_each_instruction_set!(near_count, near_count_body, 3, $float, $bits);
            for_each_instruction_set!(near_msac, near_msac_body, 3, $float, $bits);
            for_each_instruction_set!(front_count, front_count_body, 6, $float, $bits);
            for_each_instruction_set!(front_msac, front_msac_body, 6, $float, $bits);

            // Plain functions would not be compiled for the instruction set of their caller.
            #[allow(clippy::inline_always)]
            #[inline(always)]
            fn near_count_body(block: &Block<3>, [a, b, c, d]: &Plane, threshold: $float) -> $bits {
                let [x, y, z] = block;
                (0..BLOCK)
                    .map(|i| {
                        let distance = a * x[i] + b * y[i] + c * z[i] + d;
                        $bits::from(distance.abs() <= threshold)
                    })
                    .sum()
            }

            #[allow(clippy::inline_always)]
            #[inline(always)]
            fn near_msac_body(block: &Block<3>, [a, b, c, d]: &Plane, threshold: $float) -> $bits {
                let [x, y, z] = block;
                (0..BLOCK).map(|i| msac(a * x[i] + b * y[i] + c * z[i] + d, threshold)).sum()
            }

            #[allow(clippy::inline_always)]
            #[inline(always)]
            fn front_count_body(
                block: &Block<6>,
                [a, b, c, d]: &Plane,
                threshold: $float,
            ) -> $bits {
                let [x, y, z, ux, uy, uz] = block;
                (0..BLOCK)
                    .map(|i| {
                        let distance = a * x[i] + b * y[i] + c * z[i] + d;
                        let approach = -(a * ux[i] + b * uy[i] + c * uz[i]);
                        // From behind the approach is negative, and no distance is below that.
                        $bits::from(distance.abs() <= threshold * approach)
                    })
                    .sum()
            }

            #[allow(clippy::inline_always)]
            #[inline(always)]
            fn front_msac_body(block: &Block<6>, [a, b, c, d]: &Plane, threshold: $float) -> $bits {
                let [x, y, z, ux, uy, uz] = block;
                (0..BLOCK)
                    .map(|i| {
                        let distance = a * x[i] + b * y[i] + c * z[i] + d;
                        let approach = -(a * ux[i] + b * uy[i] + c * uz[i]);
                        msac(distance, threshold * approach)
                    })
                    .sum()
            }

            #[allow(clippy::inline_always)]
            #[inline(always)]
            fn msac(distance: $float, limit: $float) -> $bits {
                let ratio = distance / limit;
                let gain = (1.0 - ratio * ratio) * $float::from(WHOLE) + ROUND;
                let whole = gain.to_bits().wrapping_sub(ROUND.to_bits());
                if distance.abs() <= limit { whole } else { 0 }
            }
        }
    };
}

scorer!(single, f32, u32, 12_582_912.0);
scorer!(double, f64, u64, 6_755_399_441_055_744.0);
