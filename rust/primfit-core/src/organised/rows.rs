//! Rows beside each other: spinning sensors whose beams point to different sides give images in which
//! a surface zigzags, unless their driver has put the rows in line; and their rows are rings.

use super::cells::{Image, distance};
use crate::Vector;

/// Largest shift from one row to the next, as a share of the width.
const MOST_SHIFT: usize = 32;
/// Pairs of rows that tell whether any are shifted, and pixels of a row that tell by how much.
const PAIRS: usize = 16;
const SAMPLES: usize = 80;
/// Columns within which the next point is sought.
const NEAR: usize = 4;
/// Least pixels with a point and a neighbour that tell a shift.
const FEWEST: usize = 12;
/// Distance of neighbours after a shift, as a share of that before, from which it is one.
const CLOSER: f64 = 0.6;
/// Share of the rows that are not in line, from which the image is not.
const SHIFTED: f64 = 0.25;
/// Rows after which the pattern of a sensor's beams is repeated: 4 in those that have one.
const PERIOD: usize = 4;
/// Columns by which shifts may differ from the pattern, at the median.
const CLOSE: i64 = 2;
/// How much farther than neighbours elsewhere the ends of a ring may be from each other.
const CLOSED: f64 = 3.0;

/// No pixel.
pub const NOWHERE: u32 = u32::MAX;

/// Where the pixels of an image with its rows in line come from.
pub struct InLine {
    /// Points, row by row.
    pub points: Vec<Vector>,
    /// Place of each in the image as it was; [`NOWHERE`] for none.
    pub source: Vec<u32>,
    /// Pixels of a row.
    pub width: usize,
}

/// The image with its rows in line; None when they are.
pub fn in_line(image: &Image) -> Option<InLine> {
    let is_ring = image.is_ring;
    let most = image.width / MOST_SHIFT;
    if image.height < 2 || most == 0 {
        return None;
    }
    let step = (image.height - 1).div_ceil(PAIRS);
    let some: Vec<i64> = (0..image.height - 1)
        .step_by(step)
        .flat_map(|row| [row, row + 1])
        .filter(|&row| row + 1 < image.height)
        .map(|row| shift(image, row, most, is_ring))
        .collect();
    let n_shifted = some.iter().filter(|&&shift| shift != 0).count();
    if (n_shifted as f64) < SHIFTED * some.len() as f64 {
        return None;
    }
    let shifts: Vec<i64> =
        (0..image.height - 1).map(|row| shift(image, row, most, is_ring)).collect();
    let shifts = repeated(&shifts);
    let mut offsets = vec![0_i64];
    offsets.extend(shifts.iter().scan(0, |sum, shift| {
        *sum += shift;
        Some(*sum)
    }));
    Some(moved(image, &offsets, is_ring))
}

/// The shifts as the pattern that they repeat, where they do: the beams of a sensor point to different
/// sides by turns, and come back. Single rows err where surfaces lean.
fn repeated(shifts: &[i64]) -> Vec<i64> {
    if shifts.len() < 3 * PERIOD {
        return shifts.to_vec();
    }
    let mut pattern: Vec<i64> = (0..PERIOD)
        .map(|phase| {
            let mut of_phase: Vec<i64> =
                shifts.iter().copied().skip(phase).step_by(PERIOD).collect();
            let middle = of_phase.len() / 2;
            *of_phase.select_nth_unstable(middle).1
        })
        .collect();
    let drift: i64 = pattern.iter().sum();
    let mut off: Vec<i64> =
        shifts.iter().zip(pattern.iter().cycle()).map(|(a, b)| (a - b).abs()).collect();
    let middle = off.len() / 2;
    if *off.select_nth_unstable(middle).1 > CLOSE || drift.abs() > PERIOD as i64 * CLOSE {
        return shifts.to_vec();
    }
    for k in 0..drift.unsigned_abs() as usize {
        pattern[k % PERIOD] -= drift.signum();
    }
    pattern.iter().copied().cycle().take(shifts.len()).collect()
}

/// Columns by which the next row is shifted: where its points are nearest to those of this one.
fn shift(image: &Image, row: usize, most: usize, is_ring: bool) -> i64 {
    let w = image.width as i64;
    let step = image.width.div_ceil(SAMPLES);
    let [own, next] = [row, row + 1].map(|row| &image.points[row * image.width..][..image.width]);
    let some: Vec<(i64, Vector)> = (0..image.width)
        .step_by(step)
        .filter(|&x| !own[x][0].is_nan())
        .map(|x| (x as i64, own[x]))
        .collect();
    // The distance of a sample to the next row; NaN where that has no point.
    let away = |&(x, point): &(i64, Vector), shift: i64| {
        for to in [x + shift, x + shift + 1] {
            let to = match to {
                _ if to < 0 && is_ring => to + w,
                _ if to >= w && is_ring => to - w,
                _ => to,
            };
            // Where every other pixel has a point, one of two does.
            if let Some(other) = usize::try_from(to).ok().and_then(|to| next.get(to))
                && !other[0].is_nan()
            {
                return distance(&point, other);
            }
        }
        f64::NAN
    };
    let mut distances = Vec::with_capacity(some.len());
    let mut apart = |shift: i64| {
        distances.clear();
        distances.extend(some.iter().map(|sample| away(sample, shift)).filter(|d| !d.is_nan()));
        if distances.len() < FEWEST {
            return f64::INFINITY;
        }
        let middle = distances.len() / 2;
        *distances.select_nth_unstable_by(middle, f64::total_cmp).1
    };
    let mut best = (CLOSER * apart(0), 0, 0);
    let most = most as i64;
    for shift in -most..=most {
        // Most shifts are none: half of their samples are too far.
        let mut n_far = 0;
        let is_far = some.iter().any(|sample| {
            n_far += usize::from(away(sample, shift) > best.0);
            2 * n_far > some.len()
        });
        if is_far {
            continue;
        }
        let median = apart(shift);
        if (median, shift.abs()) < (best.0, best.1) {
            best = (median, shift.abs(), shift);
        }
    }
    best.2
}

fn moved(image: &Image, offsets: &[i64], is_ring: bool) -> InLine {
    let (least, most) = offsets.iter().fold((0, 0), |(a, b), &x| (x.min(a), x.max(b)));
    let width = if is_ring { image.width } else { image.width + (most - least) as usize };
    let mut source = vec![NOWHERE; width * image.height];
    for (row, &offset) in offsets.iter().enumerate() {
        for x in 0..image.width {
            let to = x as i64 - offset;
            let to = if is_ring { to.rem_euclid(width as i64) } else { to + most };
            source[row * width + to as usize] = (row * image.width + x) as u32;
        }
    }
    let nothing = [f64::NAN; 3];
    let of = |&i: &u32| image.points.get(i as usize).copied().unwrap_or(nothing);
    InLine { points: source.iter().map(of).collect(), source, width }
}

/// Whether the last column lies beside the first as other columns do beside the next.
pub fn is_ring(image: &Image) -> bool {
    let w = image.width;
    if w < 2 {
        return false;
    }
    let median = |mut values: Vec<f64>| {
        let middle = values.len() / 2;
        (values.len() >= FEWEST.min(image.height.div_ceil(4)).max(2))
            .then(|| *values.select_nth_unstable_by(middle, f64::total_cmp).1)
    };
    // Distance of the last point before a column and the first from it on, for each column between.
    let between = |x: usize| {
        let per_column = (0..image.height).filter_map(|row| {
            let at = |x: usize| row * w + x % w;
            let before = (1..=NEAR).find(|&k| image.is_point(at(w + x - k)))?;
            let after = (0..NEAR).find(|&k| image.is_point(at(x + k)))?;
            let (a, b) = (&image.points[at(w + x - before)], &image.points[at(x + after)]);
            Some(distance(a, b) / (before + after) as f64)
        });
        median(per_column.collect())
    };
    let usual: Vec<f64> =
        (NEAR..w.saturating_sub(NEAR)).step_by(w.div_ceil(PAIRS)).filter_map(between).collect();
    match (between(0), median(usual)) {
        (Some(ends), Some(usual)) => ends <= CLOSED * usual,
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A tilted wall seen by 64 x 96 beams, with every row shifted by its share of a pattern.
    fn wall(pattern: [i64; 4]) -> Vec<Vector> {
        let at = |i: i64| {
            let (row, column) = (i / 96, i % 96);
            let turn = (column + pattern[(row % 4) as usize]) as f64 / 60.0;
            [3.0, 3.0 * turn, 0.02 * row as f64]
        };
        (0..64 * 96).map(at).collect()
    }

    fn image(points: &[Vector]) -> Image<'_> {
        Image { points, width: 96, height: points.len() / 96, is_ring: false }
    }

    #[test]
    fn rows_in_line_stay() {
        assert!(in_line(&image(&wall([0; 4]))).is_none());
    }

    #[test]
    fn rows_that_zigzag_come_in_line() {
        let points = wall([1, 0, -1, 0]);
        let moved = in_line(&image(&points)).map(|moved| (moved.points, moved.width));
        let (points, width) = moved.unwrap_or_default();
        assert_eq!(width, 96 + 2);
        let steps = (0..points.len() - width).map(|i| (points[i + width][1] - points[i][1]).abs());
        assert!(steps.filter(|step| !step.is_nan()).all(|step| step < 1e-9));
    }

    #[test]
    fn single_rows_do_not_break_the_pattern() {
        let mut shifts: Vec<i64> = [-6, -6, -6, 18].into_iter().cycle().take(63).collect();
        let pattern = shifts.clone();
        (shifts[5], shifts[20], shifts[40]) = (0, 31, -2);
        assert_eq!(repeated(&shifts), pattern);
        let none: Vec<i64> = (0..63).map(|i| (i * i) % 17 - 8).collect();
        assert_eq!(repeated(&none), none);
    }
}
