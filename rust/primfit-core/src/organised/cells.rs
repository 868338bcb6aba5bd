//! The image as a pyramid of cells: moments, adding from level to level, and planes in closed form.

use crate::Vector;
use crate::spread::{Moments, Sums};

/// Pixels of the smallest cell, in the shape nearest to a square on the surface.
const SMALLEST: [(usize, usize); 3] = [(4, 4), (2, 8), (8, 2)];
/// Ratio of the spacing of rows and columns from which a cell is not square in pixels.
const OBLONG: f64 = 3.0;
/// Pixels between points that tell the spacing, farther apart than noise, and every how many-th
/// pixel is looked at; quantile of the ratios, since more surfaces lean along rows than columns.
const APART: usize = 6;
const EVERY: usize = 7;
const LEANING: f64 = 0.4;
/// Share of filled pixels beside filled ones, below which cells are twice as wide.
const SPARSE: f64 = 0.7;
/// Doublings of the smallest cell.
pub const LEVELS: usize = 4;

/// An organised cloud: rows of `width` pixels; NaN is no point.
#[derive(Clone, Copy)]
pub struct Image<'a> {
    /// Points, row by row.
    pub points: &'a [Vector],
    /// Pixels of a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Whether the last column lies beside the first.
    pub is_ring: bool,
}

impl Image<'_> {
    /// Whether a pixel has a point.
    pub fn is_point(&self, i: usize) -> bool {
        !self.points[i][0].is_nan()
    }

    /// Share of the pixels beside one with a point, in its row, that have one.
    fn filled(&self) -> f64 {
        let (mut n, mut n_filled) = (0_usize, 0_usize);
        for i in (1..self.points.len()).step_by(EVERY).filter(|&i| self.is_point(i)) {
            n += 1;
            n_filled += usize::from(self.is_point(i - 1));
        }
        n_filled as f64 / n.max(1) as f64
    }

    /// Spacing of the rows over that of the columns.
    ///
    /// A surface that leans away stretches the spacing along one side of the image.
    fn aspect(&self) -> f64 {
        let (w, h) = (self.width, self.height);
        let (down, right) = (APART.min(h - 1).max(1), APART.min(w - 1).max(1));
        let per = right as f64 / down as f64;
        let mut ratios: Vec<f64> = (0..self.points.len().saturating_sub(down * w))
            .step_by(EVERY)
            .filter(|&i| i % w + right < w)
            .map(|i| {
                let [p, q, r] = [i, i + right, i + down * w].map(|i| &self.points[i]);
                per * distance(p, r) / distance(p, q)
            })
            .filter(|ratio| ratio.is_finite())
            .collect();
        if ratios.is_empty() {
            return 1.0;
        }
        let at = (LEANING * ratios.len() as f64) as usize;
        *ratios.select_nth_unstable_by(at, f64::total_cmp).1
    }
}

/// Distance of two points; NaN when one is none.
pub fn distance(p: &Vector, q: &Vector) -> f64 {
    let away: Vector = std::array::from_fn(|k| p[k] - q[k]);
    (away[0] * away[0] + away[1] * away[1] + away[2] * away[2]).sqrt()
}

/// The plane through points, by their moments.
#[derive(Debug, Clone, Copy, Default)]
pub struct Flat {
    /// Mean of the points.
    pub mean: Vector,
    /// Unit normal.
    pub normal: Vector,
    /// Principal variances, rising.
    pub variances: Vector,
}

impl Flat {
    /// The normal of [`Moments::spread`], and variances that are numbers even of no points.
    pub fn of(moments: &Moments) -> Self {
        let s = moments.scatter.map(|sum| sum / moments.count);
        let normal = moments.spread().normal;
        let [xx, xy, xz, yy, yz, zz] = s;
        let along = [
            xx * normal[0] + xy * normal[1] + xz * normal[2],
            xy * normal[0] + yy * normal[1] + yz * normal[2],
            xz * normal[0] + yz * normal[1] + zz * normal[2],
        ];
        let least = crate::spread::dot(&along, &normal).max(0.0);
        let rest = xx + yy + zz - least;
        let minors = xx * yy - xy * xy + xx * zz - xz * xz + yy * zz - yz * yz;
        let product = minors - least * rest;
        let root = (rest * rest / 4.0 - product).max(0.0).sqrt();
        let variances = [least, (rest / 2.0 - root).max(least), rest / 2.0 + root];
        Self { mean: moments.mean, normal, variances }
    }

    /// Signed distance of a point.
    pub fn distance(&self, point: &Vector) -> f64 {
        let away = |k: usize| self.normal[k] * (point[k] - self.mean[k]);
        away(0) + away(1) + away(2)
    }
}

/// The cells of one size.
pub struct Level {
    /// Cells in a row of them.
    pub width: usize,
    /// Moments of each cell's points.
    pub moments: Vec<Moments>,
}

/// Cells of doubling size.
pub struct Pyramid {
    /// Pixels of the smallest cell, rows and columns.
    pub cell: (usize, usize),
    /// Spacing of the rows over that of the columns.
    pub aspect: f64,
    /// From the smallest cells to the largest.
    pub levels: Vec<Level>,
}

impl Pyramid {
    /// Of an image.
    pub fn of(image: &Image) -> Self {
        let aspect = image.aspect();
        let oblong = (aspect > OBLONG, aspect < 1.0 / OBLONG);
        let (rows, columns) = SMALLEST[usize::from(oblong.0) + 2 * usize::from(oblong.1)];
        let cell = if image.filled() < SPARSE { (rows, 2 * columns) } else { (rows, columns) };
        let mut levels = vec![smallest(image, cell)];
        while levels.len() < LEVELS {
            let last = &levels[levels.len() - 1];
            let (width, height) = (last.width, last.moments.len() / last.width);
            if width < 4 && height < 4 {
                break;
            }
            levels.push(doubled(last));
        }
        Self { cell, aspect, levels }
    }

    /// Smallest cell of a pixel.
    pub fn cell_at(&self, row: usize, column: usize) -> usize {
        // Sides are powers of two.
        let (y, x) = (self.cell.0.trailing_zeros(), self.cell.1.trailing_zeros());
        (row >> y) * self.levels[0].width + (column >> x)
    }
}

fn smallest(image: &Image, (rows, columns): (usize, usize)) -> Level {
    let width = image.width.div_ceil(columns);
    let mut moments = Vec::with_capacity(width * image.height.div_ceil(rows));
    for top in (0..image.height).step_by(rows) {
        for left in (0..image.width).step_by(columns) {
            let right = (left + columns).min(image.width);
            let mut sums: Option<Sums> = None;
            for row in top..(top + rows).min(image.height) {
                for point in &image.points[row * image.width + left..row * image.width + right] {
                    if !point[0].is_nan() {
                        sums.get_or_insert_with(|| Sums::new(*point)).add(point);
                    }
                }
            }
            moments.push(sums.map_or_else(Moments::default, |sums| sums.moments()));
        }
    }
    Level { width, moments }
}

fn doubled(level: &Level) -> Level {
    let height = level.moments.len() / level.width;
    let width = level.width.div_ceil(2);
    let mut moments = Vec::with_capacity(width * height.div_ceil(2));
    for top in (0..height).step_by(2) {
        for left in (0..level.width).step_by(2) {
            let mut all = Moments::default();
            for (row, column) in
                [(top, left), (top, left + 1), (top + 1, left), (top + 1, left + 1)]
            {
                if row < height && column < level.width {
                    all = sum(&all, &level.moments[row * level.width + column]);
                }
            }
            moments.push(all);
        }
    }
    Level { width, moments }
}

/// Moments of the points of both, either of which may be none.
pub fn sum(a: &Moments, b: &Moments) -> Moments {
    if a.count == 0.0 { *b } else { a.joined(b) }
}

/// Places of the four cells of the level below.
pub fn children(level: &Level, below: &Level, place: usize) -> impl Iterator<Item = usize> {
    let (top, left) = (2 * (place / level.width), 2 * (place % level.width));
    let (width, height) = (below.width, below.moments.len() / below.width);
    [(top, left), (top, left + 1), (top + 1, left), (top + 1, left + 1)]
        .into_iter()
        .filter(move |&(row, column)| row < height && column < width)
        .map(move |(row, column)| row * width + column)
}
