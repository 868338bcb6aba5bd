//! Fewer points with the same outline.

use super::{Place, frame};

/// Points beyond which an outline is drawn from one point a cell.
const MOST: usize = 4_000;

/// The points, or, of more than can be drawn quickly, one of each cell and the corners of their hull.
#[must_use]
pub fn thinned(points: &[Place]) -> Vec<Place> {
    let Some((low, size)) = frame(points).filter(|_| points.len() > MOST) else {
        return points.to_vec();
    };
    let high = points.iter().fold(low, |high, at| [high[0].max(at[0]), high[1].max(at[1])]);
    let most = MOST as f64;
    let side = ((high[0] - low[0]) * (high[1] - low[1]) / most).sqrt().max(size / most);
    let cell = |at: &Place| [0, 1].map(|k| ((at[k] - low[k]) / side) as usize + 1);
    // With an empty margin.
    let [width, height] = cell(&high).map(|n| n + 2);
    let mut first = vec![None::<Place>; width * height];
    for at in points {
        let [x, y] = cell(at);
        let held = &mut first[x * height + y];
        *held = Some(held.map_or(*at, |other| lower(*at, other)));
    }
    // Between full cells on all four diagonals nothing is a corner of the hull.
    let is_outer = |at: &&Place| {
        let [x, y] = cell(at);
        let full = |x: usize, y: usize| first[x * height + y].is_some();
        !(full(x - 1, y - 1) && full(x - 1, y + 1) && full(x + 1, y - 1) && full(x + 1, y + 1))
    };
    let mut kept = hull(points.iter().filter(is_outer).copied().collect());
    kept.extend(first.iter().flatten());
    kept
}

/// The one that comes first along x, then along y.
fn lower(a: Place, b: Place) -> Place {
    if (a[0], a[1]) < (b[0], b[1]) { a } else { b }
}

/// Corners of the convex hull (Andrew, Another efficient algorithm for convex hulls, 1979).
fn hull(mut points: Vec<Place>) -> Vec<Place> {
    points.sort_unstable_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    points.dedup();
    let mut corners: Vec<Place> = Vec::new();
    for _ in 0..2 {
        let start = corners.len();
        for &at in &points {
            while let [.., a, b] = corners[start..] {
                if (b[0] - a[0]) * (at[1] - a[1]) > (b[1] - a[1]) * (at[0] - a[0]) {
                    break;
                }
                corners.pop();
            }
            corners.push(at);
        }
        corners.pop();
        points.reverse();
    }
    corners
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_points_stay_and_many_keep_their_hull() {
        let n = 300;
        let ring: Vec<Place> = (0..n)
            .flat_map(|i| {
                let turn = f64::from(i) * 2.399_963;
                (0..n).map(move |j| {
                    let radius = 1.0 - f64::from(j) / f64::from(2 * n);
                    [radius * turn.cos(), radius * turn.sin()]
                })
            })
            .collect();
        assert_eq!(thinned(&ring[..100]).len(), 100);
        let fewer = thinned(&ring);
        assert!(fewer.len() < 6_000, "{}", fewer.len());
        assert_eq!(hull(fewer), hull(ring));
    }
}
