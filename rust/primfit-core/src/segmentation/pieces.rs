//! Planes in pieces: parts of one plane with a gap between them that the spacing does not explain.

use super::graph::Graph;
use super::growth::{FEWEST, NOBODY};
use super::regions::{Members, components_by};
use crate::Vector;
use crate::neighbors::squared_distance;

/// How much longer an edge may be than is usual around it: from 2 to 3, panels, slats, cartons and
/// recorded roofs come out alike; gaps of 6 spacings need less than 3.
const LONGER: f64 = 2.5;
/// Share of the points around one that have no longer edge than is usual: across a gap, those of
/// more than half of the points on its rim may be.
const USUAL: usize = 4;
/// Relative neighbours of a point at most.
const MOST: usize = 8;

/// The labels with each piece its own; pieces too small for a plane stay with the largest one that
/// they touch.
pub fn pieces(points: &[Vector], graph: &Graph, labels: &[i32]) -> Vec<i32> {
    let longest: Vec<f64> = (0..labels.len()).map(|i| longest(points, graph, labels, i)).collect();
    let mut near = Vec::new();
    let usual: Vec<f64> = (0..labels.len())
        .map(|i| {
            if labels[i] == NOBODY {
                return 0.0;
            }
            near.clear();
            near.push(longest[i]);
            let own = graph.of(i).iter().map(|&other| other as usize);
            near.extend(own.filter(|&other| labels[other] == labels[i]).map(|at| longest[at]));
            let rank = near.len() / USUAL;
            *near.select_nth_unstable_by(rank, f64::total_cmp).1
        })
        .collect();
    let longer = LONGER.powi(2);
    let is_joined = |i: usize, other: usize| {
        squared_distance(&points[i], &points[other]) <= longer * usual[i].max(usual[other])
    };
    let parts = components_by(graph, labels, is_joined);
    let members = Members::of(&parts);
    let mut result = parts.clone();
    for k in (0..members.len()).filter(|&k| members.get(k).len() < FEWEST) {
        let touched = members.get(k).iter().flat_map(|&place| graph.of(place as usize));
        let own = labels[members.get(k)[0] as usize];
        let largest = touched
            .filter(|&&other| labels[other as usize] == own)
            .map(|&other| parts[other as usize])
            .max_by_key(|&part| (members.get(part as usize).len(), part));
        if let Some(part) = largest {
            for &place in members.get(k) {
                result[place as usize] = part;
            }
        }
    }
    result
}

/// Squared length of the longest edge from a point to its relative neighbours of the same label.
fn longest(points: &[Vector], graph: &Graph, labels: &[i32], i: usize) -> f64 {
    if labels[i] == NOBODY {
        return 0.0;
    }
    let mut relative: Vec<u32> = Vec::with_capacity(MOST);
    let mut longest = 0.0;
    for &other in graph.of(i).iter().filter(|&&other| labels[other as usize] == labels[i]) {
        let away = squared_distance(&points[i], &points[other as usize]);
        let hides =
            |&near: &u32| squared_distance(&points[near as usize], &points[other as usize]) < away;
        if !relative.iter().any(hides) {
            relative.push(other);
            longest = away;
            if relative.len() == MOST {
                break;
            }
        }
    }
    longest
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;
    use crate::Workers;
    use crate::neighbors::PointTree;

    /// Sizes of the pieces of points scattered over a square of 1 where `is_there` says so.
    fn sizes(is_there: impl Fn(f64, f64) -> bool) -> Vec<usize> {
        let points: Vec<Vector> = (0..4000_u32)
            .map(|i| (f64::from(i) * 0.618_034 % 1.0, f64::from(i) * 0.754_878 % 1.0))
            .filter(|&(u, v)| is_there(u, v))
            .map(|(u, v)| [u, v, 0.3 * u - 0.2 * v])
            .collect();
        let workers = Workers::new(Some(1), &(|| true)).unwrap();
        let tree = PointTree::new(&points);
        let graph = Graph::new(&tree, 16, 96, &workers).unwrap();
        let members = Members::of(&pieces(tree.points(), &graph, &vec![0; points.len()]));
        (0..members.len()).map(|k| members.get(k).len()).filter(|&size| size > 0).collect()
    }

    #[test]
    fn what_has_no_gap_is_one_piece() {
        assert_eq!(sizes(|_, _| true).len(), 1);
        assert_eq!(sizes(|u, v| u < 0.4 || v < 0.1 || u > 0.6).len(), 1);
    }

    #[test]
    fn equal_gaps_are_all_cut() {
        assert_eq!(sizes(|u, _| (4.0 * u).fract() < 0.6).len(), 4);
        assert_eq!(sizes(|u, v| (3.0 * u).fract() < 0.7 && (3.0 * v).fract() < 0.7).len(), 9);
    }

    #[test]
    fn few_points_beyond_a_gap_stay() {
        let sizes = sizes(|u, v| u < 0.8 || (u > 0.92 && (v - 0.5).abs() < 0.01));
        assert_eq!(sizes.len(), 1);
    }
}
