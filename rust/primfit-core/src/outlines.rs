//! Outlines of points in a plane, concave and with holes: alpha shapes that hold together
//! (Edelsbrunner, Kirkpatrick, Seidel: On the shape of a set of points in the plane, 1983).

mod rings;
mod thinning;

use crate::spread::dot;
use crate::{Error, Vector, Workers};
use rayon::prelude::{IntoParallelRefIterator, ParallelIterator};
use rings::rings;
use spade::{DelaunayTriangulation, HasPosition, Point2, Triangulation};
use std::array::from_fn;
pub use thinning::thinned;

/// Points that a group must have for the gap to it to count as a gap within the outline.
const FEW: usize = 10;

/// Radius alpha over the widest gap: with less, chance gaps notch the outline of random points.
const BRIDGE: f64 = 2.0;

/// A place in a plane.
pub type Place = [f64; 2];

/// What an outline is drawn of.
type Mesh = DelaunayTriangulation<Corner>;

/// The outline of points in a plane.
#[derive(Debug, Default, PartialEq)]
pub struct Outline {
    /// Closed ways through the points, the outer one first, counter-clockwise, then the holes,
    /// clockwise; none without area.
    pub rings: Vec<Vec<Place>>,
    /// The radius of the largest disc without points that is not cut out of it.
    pub alpha: f64,
}

/// Points near the plane `[a, b, c, d]` along two axes of it, and the place in space that they are
/// counted from, which their order does not change.
#[must_use]
pub fn laid_out<'a>(
    points: impl Iterator<Item = &'a Vector> + Clone,
    [a, b, c, d]: [f64; 4],
    axes: &[Vector; 2],
) -> (Vec<Place>, Vector) {
    let normal = [a, b, c];
    let (low, high) =
        points.clone().fold(([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]), |(low, high), p| {
            (from_fn(|k| f64::min(low[k], p[k])), from_fn(|k| f64::max(high[k], p[k])))
        });
    let middle: Vector = from_fn(|k| f64::midpoint(low[k], high[k]));
    let above = dot(&normal, &middle) + d;
    let place: Vector = from_fn(|k| middle[k] - above * normal[k]);
    let along = |point: &Vector| {
        let away: Vector = from_fn(|k| point[k] - place[k]);
        axes.map(|axis| dot(&away, &axis))
    };
    (points.map(along).collect(), place)
}

/// The outlines of the points of many planes, side by side.
///
/// # Errors
/// [`Error::Stopped`] when the caller does not want to go on.
pub fn outlines(planes: &[&[Place]], workers: &Workers) -> Result<Vec<Outline>, Error> {
    workers.watch(|stop| {
        let drawn = planes.par_iter().map(|points| {
            stop.check()?;
            Ok(outline(&thinned(points)).unwrap_or_default())
        });
        drawn.collect()
    })
}

/// A point of the triangulation, and its number.
#[derive(Clone, Copy)]
struct Corner {
    at: Place,
    number: usize,
}

impl HasPosition for Corner {
    type Scalar = f64;

    fn position(&self) -> Point2<f64> {
        Point2::new(self.at[0], self.at[1])
    }
}

/// None without area. The order of the points does not count.
fn outline(points: &[Place]) -> Option<Outline> {
    let mut points = points.to_vec();
    points.sort_unstable_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    let (low, size) = frame(&points)?;
    // From 1 to 2, where no number is too small for exact predicates.
    let corner = |(number, place): (usize, &Place)| Corner {
        at: [0, 1].map(|k| 1.0 + (place[k] - low[k]) / size),
        number,
    };
    let mesh = Mesh::bulk_load(points.iter().enumerate().map(corner).collect()).ok()?;
    let alpha = BRIDGE * widest_gap(&mesh, points.len())?;
    let rings = rings(&mesh, alpha);
    let place = |number: usize| points[number];
    let rings = rings.into_iter().map(|ring| ring.into_iter().map(place).collect()).collect();
    Some(Outline { rings, alpha: alpha * size })
}

/// The lower corner of the square around some places, and its side; none for fewer than three.
fn frame(points: &[Place]) -> Option<(Place, f64)> {
    let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    for place in points {
        for k in 0..2 {
            low[k] = low[k].min(place[k]);
            high[k] = high[k].max(place[k]);
        }
    }
    let size = (high[0] - low[0]).max(high[1] - low[1]);
    (points.len() > 2 && size > 0.0 && size.is_finite()).then_some((low, size))
}

/// Longest edge of the minimum spanning tree with a group of points on either side; its median
/// edge when there is none.
fn widest_gap(mesh: &Mesh, n_points: usize) -> Option<f64> {
    let mut edges: Vec<(f64, usize, usize)> = mesh
        .undirected_edges()
        .map(|edge| {
            let [a, b] = edge.vertices().map(|vertex| vertex.data().number);
            (edge.length_2(), a.min(b), a.max(b))
        })
        .collect();
    edges.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
    let mut groups = Groups::new(n_points);
    let (mut tree, mut gap) = (Vec::with_capacity(n_points), None);
    for (length, a, b) in edges {
        if let Some(smaller) = groups.join(a, b) {
            tree.push(length);
            gap = if smaller >= FEW { Some(length) } else { gap };
        }
    }
    // Rising, as the edges are.
    gap.or_else(|| tree.get(tree.len() / 2).copied()).map(f64::sqrt)
}

/// Points that have been joined.
struct Groups {
    parent: Vec<usize>,
    size: Vec<usize>,
}

impl Groups {
    fn new(n: usize) -> Self {
        Self { parent: (0..n).collect(), size: vec![1; n] }
    }

    fn root(&mut self, mut i: usize) -> usize {
        while self.parent[i] != i {
            self.parent[i] = self.parent[self.parent[i]];
            i = self.parent[i];
        }
        i
    }

    /// Joins two groups; the size of the smaller one, or none when they are one already.
    fn join(&mut self, a: usize, b: usize) -> Option<usize> {
        let (a, b) = (self.root(a), self.root(b));
        if a == b {
            return None;
        }
        let (small, large) = if self.size[a] < self.size[b] { (a, b) } else { (b, a) };
        self.parent[small] = large;
        self.size[large] += self.size[small];
        Some(self.size[small])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid(n: usize, keeps: impl Fn(f64, f64) -> bool) -> Vec<Place> {
        let step = 1.0 / (n - 1) as f64;
        let places = (0..n * n).map(|k| [(k / n) as f64 * step, (k % n) as f64 * step]);
        places.filter(|&[x, y]| keeps(x, y)).collect()
    }

    fn area(ring: &[Place]) -> f64 {
        let next = ring.iter().cycle().skip(1);
        ring.iter().zip(next).map(|(a, b)| a[0] * b[1] - a[1] * b[0]).sum::<f64>() / 2.0
    }

    #[test]
    fn a_frame_has_a_hole() {
        let frame = grid(21, |x, y| (x - 0.5).abs() > 0.32 || (y - 0.5).abs() > 0.32);
        let drawn = outline(&frame).unwrap_or_default();
        // The hole's four corners are rounded off.
        let areas: Vec<f64> = drawn.rings.iter().map(|ring| area(ring)).collect();
        assert_eq!(areas.len(), 2, "{areas:?}");
        assert!((areas[0] - 1.0).abs() < 1e-12 && (areas[1] + 0.47).abs() < 1e-12, "{areas:?}");
    }

    #[test]
    fn the_order_of_points_does_not_count() {
        let ell = grid(30, |x, y| x < 0.4 || y < 0.3);
        let mut other: Vec<Place> = ell.iter().rev().copied().collect();
        other.rotate_left(123);
        assert_eq!(outline(&ell), outline(&other));
    }

    #[test]
    fn points_without_area_have_no_outline() {
        for points in [vec![], vec![[1.0, 2.0]; 9], (0..9).map(|i| [f64::from(i), 0.0]).collect()] {
            assert!(outline(&points).is_none_or(|drawn| drawn.rings.is_empty()));
        }
    }

    #[test]
    fn parts_that_touch_in_a_point_are_two() {
        // Two squares with a corner in common, the second one smaller.
        let mut points = grid(11, |_, _| true);
        points
            .extend(grid(8, |_, _| true).into_iter().map(|[x, y]| [1.0 + 0.7 * x, 1.0 + 0.7 * y]));
        let drawn = outline(&points).unwrap_or_default();
        let mut sum = 0.0;
        for ring in &drawn.rings {
            let mut sorted = ring.clone();
            sorted.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
            sorted.dedup();
            assert_eq!(sorted.len(), ring.len(), "a corner twice");
            sum += area(ring);
        }
        assert!(sum >= 1.0 - 1e-12, "{sum}");
    }
}
