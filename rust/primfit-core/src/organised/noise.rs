//! The noise of an organised cloud, from itself: second differences along rows and columns.
//!
//! Of three pixels in line on a plane, whatever its tilt, the second difference across it is
//! noise alone. Medians tell it in each cell; cells alike in the spacing of their pixels, which
//! grows with the range, tell what is usual there, for the noise of a depth camera grows with the
//! range, too. Steps of quantised depth show as many differences of exactly nothing, and the others
//! of a step and more.

use super::cells::{Flat, Image, Pyramid};
use crate::{Vector, spread};

/// Pixels within which the next point on either side is sought, where some have none.
const FAR: usize = 3;
/// Variance of a second difference of pixels in a row, in units of which it is half.
const SECOND: f64 = 1.5;
/// Median of absolute normal values, in standard deviations.
const MEDIAN: f64 = 0.674_49;
/// Share of a point's distance from the origin below which differences are rounding, even of
/// coordinates that have been float32 (6e-8 each, four of them, three axes).
const ROUNDING: f64 = 5e-7;
/// Least second differences of a cell that tell its noise: their median errs by a sixth.
const FEWEST: usize = 24;
/// Least share of differences that are nothing where values come in steps: of noise that is not
/// rounded, none are.
const SAME: f64 = 0.2;
/// Groups of cells alike in spacing, and least cells of a group.
const GROUPS: usize = 12;
const GROUP: usize = 60;
/// Quantile of the cells of a group that tells the usual noise: edges and clutter raise that of
/// others.
const USUAL: f64 = 0.35;
/// Quantiles of the cells, one after the other, that tell how errors grow with the distance: those on
/// edges and clutter have larger ones.
const SMOOTHEST: [f64; 2] = [0.2, 0.1];
/// Growth of errors with a doubling of the distance above which it is the surface that bends.
const STEEP: f64 = 2.2;
/// How far a cell's noise may be from the usual: incidence lowers it, dark and wet surfaces raise it.
const LEAST: f64 = 0.6;
const MOST: f64 = 1.8;
/// Second smallest over smallest variance from which a block's plane is that of the surface.
const CLEAR: f64 = 6.0;
/// Least cosine of the incidence.
const GRAZING: f64 = 0.05;

/// The noise of each of the smallest cells across its surface, metres; and what it is made of.
pub struct Noise {
    /// Standard deviation of each cell.
    pub sigma: Vec<f64>,
    /// Points in a row that err alike: so many count as one.
    pub alike: f64,
}

/// What the differences of a block of cells tell.
#[derive(Clone, Copy, Default)]
struct Block {
    /// Spacing of pixels across the beams, and cosine of the incidence.
    spacing: f64,
    cosine: f64,
    sigma: f64,
    /// Lower quartile of the differences that are not nothing, and share of those that are.
    step: f64,
    same: f64,
    n: usize,
}

/// Estimates the noise; blocks of 2 x 2 cells share one.
pub fn estimate(image: &Image, pyramid: &Pyramid) -> Noise {
    let level = &pyramid.levels[1.min(pyramid.levels.len() - 1)];
    let factor = if pyramid.levels.len() > 1 { 2 } else { 1 };
    let (rows, columns) = (factor * pyramid.cell.0, factor * pyramid.cell.1);
    let unknown = Block { spacing: f64::NAN, cosine: 1.0, ..Block::default() };
    let mut blocks = vec![unknown; level.moments.len()];
    let mut differences = Vec::new();
    for (place, block) in blocks.iter_mut().enumerate() {
        let (y, x) = (place / level.width, place % level.width);
        if level.moments[place].count >= 8.0
            && let Some((flat, k)) = surface(pyramid, (y, x), factor - 1)
        {
            differences.clear();
            collect(image, &flat, (y * rows, x * columns), (rows, columns), &mut differences);
            *block = tell(&mut differences, &flat);
            let up = k + 1 - factor;
            (block.spacing, block.cosine) = if k == 0 {
                (f64::NAN, 1.0)
            } else {
                view(pyramid, k - 1, (2 * (y >> up), 2 * (x >> up)))
            };
        }
    }
    let usual = usual(&blocks);
    let width = pyramid.levels[0].width;
    let mut sigma: Vec<f64> = (0..pyramid.levels[0].moments.len())
        .map(|i| {
            let block = &blocks[i / width / factor * level.width + i % width / factor];
            let (typical, step) = at(&usual, block.spacing);
            let (typical, step) = (typical * block.cosine, step * block.cosine);
            let own = if block.n >= FEWEST && block.same < SAME { block.sigma } else { typical };
            own.clamp(LEAST * typical, MOST * typical).max(step / 2.0)
        })
        .collect();
    let longer = correlation(pyramid, &sigma);
    for sigma in &mut sigma {
        *sigma *= longer;
    }
    Noise { sigma, alike: longer * longer }
}

/// The plane of the smallest cell around a block in which noise does not hide it, and its level.
fn surface(pyramid: &Pyramid, (y, x): (usize, usize), first: usize) -> Option<(Flat, usize)> {
    (first..pyramid.levels.len()).find_map(|k| {
        let level = &pyramid.levels[k];
        let up = k - first;
        let flat = Flat::of(&level.moments[(y >> up) * level.width + (x >> up)]);
        (flat.variances[1] > CLEAR * flat.variances[0]).then_some((flat, k))
    })
}

/// Spacing of the pixels of 2 x 2 cells as it would be of a surface across the beams, and cosine of
/// the angle between its normal and them: it stretches the spacing along one side of the image.
fn view(pyramid: &Pyramid, k: usize, (y, x): (usize, usize)) -> (f64, f64) {
    let level = &pyramid.levels[k];
    let height = level.moments.len() / level.width;
    let means = [(y, x), (y, x + 1), (y + 1, x), (y + 1, x + 1)].map(|(y, x)| {
        let cell = (y < height && x < level.width).then(|| &level.moments[y * level.width + x]);
        cell.filter(|cell| cell.count > 0.0).map(|cell| cell.mean)
    });
    let [Some(a), Some(b), Some(c), Some(d)] = means else { return (f64::NAN, 1.0) };
    let per = |length: usize| 0.5 / (length << k) as f64;
    let across: Vector = std::array::from_fn(|k| per(pyramid.cell.1) * (b[k] + d[k] - a[k] - c[k]));
    let along: Vector =
        std::array::from_fn(|k| per(pyramid.cell.0) / pyramid.aspect * (c[k] + d[k] - a[k] - b[k]));
    let squares = [spread::dot(&across, &across), spread::dot(&along, &along)];
    let area = (squares[0] * squares[1] - spread::dot(&across, &along).powi(2)).max(0.0).sqrt();
    let least = squares[0].min(squares[1]);
    (least.sqrt(), (least / area).clamp(GRAZING, 1.0))
}

/// How much farther from the planes of large cells than by white noise points are: the errors of
/// neighbours are alike.
///
/// Errors of any sensor grow less than in proportion to the distance; what bends, with its square.
fn correlation(pyramid: &Pyramid, sigma: &[f64]) -> f64 {
    let mut squares: Vec<f64> =
        pyramid.levels[0].moments.iter().zip(sigma).map(|(m, s)| m.count * s * s).collect();
    let mut last = 1.0;
    for k in 0..pyramid.levels.len() {
        let level = &pyramid.levels[k];
        if k > 0 {
            let below = &pyramid.levels[k - 1];
            squares = (0..level.moments.len())
                .map(|place| super::cells::children(level, below, place).map(|i| squares[i]).sum())
                .collect();
        }
        let full = (pyramid.cell.0 * pyramid.cell.1) as f64 * f64::from(1 << (2 * k));
        let mut ratios: Vec<f64> = level
            .moments
            .iter()
            .zip(&squares)
            .filter(|(moments, squares)| moments.count >= full / 2.0 && **squares > 0.0)
            .map(|(moments, squares)| {
                let m = moments.count;
                (Flat::of(moments).variances[0] * m * m / (m - 3.0) / squares).sqrt()
            })
            .collect();
        if ratios.len() < GROUP / 2 {
            break;
        }
        // Of large cells, fewer are on one surface.
        let smoothest = SMOOTHEST.iter().map(|share| {
            let at = (share * ratios.len() as f64) as usize;
            *ratios.select_nth_unstable_by(at, f64::total_cmp).1
        });
        let mut smoothest = smoothest.skip_while(|ratio| k > 0 && *ratio > STEEP * last);
        let Some(ratio) = smoothest.next() else { break };
        last = ratio;
    }
    last.max(1.0)
}

/// Gathers second differences across a plane in a window.
fn collect(
    image: &Image,
    flat: &Flat,
    (top, left): (usize, usize),
    (rows, columns): (usize, usize),
    differences: &mut Vec<f64>,
) {
    let (w, points) = (image.width, image.points);
    let root = SECOND.sqrt();
    let (bottom, right) = ((top + rows).min(image.height), (left + columns).min(w));
    for row in top..bottom {
        for column in left..right {
            let i = row * w + column;
            if (row + column) % 2 == 1 || points[i][0].is_nan() {
                continue;
            }
            let middle = flat.distance(&points[i]);
            for (at, size, step) in [(column, w, 1), (row, image.height, w)] {
                if at > 0 && at + 1 < size {
                    let (a, b) = (&points[i - step], &points[i + step]);
                    if !a[0].is_nan() && !b[0].is_nan() {
                        let off = 0.5 * flat.distance(a) + 0.5 * flat.distance(b) - middle;
                        differences.push(off.abs() / root);
                        continue;
                    }
                }
                let near = |room: usize| 1..=room.min(FAR);
                let Some(s) = near(at).find(|s| image.is_point(i - s * step)) else { continue };
                let Some(t) = near(size - 1 - at).find(|t| image.is_point(i + t * step)) else {
                    continue;
                };
                let (a, b) = (&points[i - s * step], &points[i + t * step]);
                let (s, t) = (s as f64, t as f64);
                let share = t / (s + t);
                let off = share * flat.distance(a) + (1.0 - share) * flat.distance(b) - middle;
                let variance = 1.0 + share * share + (1.0 - share) * (1.0 - share);
                differences.push(off.abs() / variance.sqrt());
            }
        }
    }
}

fn tell(differences: &mut Vec<f64>, flat: &Flat) -> Block {
    let n = differences.len();
    if n < FEWEST {
        return Block { n, ..Block::default() };
    }
    let far = flat.mean.iter().fold(0.0_f64, |far, x| far.max(x.abs()));
    let nothing = ROUNDING * far;
    let (_, &mut median, _) = differences.select_nth_unstable_by(n / 2, f64::total_cmp);
    let sigma = median / MEDIAN;
    let n_same = differences.iter().filter(|&&off| off <= nothing).count();
    differences.retain(|&off| off > nothing);
    let quarter = differences.len() / 4;
    // Half the second difference over its deviation.
    let step = if differences.is_empty() {
        0.0
    } else {
        2.0 * SECOND.sqrt() * *differences.select_nth_unstable_by(quarter, f64::total_cmp).1
    };
    Block { sigma, step, same: n_same as f64 / n as f64, n, ..Block::default() }
}

/// Spacing, usual noise and step of groups of blocks, by rising spacing.
fn usual(blocks: &[Block]) -> Vec<(f64, f64, f64)> {
    let mut some: Vec<&Block> =
        blocks.iter().filter(|block| block.n >= FEWEST && block.spacing >= 0.0).collect();
    some.sort_by(|a, b| a.spacing.total_cmp(&b.spacing).then(a.sigma.total_cmp(&b.sigma)));
    let size = some.len().div_ceil(GROUPS).max(GROUP);
    some.chunks(size)
        .map(|group| {
            let quantile = |mut values: Vec<f64>, share: f64| {
                let k = (share * values.len() as f64) as usize;
                values.sort_by(f64::total_cmp);
                values.get(k).copied().unwrap_or(0.0)
            };
            let spacing = quantile(group.iter().map(|block| block.spacing).collect(), 0.5);
            let same = quantile(group.iter().map(|block| block.same).collect(), 0.5);
            let steps: Vec<f64> = group
                .iter()
                .filter(|b| b.step > 0.0)
                .map(|block| block.step / block.cosine)
                .collect();
            let step = if same >= SAME { quantile(steps, USUAL) } else { 0.0 };
            let sigma =
                quantile(group.iter().map(|block| block.sigma / block.cosine).collect(), USUAL);
            (spacing, sigma, step)
        })
        .collect()
}

/// Usual noise and step at a spacing, between groups by straight lines.
fn at(usual: &[(f64, f64, f64)], spacing: f64) -> (f64, f64) {
    let k = if spacing.is_nan() {
        usual.len() / 2
    } else {
        usual.partition_point(|group| group.0 < spacing)
    };
    match (k.checked_sub(1).map(|k| usual[k]), usual.get(k)) {
        (Some(a), Some(b)) => {
            let share =
                if b.0 > a.0 && !spacing.is_nan() { (spacing - a.0) / (b.0 - a.0) } else { 0.0 };
            (a.1 + share * (b.1 - a.1), a.2 + share * (b.2 - a.2))
        }
        (Some(a), None) => (a.1, a.2),
        (None, Some(b)) => (b.1, b.2),
        (None, None) => (0.0, 0.0),
    }
}

/// Mean of the told noise over each of the smallest cells, by the root of the mean square.
pub fn told(image: &Image, pyramid: &Pyramid, sigma: &[f64]) -> Noise {
    let n = pyramid.levels[0].moments.len();
    let mut sums = vec![(0.0, 0.0); n];
    for (i, sigma) in sigma.iter().enumerate().filter(|(i, _)| image.is_point(*i)) {
        let (squares, count) = &mut sums[pyramid.cell_at(i / image.width, i % image.width)];
        *squares += sigma * sigma;
        *count += 1.0;
    }
    let mean = |(squares, count): (f64, f64)| {
        if count > 0.0 { f64::sqrt(squares / count) } else { 0.0 }
    };
    Noise { sigma: sums.into_iter().map(mean).collect(), alike: 1.0 }
}
