//! Points in rows: scans of one place lie so close along each row that no neighbourhood reaches the
//! next one, and every row spans planes of its own. Fewer points tell the surface better.

use super::Segmentation;
use super::growth::NOBODY;
use super::regions::{self, Competition};
use super::settings::{Rows, Settings};
use crate::neighbors::normals::FLAT;
use crate::neighbors::{Neighbor, PointTree, Search};
use crate::spread::Moments;
use crate::{Error, Vector, Workers};

/// Sizes while they double.
const STEPS: usize = 2;

/// One in how many points is enough, so that a large neighbourhood reaches the next row.
///
/// The number of points in a ball grows with a power of its radius, by which a surface has about
/// two dimensions and a row one. The last size at which it rises from the one to the other tells
/// how many points a row has between two rows: smaller balls may fill up with the noise of a row.
/// Where the rows run across the surface, they are beams that were measured again and again, and
/// few points of each are enough.
pub fn stride(tree: &PointTree, settings: &Rows) -> usize {
    let dimensions = dimensions(tree, settings);
    let mut doubled = dimensions.iter().zip(dimensions.iter().skip(STEPS));
    let reaching = doubled
        .rfind(|((_, half), (_, own))| *own >= settings.surface && *own >= settings.rise * half)
        .map(|(_, (size, _))| *size);
    let is_part = |size: &usize| settings.parts * size <= tree.points().len();
    let Some(reaching) = reaching.filter(is_part) else { return 1 };
    let rows = rows(tree, reaching, settings);
    let most = |is: fn(&Row, &Rows) -> bool| {
        2 * rows.iter().filter(|row| is(row, settings)).count() > rows.len()
    };
    let enough = if most(Row::is_across) { settings.few } else { settings.enough };
    let stride = (reaching + enough / 2) / enough;
    if stride > 1 && most(Row::is_thin) { stride } else { 1 }
}

/// Part of a row, and what it lies on.
struct Row {
    /// Standard deviation of the part beside its own direction, and of all across the surface; the
    /// latter is 0 where all are no surface: parts of walls far apart are no rows.
    width: f64,
    thickness: f64,
    /// How far some rows reach.
    reach: f64,
    /// Share of the part's variance that is across the surface.
    share_across: f64,
}

impl Row {
    /// Whether it is no wider than what it lies on is thick, or much less than the way to the next:
    /// slats with gaps between them are wider, and surfaces themselves.
    fn is_thin(&self, settings: &Rows) -> bool {
        self.width <= (settings.thin * self.thickness).max(settings.narrow * self.reach)
    }

    fn is_across(&self, settings: &Rows) -> bool {
        self.share_across > settings.across
    }
}

/// Parts of rows that have `reaching` points between one and the next.
fn rows(tree: &PointTree, reaching: usize, settings: &Rows) -> Vec<Row> {
    let (mut search, mut wider) = (Search::default(), Search::default());
    let mut row = |point: &Vector| {
        let at = |neighbor: &Neighbor| &tree.points()[neighbor.place as usize];
        let near = tree.nearest(point, reaching / settings.within, &mut search);
        let far = tree.nearest(point, settings.within * reaching, &mut wider);
        let [part, all] = [near, far].map(|some| Moments::of(some.iter().map(at), point).spread());
        let is_surface = all.variances[1] > FLAT * all.variances[0];
        let middle = all.distance(&part.mean);
        let off = |neighbor| (all.distance(at(neighbor)) - middle).powi(2);
        let across = near.iter().map(off).sum::<f64>() / near.len() as f64;
        Row {
            width: part.variances[1].sqrt(),
            thickness: if is_surface { all.variances[0].sqrt() } else { 0.0 },
            reach: far[far.len() - 1].squared.sqrt(),
            share_across: across / part.variances.iter().sum::<f64>(),
        }
    };
    samples(tree, settings).map(&mut row).collect()
}

/// Some points, none of them where the tree was halved: there it has the outermost points of its
/// parts, which are those between surfaces.
fn samples<'a>(tree: &'a PointTree, settings: &Rows) -> impl Iterator<Item = &'a Vector> + use<'a> {
    let step = tree.points().len().div_ceil(settings.samples);
    tree.points().iter().skip(step / 3).step_by(step)
}

/// Median dimension of neighbourhoods from half to double each size.
fn dimensions(tree: &PointTree, settings: &Rows) -> Vec<(usize, f64)> {
    let most = settings.sizes.1.min(tree.points().len() / 4);
    // Every second one is 1.5 times the one before, instead of the root of 2.
    let sizes: Vec<usize> = std::iter::successors(Some(settings.sizes.0), |size| Some(2 * size))
        .flat_map(|size| [size, size + size / 2])
        .take_while(|&size| size <= most)
        .collect();
    let mut search = Search::default();
    let mut radii = vec![Vec::new(); sizes.len()];
    for point in samples(tree, settings) {
        let squares = tree.nearest_squares(point, most, &mut search);
        // The largest first: what is beyond it is not looked at again.
        for (radii, &size) in radii.iter_mut().zip(&sizes).rev() {
            radii.push(f64::from_bits(*squares[..].select_nth_unstable(size - 1).1));
            squares.truncate(size);
        }
    }
    let from_half_to_double = radii.windows(2 * STEPS + 1).zip(sizes.iter().skip(STEPS));
    from_half_to_double
        .map(|(radii, &size)| {
            // Of squared radii, for four times as many points.
            let (half, double) = (&radii[0], &radii[radii.len() - 1]);
            let mut growth: Vec<f64> = half.iter().zip(double).map(|(a, b)| b / a).collect();
            let middle = growth.len() / 2;
            let median = *growth.select_nth_unstable_by(middle, f64::total_cmp).1;
            (size, 16.0_f64.ln() / median.ln())
        })
        .collect()
}

/// Labels and noise of all points of a tree, from those of one in `stride` of them, which are the
/// points of `some`: the others compete for the planes of the nearest.
///
/// # Errors
/// [`Error::Stopped`] when the caller does not want to go on.
pub fn told(
    tree: &PointTree,
    sigma: Option<&[f64]>,
    some: &PointTree,
    found: &Segmentation,
    settings: &Settings,
    workers: &Workers,
) -> Result<Segmentation, Error> {
    let noise: Vec<f32> = found.sigma.iter().map(|&sigma| sigma as f32).collect();
    let planes = regions::fit(some.points(), &noise, &found.labels, workers);
    let competition = Competition::new(&planes, found.surfaces, settings, found.n_nearest);
    let points = tree.points();
    let mut all = vec![(NOBODY, 0.0); points.len()];
    let scratch = || (Search::default(), Vec::new());
    workers.fill(&mut all, 1, scratch, |(search, counts), i, told| {
        let near = some.nearest(&points[i], found.n_nearest, search);
        let log_room = || (2.0 * near[near.len() - 1].squared.sqrt()).ln();
        let labels = near.iter().map(|neighbor| found.labels[neighbor.place as usize]);
        let label = competition.best(&points[i], labels, log_room, counts);
        told[0] = (label, found.sigma[near[0].place as usize]);
    })?;
    let (labels, noise) = all.into_iter().unzip();
    let sigma = sigma.map_or(noise, <[f64]>::to_vec);
    Ok(Segmentation { labels, sigma, ..*found })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rows a distance of 1 apart, with points a step apart that err across the plane.
    fn stride_of_rows(step: f64) -> usize {
        let n = (40.0 / step) as usize;
        let points: Vec<Vector> = (0..40 * n)
            .map(|i| {
                let error = 0.05 * (1e4 * (i as f64).sin()).fract();
                [(i % n) as f64 * step, (i / n) as f64 + 0.1 * error, error]
            })
            .collect();
        stride(&PointTree::new(&points), &Rows::default())
    }

    #[test]
    fn a_surface_needs_all_points() {
        assert_eq!(stride_of_rows(1.0), 1);
        assert_eq!(stride_of_rows(0.3), 1);
        let golden = 0.5 * (5.0_f64.sqrt() - 1.0);
        let scattered: Vec<Vector> = (0..4000)
            .map(|i| [f64::from(i) / 4000.0, (f64::from(i) * golden).fract(), 0.0])
            .collect();
        assert_eq!(stride(&PointTree::new(&scattered), &Rows::default()), 1);
    }

    #[test]
    fn rows_need_as_many_as_reach_the_next_one() {
        // A ball that just reaches the next rows holds about two gaps of its own row.
        let strides = [0.02, 0.005].map(stride_of_rows);
        assert!((2..=8).contains(&strides[0]), "{strides:?}");
        assert!((8..=32).contains(&strides[1]), "{strides:?}");
    }

    #[test]
    fn beams_that_are_measured_again_and_again_need_few_points_each() {
        let points: Vec<Vector> = (0..20_000)
            .map(|i| {
                let error = 0.5 * (1e4 * f64::from(i).sin()).fract();
                [f64::from(i / 10 % 50), f64::from(i / 500), error]
            })
            .collect();
        let stride = stride(&PointTree::new(&points), &Rows::default());
        assert!((4..=10).contains(&stride), "{stride}");
    }

    #[test]
    fn slats_are_surfaces() {
        let slats: Vec<Vector> = (0..20_000)
            .map(|i| {
                let across =
                    0.05 * (1e4 * f64::from(i).sin()).fract().abs() + 0.1 * f64::from(i % 10);
                [across, f64::from(i) / 10_000.0, 0.001 * (1e4 * f64::from(i).cos()).fract()]
            })
            .collect();
        assert_eq!(stride(&PointTree::new(&slats), &Rows::default()), 1);
    }

    #[test]
    fn walls_far_apart_are_no_rows() {
        let walls: Vec<Vector> = (0..9200)
            .map(|i| {
                let (wall, u) = (f64::from(i / 100), f64::from(i) * 0.618_034 % 1.0);
                let v = f64::from(i) * 0.754_878 % 1.0;
                let at = [0.618_034, 0.754_878, 0.569_840].map(|step| 30.0 * (wall * step % 1.0));
                let off = 0.01 * (1e4 * f64::from(i).sin()).fract();
                [at[0] + 2.0 * u, at[1] + 2.0 * v, at[2] + wall.sin() * u + off]
            })
            .collect();
        assert_eq!(stride(&PointTree::new(&walls), &Rows::default()), 1);
    }

    #[test]
    fn samples_are_not_outermost() {
        let per_cluster = 160;
        let points: Vec<Vector> = (0..Rows::default().samples)
            .flat_map(|cluster| {
                let start = 10.0 * cluster as f64;
                let stray = [start - 5.0, 0.0, 0.0];
                let own = (1..per_cluster).map(move |i| [start + 0.01 * f64::from(i), 0.0, 0.0]);
                std::iter::once(stray).chain(own)
            })
            .collect();
        let tree = PointTree::new(&points);
        let strays =
            samples(&tree, &Rows::default()).filter(|point| point[0].rem_euclid(10.0) == 5.0);
        assert!(strays.count() <= 3);
    }

    #[test]
    fn one_row_is_no_surface() {
        let row: Vec<Vector> = (0..4000).map(|i| [f64::from(i), 0.0, 0.0]).collect();
        assert_eq!(stride(&PointTree::new(&row), &Rows::default()), 1);
    }
}
