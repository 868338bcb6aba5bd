//! Points against planes, in float32 and float64.
//!
//! The loops are plain: the compiler makes vectors of them, once for each instruction set.

use super::{Job, Score};
use crate::instructions::{Instructions, for_each_set};
use crate::workers::Stop;
use crate::{Error, Vector};
use rayon::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering};

/// Points that stay in the first-level cache while several planes pass over them; not a power of
/// two, or all rows would compete for the same places there.
const BLOCK: usize = 1040;
/// Blocks that stay in the second-level cache while all planes pass over them.
const BLOCKS: usize = 16;
/// Planes that one task scores.
const PLANES: usize = 16;
/// What a perfect inlier adds to an MSAC score; a block of them fits 32 bits.
const WHOLE: u16 = 1 << 15;

/// The scorer for one float type.
macro_rules! scorer {
    ($module:ident, $float:ident, $bits:ident, $signed:ident, $round:literal) => {
        pub mod $module {
            use super::*;

            /// Adding it to a small number leaves the rounded number in the lowest bits.
            const ROUND: $float = $round;
            /// What an outlier loses: the whole.
            const LOST: $float = ROUND + WHOLE as $float;

            /// Points by coordinate, then their directions if any.
            #[derive(Clone)]
            #[repr(align(64))]
            struct Block<const ROWS: usize>([[$float; BLOCK]; ROWS]);

            /// A plane as the kernels want it.
            struct Plane {
                /// `[a, b, c, d]`, for MSAC scaled so that an inlier's square is below [`WHOLE`].
                equation: [$float; 4],
                /// The normal towards the beams, in thresholds.
                approach: [$float; 3],
                threshold: $float,
            }

            pub fn run(
                job: &Job,
                center: Vector,
                instructions: Instructions,
                stop: &Stop,
            ) -> Result<Vec<f64>, Error> {
                let t = job.threshold;
                let score = if t > 0.0 { job.score } else { Score::Count };
                let whole = f64::from(WHOLE);
                let scale = match (score, job.directions) {
                    (Score::Count, _) => 1.0,
                    (Score::Msac, None) => whole.sqrt() / t,
                    (Score::Msac, Some(_)) => whole.sqrt(),
                };
                let planes: Vec<Plane> = job
                    .equations
                    .iter()
                    .map(|&[a, b, c, d]| {
                        let offset = a * center[0] + b * center[1] + c * center[2] + d;
                        Plane {
                            equation: [a, b, c, offset].map(|value| (scale * value) as $float),
                            approach: [a, b, c].map(|value| (-t * value) as $float),
                            threshold: t as $float,
                        }
                    })
                    .collect();
                let unit = if score == Score::Msac { whole } else { 1.0 };
                match (job.directions, score) {
                    (None, Score::Count) => {
                        over(job, center, &planes, unit, instructions, near_count, stop)
                    }
                    (None, Score::Msac) => {
                        over(job, center, &planes, unit, instructions, near_msac, stop)
                    }
                    (Some(_), Score::Count) => {
                        over(job, center, &planes, unit, instructions, sides_count, stop)
                    }
                    (Some(_), Score::Msac) => {
                        over(job, center, &planes, unit, instructions, sides_msac, stop)
                    }
                }
            }

            /// The sums of a kernel in units, side by side.
            fn over<const ROWS: usize, const SIDES: usize>(
                job: &Job,
                center: Vector,
                planes: &[Plane],
                unit: f64,
                instructions: Instructions,
                kernel: impl Fn(Instructions, &Block<ROWS>, &Plane) -> [$bits; SIDES] + Sync,
                stop: &Stop,
            ) -> Result<Vec<f64>, Error> {
                let sums: Vec<[AtomicU64; SIDES]> =
                    planes.iter().map(|_| [const { AtomicU64::new(0) }; SIDES]).collect();
                let n_tasks = job.points.len().div_ceil(BLOCK * BLOCKS);
                (0..n_tasks).into_par_iter().try_for_each_init(Vec::new, |blocks, task| {
                    fill(blocks, job, task * BLOCK * BLOCKS, center);
                    sums.par_chunks(PLANES).zip(planes.par_chunks(PLANES)).try_for_each(
                        |(sums, planes)| {
                            stop.check()?;
                            let mut scores = [[0; SIDES]; PLANES];
                            for block in blocks.iter() {
                                for (scores, plane) in scores.iter_mut().zip(planes) {
                                    let some = kernel(instructions, block, plane);
                                    for (score, some) in scores.iter_mut().zip(some) {
                                        *score += u64::from(some);
                                    }
                                }
                            }
                            for (sum, score) in
                                sums.as_flattened().iter().zip(scores.as_flattened())
                            {
                                sum.fetch_add(*score, Ordering::Relaxed);
                            }
                            Ok(())
                        },
                    )
                })?;
                let of_side = |side| sums.iter().map(move |sums: &[AtomicU64; SIDES]| &sums[side]);
                Ok((0..SIDES)
                    .flat_map(of_side)
                    .map(|sum| sum.load(Ordering::Relaxed) as f64 / unit)
                    .collect())
            }

            /// Some points from `first` on. The last block is filled up with NaN, which no
            /// threshold admits.
            fn fill<const ROWS: usize>(
                blocks: &mut Vec<Block<ROWS>>,
                job: &Job,
                first: usize,
                center: Vector,
            ) {
                let last = job.points.len().min(first + BLOCK * BLOCKS);
                blocks.resize((last - first).div_ceil(BLOCK), Block([[$float::NAN; BLOCK]; ROWS]));
                for (block, first) in blocks.iter_mut().zip((first..last).step_by(BLOCK)) {
                    let rows = first..last.min(first + BLOCK);
                    for (i, point) in job.points[rows.clone()].iter().enumerate() {
                        for k in 0..3 {
                            block.0[k][i] = (point[k] - center[k]) as $float;
                        }
                    }
                    for (i, direction) in
                        job.directions.iter().flat_map(|all| &all[rows.clone()]).enumerate()
                    {
                        for k in 0..3 {
                            block.0[3 + k][i] = direction[k] as $float;
                        }
                    }
                    for row in &mut block.0 {
                        row[rows.len()..].fill($float::NAN);
                    }
                }
            }

            for_each_set! {
                fn near_count(block: &Block<3>, plane: &Plane) -> [$bits; 1] {
                    let Block([x, y, z]) = block;
                    [(0..BLOCK)
                        .map(|i| {
                            let distance = distance(plane, [x[i], y[i], z[i]]);
                            $bits::from(distance.abs() <= plane.threshold)
                        })
                        .sum()]
                }
            }

            for_each_set! {
                fn near_msac(block: &Block<3>, plane: &Plane) -> [$bits; 1] {
                    let Block([x, y, z]) = block;
                    let lost = (0..BLOCK)
                        .map(|i| lost(distance(plane, [x[i], y[i], z[i]])))
                        .fold(0, $bits::wrapping_add);
                    [LOST.to_bits().wrapping_mul(BLOCK as $bits).wrapping_sub(lost)]
                }
            }

            for_each_set! {
                fn sides_count(block: &Block<6>, plane: &Plane) -> [$bits; 2] {
                    let Block([x, y, z, ux, uy, uz]) = block;
                    let [mut front, mut back] = [0; 2];
                    for i in 0..BLOCK {
                        let distance = distance(plane, [x[i], y[i], z[i]]).abs();
                        // From behind the limit is negative, and no distance is below that.
                        let limit = limit(plane, [ux[i], uy[i], uz[i]]);
                        front += $bits::from(distance <= limit);
                        back += $bits::from(distance <= -limit);
                    }
                    [front, back]
                }
            }

            for_each_set! {
                fn sides_msac(block: &Block<6>, plane: &Plane) -> [$bits; 2] {
                    let Block([x, y, z, ux, uy, uz]) = block;
                    let [mut both, mut back] = [0; 2];
                    for i in 0..BLOCK {
                        let limit = limit(plane, [ux[i], uy[i], uz[i]]);
                        let gain = LOST.to_bits()
                            - lost(distance(plane, [x[i], y[i], z[i]]) / limit);
                        // All bits from behind, none else.
                        let behind = (limit.to_bits() as $signed >> ($signed::BITS - 1)) as $bits;
                        both += gain;
                        back += gain & behind;
                    }
                    [both - back, back]
                }
            }

            #[allow(clippy::inline_always)]
            #[inline(always)]
            fn distance(plane: &Plane, [x, y, z]: [$float; 3]) -> $float {
                let [a, b, c, d] = plane.equation;
                a.mul_add(x, b.mul_add(y, c.mul_add(z, d)))
            }

            /// The greatest distance of an inlier whose beam has a direction.
            #[allow(clippy::inline_always)]
            #[inline(always)]
            fn limit(plane: &Plane, [x, y, z]: [$float; 3]) -> $float {
                let [a, b, c] = plane.approach;
                a.mul_add(x, b.mul_add(y, c * z))
            }

            /// What a point of a scaled distance loses: its square, rounded, but at most the whole.
            /// NaN loses that. Above them are the bits of [`ROUND`].
            #[allow(clippy::inline_always)]
            #[inline(always)]
            fn lost(distance: $float) -> $bits {
                distance.mul_add(distance, ROUND).to_bits().min(LOST.to_bits())
            }
        }
    };
}

scorer!(single, f32, u32, i32, 12_582_912.0);
scorer!(double, f64, u64, i64, 6_755_399_441_055_744.0);
