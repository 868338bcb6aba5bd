//! The rings around the triangles of which an outline consists.

use super::Mesh;
use spade::Triangulation;
use spade::handles::{DirectedEdgeHandle, FaceHandle, InnerTag};

type Triangle<'a> = FaceHandle<'a, InnerTag, super::Corner, (), (), ()>;
type Edge<'a> = DirectedEdgeHandle<'a, super::Corner, (), (), ()>;

/// Numbers of the corners around the largest part whose triangles share sides: of the outer ring,
/// counter-clockwise, then of the holes, clockwise, each from the lowest number on.
pub fn rings(mesh: &Mesh, alpha: f64) -> Vec<Vec<usize>> {
    let mut is_free = vec![false; mesh.num_all_faces()];
    for face in mesh.inner_faces() {
        is_free[face.fix().index()] = is_kept(face, alpha);
    }
    let mut part = vec![0; mesh.num_all_faces()];
    let (mut largest, mut most) = (0, 0.0);
    for (number, face) in (1..).zip(mesh.inner_faces()) {
        let area = flood(face, number, &mut is_free, &mut part);
        if area > most {
            (largest, most) = (number, area);
        }
    }
    let is_inside = |edge: Edge| largest > 0 && part[edge.face().fix().index()] == largest;
    let mut is_walked = vec![false; mesh.num_directed_edges()];
    let mut place_of = vec![usize::MAX; mesh.num_vertices()];
    let mut rings = Vec::new();
    for start in mesh.directed_edges() {
        if is_walked[start.fix().index()] || !is_inside(start) || is_inside(start.rev()) {
            continue;
        }
        let (mut way, mut edge): (Vec<Edge>, _) = (Vec::new(), start);
        while !is_walked[edge.fix().index()] {
            is_walked[edge.fix().index()] = true;
            let from = edge.from().fix().index();
            // Where the way comes to a corner again, it has gone around a ring.
            if place_of[from] != usize::MAX {
                rings.push(ring(way.split_off(place_of[from]), &mut place_of));
            }
            place_of[from] = way.len();
            way.push(edge);
            edge = edge.next();
            while is_inside(edge.rev()) {
                edge = edge.rev().next();
            }
        }
        rings.push(ring(way, &mut place_of));
    }
    rings.sort_unstable();
    rings.into_iter().map(|(_, ring)| ring).collect()
}

/// Whether a triangle's circumscribed circle is no larger than alpha.
fn is_kept(triangle: Triangle, alpha: f64) -> bool {
    let [a, b, c] = triangle.vertices().map(|vertex| vertex.data().at);
    let edges =
        [[b[0] - a[0], b[1] - a[1]], [c[0] - b[0], c[1] - b[1]], [a[0] - c[0], a[1] - c[1]]];
    let twice_area = (edges[0][0] * edges[1][1] - edges[0][1] * edges[1][0]).abs();
    let sides = edges.map(|[x, y]| (x * x + y * y).sqrt());
    twice_area > 0.0 && sides[0] * sides[1] * sides[2] <= 2.0 * alpha * twice_area
}

/// Numbers the free triangles that hang together with one; their area.
fn flood(first: Triangle, number: usize, is_free: &mut [bool], part: &mut [usize]) -> f64 {
    let (mut area, mut waiting) = (0.0, vec![first]);
    while let Some(triangle) = waiting.pop() {
        let place = triangle.fix().index();
        if !std::mem::take(&mut is_free[place]) {
            continue;
        }
        part[place] = number;
        area += triangle.area();
        let next = triangle.adjacent_edges().map(|edge| edge.rev().face().as_inner());
        waiting.extend(next.into_iter().flatten());
    }
    area
}

/// Whether a ring is a hole, and its corners from the lowest number on.
fn ring(way: Vec<Edge>, place_of: &mut [usize]) -> (bool, Vec<usize>) {
    let mut twice_area = 0.0;
    for edge in &way {
        let [a, b] = edge.vertices().map(|vertex| vertex.data().at);
        twice_area += (a[0] - 1.5) * (b[1] - 1.5) - (a[1] - 1.5) * (b[0] - 1.5);
        place_of[edge.from().fix().index()] = usize::MAX;
    }
    let mut numbers: Vec<usize> = way.into_iter().map(|edge| edge.from().data().number).collect();
    let lowest = (0..numbers.len()).min_by_key(|&i| numbers[i]).unwrap_or(0);
    numbers.rotate_left(lowest);
    (twice_area < 0.0, numbers)
}
