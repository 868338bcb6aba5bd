//! Planes in pieces: parts of one plane with a gap between them that the spacing does not explain.

use super::context::Context;
use super::graph::Graph;
use super::growth::{FEWEST, NOBODY};
use super::regions::{Members, components_by};
use crate::Vector;
use crate::neighbors::squared_distance;
use crate::spread::dot;
use std::cmp::Ordering;

/// The labels with each piece its own; pieces too small for a plane stay with the largest one that
/// they touch.
pub fn pieces(context: &Context, labels: &[i32]) -> Vec<i32> {
    let &Context { graph, settings, .. } = context;
    let points = context.points();
    let longest: Vec<f64> =
        (0..labels.len()).map(|i| longest(points, graph, labels, i, settings.gaps.most)).collect();
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
            let rank = near.len() / settings.gaps.usual;
            *near.select_nth_unstable_by(rank, f64::total_cmp).1
        })
        .collect();
    let longer = settings.gaps.longer.powi(2);
    let is_joined = |i: usize, other: usize| {
        squared_distance(&points[i], &points[other]) <= longer * usual[i].max(usual[other])
    };
    let parts = components_by(graph, labels, is_joined);
    let parts = without_chance_gaps(context, labels, &parts);
    let members = Members::of(&parts);
    let mut result = parts.clone();
    for k in (0..members.len()).filter(|&k| (1..FEWEST).contains(&members.get(k).len())) {
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

/// The parts of each label, put together where chance may have left the gap between them: a narrow
/// strip is empty over some length more often than a wide one.
fn without_chance_gaps(context: &Context, labels: &[i32], parts: &[i32]) -> Vec<i32> {
    let (points, graph) = (context.points(), context.graph);
    let members = Members::of(parts);
    let mut bridges: Vec<([i32; 2], [u32; 2])> = Vec::new();
    for (i, &part) in parts.iter().enumerate().filter(|(_, part)| **part != NOBODY) {
        for &other in graph.of(i).iter().filter(|&&other| labels[other as usize] == labels[i]) {
            let to = parts[other as usize];
            match part.cmp(&to) {
                Ordering::Less => bridges.push(([part, to], [i as u32, other])),
                Ordering::Greater => bridges.push(([to, part], [other, i as u32])),
                Ordering::Equal => {}
            }
        }
    }
    bridges.sort_unstable();
    let mut first: Vec<usize> = (0..members.len()).collect();
    for bridges in bridges.chunk_by(|one, other| one.0 == other.0) {
        let pair = bridges[0].0.map(|part| members.get(part as usize));
        if gap(points, graph, labels, bridges, pair).is_chance(context.settings.gaps.chance) {
            let [a, b] = bridges[0].0.map(|part| first[part as usize]);
            for end in first.iter_mut().filter(|end| **end == a.max(b)) {
                *end = a.min(b);
            }
        }
    }
    let of = |&part: &i32| if part == NOBODY { NOBODY } else { first[part as usize] as i32 };
    parts.iter().map(of).collect()
}

/// What lies between two parts of a plane.
pub struct Gap {
    /// Points that would be there if they were as dense as in the parts.
    n_missing: f64,
    /// Points of the parts.
    n_points: usize,
}

impl Gap {
    /// Whether chance leaves it.
    pub fn is_chance(&self, chance: f64) -> bool {
        self.n_missing < (self.n_points as f64).ln() + chance
    }
}

/// The gap is as long as its shortest bridge, and as wide as the parts face each other.
pub fn gap(
    points: &[Vector],
    graph: &Graph,
    labels: &[i32],
    bridges: &[([i32; 2], [u32; 2])],
    pair: [&[u32]; 2],
) -> Gap {
    let at = |place: u32| &points[place as usize];
    let mut way = [0.0; 3];
    let mut length = f64::INFINITY;
    for &(_, [a, b]) in bridges {
        way = std::array::from_fn(|axis| way[axis] + at(b)[axis] - at(a)[axis]);
        length = length.min(squared_distance(at(a), at(b)).sqrt());
    }
    let way = unit(&way);
    let start = at(bridges[0].1[0]);
    let aside = |place: u32| -> Vector {
        let from: Vector = std::array::from_fn(|axis| at(place)[axis] - start[axis]);
        let along = dot(&from, &way);
        std::array::from_fn(|axis| from[axis] - along * way[axis])
    };
    let all = || pair.iter().flat_map(|part| part.iter().copied());
    let farthest = all().map(aside).max_by(|a, b| dot(a, a).total_cmp(&dot(b, b)));
    let across = farthest.map_or([0.0; 3], |far| unit(&far));
    let [one, other] = pair.map(|part| {
        let places = part.iter().map(|&place| dot(&aside(place), &across));
        places.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], place| {
            [low.min(place), high.max(place)]
        })
    });
    let width = (one[1].min(other[1]) - one[0].max(other[0])).max(0.0);
    let spacing = spacing(points, graph, labels, all());
    let n_missing = length * (width + spacing) / spacing.powi(2);
    Gap { n_missing, n_points: pair.iter().map(|part| part.len()).sum() }
}

/// Spacing of points on the surfaces of their labels: the nearest of points that are scattered over
/// a plane is half of it away, on average.
pub fn spacing(
    points: &[Vector],
    graph: &Graph,
    labels: &[i32],
    places: impl Iterator<Item = u32>,
) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for place in places {
        let own = &labels[place as usize];
        if let Some(&near) =
            graph.of(place as usize).iter().find(|&&near| labels[near as usize] == *own)
        {
            sum += squared_distance(&points[place as usize], &points[near as usize]).sqrt();
            count += 1.0;
        }
    }
    2.0 * sum / count
}

fn unit(vector: &Vector) -> Vector {
    let length = dot(vector, vector).sqrt();
    vector.map(|value| if length > 0.0 { value / length } else { 0.0 })
}

/// Squared length of the longest edge from a point to its relative neighbours of the same label.
fn longest(points: &[Vector], graph: &Graph, labels: &[i32], i: usize, most: usize) -> f64 {
    if labels[i] == NOBODY {
        return 0.0;
    }
    let mut relative: Vec<u32> = Vec::with_capacity(most);
    let mut longest = 0.0;
    for &other in graph.of(i).iter().filter(|&&other| labels[other as usize] == labels[i]) {
        let away = squared_distance(&points[i], &points[other as usize]);
        let hides =
            |&near: &u32| squared_distance(&points[near as usize], &points[other as usize]) < away;
        if !relative.iter().any(hides) {
            relative.push(other);
            longest = away;
            if relative.len() == most {
                break;
            }
        }
    }
    longest
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::super::settings::Settings;
    use super::*;
    use crate::Workers;
    use crate::neighbors::PointTree;
    use crate::segmentation::roughness::Surfaces;

    /// Pieces of points of one plane.
    fn pieces_of_one(points: &[Vector]) -> Vec<i32> {
        let workers = &Workers::new(Some(1), &(|| true)).unwrap();
        let tree = &PointTree::new(points);
        let graph = &Graph::new(tree, 16, 96, workers).unwrap();
        let context = Context {
            tree,
            graph,
            noise: &[],
            surfaces: Surfaces::Smooth,
            settings: &Settings::default(),
        };
        pieces(&context, &vec![0; points.len()])
    }

    /// Sizes of the pieces of points scattered over a square of 1 where `is_there` says so.
    fn sizes(is_there: impl Fn(f64, f64) -> bool) -> Vec<usize> {
        let points: Vec<Vector> = (0..4000_u32)
            .map(|i| (f64::from(i) * 0.618_034 % 1.0, f64::from(i) * 0.754_878 % 1.0))
            .filter(|&(u, v)| is_there(u, v))
            .map(|(u, v)| [u, v, 0.3 * u - 0.2 * v])
            .collect();
        let members = Members::of(&pieces_of_one(&points));
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

    /// A strip of three spacings has gaps of as many by chance.
    #[test]
    fn a_narrow_strip_is_one_piece() {
        let mut seed = 7_u64;
        let mut draw = || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (seed >> 11) as f64 / (1_u64 << 53) as f64
        };
        let points: Vec<Vector> = (0..400).map(|_| [2.0 * draw(), 0.04 * draw(), 0.0]).collect();
        let parts = pieces_of_one(&points);
        assert!(parts.iter().all(|&part| part == parts[0]));
    }

    #[test]
    fn few_points_beyond_a_gap_stay() {
        let sizes = sizes(|u, v| u < 0.8 || (u > 0.92 && (v - 0.5).abs() < 0.01));
        assert_eq!(sizes.len(), 1);
    }
}
