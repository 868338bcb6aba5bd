//! Every instruction set and every way through the tree against all triangles and round solids in
//! float64.

#![allow(clippy::unwrap_used)]

use super::caster::{Hit, RayCaster, Way, cast_at_all};
use super::query::{Rays, unit};
use super::round::Round;
use crate::instructions::Instructions;
use crate::{Vector, Workers};
use proptest::prelude::*;

/// Numbers in -1..1 that follow from a seed.
struct Numbers(u64);

impl Numbers {
    fn next(&mut self) -> f64 {
        // Steele, Lea, Flood: SplitMix, 2014.
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / f64::from(2_u32).powi(52) - 1.0
    }

    fn vector(&mut self) -> Vector {
        std::array::from_fn(|_| self.next())
    }

    fn below(&mut self, n: usize) -> usize {
        (f64::midpoint(self.next(), 1.0) * n as f64) as usize % n
    }
}

type Mesh = (Vec<Vector>, Vec<[i64; 3]>);

fn soup(numbers: &mut Numbers, n: usize, size: f64, scale: f64, offset: f64) -> Mesh {
    let mut vertices = Vec::new();
    for _ in 0..n {
        let place = numbers.vector();
        for _ in 0..3 {
            let corner = numbers.vector();
            vertices.push(std::array::from_fn(|k| (place[k] + size * corner[k]) * scale + offset));
        }
    }
    (vertices, (0..n as i64).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect())
}

/// Triangles between points of a sphere, closed.
fn sphere(n: usize, squash: f64, scale: f64, offset: f64) -> Mesh {
    let mut vertices = vec![[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]];
    for i in 1..n {
        let polar = std::f64::consts::PI * i as f64 / n as f64;
        for j in 0..2 * n {
            let azimuth = std::f64::consts::PI * j as f64 / n as f64;
            vertices.push([polar.sin() * azimuth.cos(), polar.sin() * azimuth.sin(), polar.cos()]);
        }
    }
    let row = |i: usize, j: usize| match i {
        0 => 0,
        i if i == n => 1,
        i => (2 + (i - 1) * 2 * n + j % (2 * n)) as i64,
    };
    let mut triangles = Vec::new();
    for i in 0..n {
        for j in 0..2 * n {
            let [a, b, c, d] = [row(i, j), row(i + 1, j), row(i + 1, j + 1), row(i, j + 1)];
            triangles.extend(
                [[a, b, c], [a, c, d]].into_iter().filter(|[a, b, c]| a != b && b != c && a != c),
            );
        }
    }
    for vertex in &mut vertices {
        vertex[2] *= squash;
        *vertex = vertex.map(|x| x * scale + offset);
    }
    (vertices, triangles)
}

fn towards(origin: Vector, target: Vector) -> Vector {
    let way: Vector = std::array::from_fn(|k| target[k] - origin[k]);
    let length = way.iter().map(|x| x * x).sum::<f64>().sqrt();
    if length > 0.0 { way.map(|x| x / length) } else { [1.0, 0.0, 0.0] }
}

/// A point of a triangle: a corner, on an edge or within.
fn target(numbers: &mut Numbers, (vertices, triangles): &Mesh) -> Vector {
    let [a, b, c] = triangles[numbers.below(triangles.len())].map(|i| vertices[i as usize]);
    let (mut u, mut v) = ((numbers.next() + 1.0) / 3.0, (numbers.next() + 1.0) / 3.0);
    match numbers.below(4) {
        0 => (u, v) = (0.0, 0.0),
        1 => v = 0.0,
        2 => u = 1.0 - v,
        _ => {}
    }
    std::array::from_fn(|k| a[k] + u * (b[k] - a[k]) + v * (c[k] - a[k]))
}

fn ready((vertices, triangles): &Mesh, rounds: &[Round]) -> RayCaster {
    let workers = Workers::new(None, &|| true).unwrap();
    RayCaster::with_rounds(vertices, triangles, rounds, &workers).unwrap()
}

/// What all instruction sets find on every way; they must agree to the bit.
fn cast_everywhere(mesh: &Mesh, origins: &[Vector], directions: &[Vector]) -> Vec<Hit> {
    cast_on_all(ready(mesh, &[]), origins, directions)
}

fn cast_on_all(mut caster: RayCaster, origins: &[Vector], directions: &[Vector]) -> Vec<Hit> {
    let mut found: Option<Vec<Hit>> = None;
    for instructions in Instructions::available() {
        caster.use_instructions(instructions);
        for way in Way::all(origins) {
            let (mut ranges, mut ids) = (vec![0.0; origins.len()], vec![0; origins.len()]);
            let (ranges_here, ids_here) = (&mut ranges[..], &mut ids[..]);
            let mut rays =
                Rays { origins, directions, names: None, ranges: ranges_here, ids: ids_here };
            assert!(caster.cast_part(way, &mut rays));
            let hits: Vec<Hit> = std::iter::zip(ranges, ids)
                .map(|(range, triangle)| Hit { range, triangle })
                .collect();
            if let Some(found) = &found {
                for (row, (hit, other)) in hits.iter().zip(found).enumerate() {
                    assert!(
                        hit == other,
                        "{instructions:?} {way:?} row {row}: {hit:?}, not {other:?}; from {:?} to \
                         {:?}",
                        origins[row],
                        directions[row],
                    );
                }
            } else {
                found = Some(hits);
            }
        }
    }
    found.unwrap()
}

fn cast_brute(mesh: &Mesh, origins: &[Vector], directions: &[Vector]) -> Vec<Hit> {
    cast_at_each(&ready(mesh, &[]), origins, directions)
}

fn cast_at_each(caster: &RayCaster, origins: &[Vector], directions: &[Vector]) -> Vec<Hit> {
    let rays = origins.iter().zip(directions);
    rays.map(|(&origin, &direction)| cast_at_all(caster.tree(), origin, unit(direction).unwrap()))
        .collect()
}

/// A solid of each kind in turn: sphere, cylinder, cone, cut off cone, torus.
fn rounds(numbers: &mut Numbers, n: usize, size: f64, scale: f64, offset: f64) -> Vec<Round> {
    (0..n)
        .map(|i| {
            let center = numbers.vector().map(|x| x * scale + offset);
            let mut length = || size * scale * (1.1 + numbers.next());
            let [one, two, half] = [length(), length(), length()];
            let axis =
                if i % 3 == 0 { [0.0, 0.0, 1.0] } else { towards([0.0; 3], numbers.vector()) };
            let frustum = |base_radius, top_radius| Round::Frustum {
                center,
                axis,
                half,
                base_radius,
                top_radius,
            };
            match i % 5 {
                0 => Round::Sphere { center, radius: one },
                1 => frustum(one, one),
                2 => frustum(one, 0.0),
                3 => frustum(one, two),
                _ => Round::Torus { center, axis, major_radius: one + two, radius: one },
            }
        })
        .collect()
}

/// A point of a rim, of the side, or of a sphere or torus.
fn target_on(numbers: &mut Numbers, round: &Round) -> Vector {
    let across = |axis: Vector, numbers: &mut Numbers| {
        let v = numbers.vector();
        let along = v[0] * axis[0] + v[1] * axis[1] + v[2] * axis[2];
        towards([0.0; 3], std::array::from_fn(|k| v[k] - along * axis[k]))
    };
    match *round {
        Round::Sphere { center, radius } => {
            let out = towards([0.0; 3], numbers.vector());
            std::array::from_fn(|k| center[k] + radius * out[k])
        }
        Round::Frustum { center, axis, half, base_radius, top_radius } => {
            let t = match numbers.below(3) {
                0 => -1.0,
                1 => 1.0,
                _ => numbers.next(),
            };
            let radius = base_radius + f64::midpoint(t, 1.0) * (top_radius - base_radius);
            let out = across(axis, numbers);
            std::array::from_fn(|k| center[k] + t * half * axis[k] + radius * out[k])
        }
        Round::Torus { center, axis, major_radius, radius } => {
            let out = across(axis, numbers);
            let [s, c] = [numbers.next(), numbers.next()];
            let [s, c] = [s, c].map(|x| x / (s * s + c * c).sqrt());
            std::array::from_fn(|k| {
                center[k] + (major_radius + radius * c) * out[k] + radius * s * axis[k]
            })
        }
    }
}

/// A point well within.
fn within(numbers: &mut Numbers, round: &Round) -> Vector {
    match *round {
        Round::Sphere { center, .. } => center,
        Round::Frustum { center, axis, half, .. } => {
            let t = 0.9 * numbers.next();
            std::array::from_fn(|k| center[k] + t * half * axis[k])
        }
        Round::Torus { center, axis, major_radius, .. } => target_on(
            numbers,
            &Round::Frustum {
                center,
                axis,
                half: 0.0,
                base_radius: major_radius,
                top_radius: major_radius,
            },
        ),
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn all_ways_find_round_solids_beside_triangles(
        seed in any::<u64>(),
        n in 0_usize..200,
        n_rounds in 1_usize..120,
        size in prop::sample::select(vec![0.5, 0.05, 1e-4]),
        scale in prop::sample::select(vec![1e-3, 1.0, 1e3]),
        offset in prop::sample::select(vec![0.0, 1.0]),
        distance in prop::sample::select(vec![0.0, 0.5, 5.0, 1e3, 1e8, 1e20]),
        shared in any::<bool>(),
    ) {
        let numbers = &mut Numbers(seed);
        let mesh = soup(numbers, n, size, scale, offset);
        let rounds = rounds(numbers, n_rounds, size, scale, offset);
        let one = numbers.vector();
        let (origins, directions): (Vec<Vector>, Vec<Vector>) = (0..160)
            .map(|i| {
                let place = if shared { one } else { numbers.vector() };
                let origin = place.map(|x| (x * distance) * scale + offset);
                let end = if n > 0 && i % 2 == 0 {
                    target(numbers, &mesh)
                } else {
                    let round = &rounds[numbers.below(n_rounds)];
                    target_on(numbers, round)
                };
                let mut direction = towards(origin, end);
                if i % 9 == 0 {
                    let axis = numbers.below(3);
                    direction = [0.0, -0.0, 0.0];
                    direction[axis] = numbers.next().signum();
                }
                (origin, direction)
            })
            .unzip();
        let brute = cast_at_each(&ready(&mesh, &rounds), &origins, &directions);
        let hits = cast_on_all(ready(&mesh, &rounds), &origins, &directions);
        prop_assert_eq!(hits, brute);
    }

    #[test]
    fn nothing_leaks_from_round_solids(
        seed in any::<u64>(),
        size in prop::sample::select(vec![0.5, 0.05]),
        scale in prop::sample::select(vec![1e-3, 1.0, 1e3]),
        offset in prop::sample::select(vec![0.0, 1.0, 1e3]),
    ) {
        let numbers = &mut Numbers(seed);
        for round in rounds(numbers, 10, size, scale, offset) {
            let origin = within(numbers, &round);
            let directions: Vec<Vector> =
                (0..200).map(|_| towards(origin, target_on(numbers, &round))).collect();
            let caster = ready(&(vec![], vec![]), &[round]);
            let hits = cast_on_all(caster, &vec![origin; directions.len()], &directions);
            prop_assert!(hits.iter().all(|hit| hit.triangle == 0), "{:?}", round);
        }
    }

    #[test]
    fn all_ways_find_what_all_triangles_say(
        seed in any::<u64>(),
        n in 1_usize..400,
        size in prop::sample::select(vec![1.0, 0.1, 1e-3, 1e-7]),
        scale in prop::sample::select(vec![1e-4, 1.0, 1e3, 1e60, 1e-60]),
        offset in prop::sample::select(vec![0.0, 1.0, 1e6]),
        distance in prop::sample::select(vec![0.0, 0.5, 5.0, 1e3, 1e8, 1e12, 1e20]),
        shared in any::<bool>(),
    ) {
        let numbers = &mut Numbers(seed);
        // Below, neighbouring float64 would be farther apart than the triangles are wide.
        prop_assume!(offset * 1e-9 < scale * size);
        let mesh = soup(numbers, n, size, scale, offset);
        let one = numbers.vector();
        let (origins, directions): (Vec<Vector>, Vec<Vector>) = (0..160)
            .map(|i| {
                let place = if shared { one } else { numbers.vector() };
                let origin = place.map(|x| (x * distance) * scale + offset);
                let mut direction = towards(origin, target(numbers, &mesh));
                if i % 7 == 0 {
                    direction[numbers.below(3)] = 0.0;
                }
                if i % 9 == 0 {
                    let axis = numbers.below(3);
                    direction = [0.0, -0.0, 0.0];
                    direction[axis] = numbers.next().signum();
                }
                if direction == [0.0; 3] {
                    direction[1] = 1.0;
                }
                (origin, direction)
            })
            .unzip();
        let hits = cast_everywhere(&mesh, &origins, &directions);
        prop_assert_eq!(hits, cast_brute(&mesh, &origins, &directions));
    }

    #[test]
    fn rays_along_surfaces_find_the_same_on_all_ways(seed in any::<u64>(), n in 1_usize..60) {
        let numbers = &mut Numbers(seed);
        let mesh = soup(numbers, n, 0.5, 1.0, 0.0);
        let (origins, directions): (Vec<Vector>, Vec<Vector>) = (0..160)
            .map(|_| {
                let [a, b, c] = mesh.1[numbers.below(n)].map(|i| mesh.0[i as usize]);
                let [s, t] = [numbers.next(), numbers.next()];
                let slope = numbers.next() * 10.0_f64.powi(-(numbers.below(18) as i32));
                let along = |s: f64, t: f64| -> Vector {
                    std::array::from_fn(|k| a[k] + s * (b[k] - a[k]) + t * (c[k] - a[k]))
                };
                let off = numbers.vector();
                let origin = along(2.0 * s, 2.0 * t);
                let end = along(t, s);
                let direction = towards(origin, std::array::from_fn(|k| end[k] + slope * off[k]));
                (origin, direction)
            })
            .unzip();
        let hits = cast_everywhere(&mesh, &origins, &directions);
        prop_assert_eq!(hits, cast_brute(&mesh, &origins, &directions));
    }

    #[test]
    fn nothing_leaks_from_a_sphere(
        seed in any::<u64>(),
        n in 3_usize..12,
        squash in prop::sample::select(vec![1.0, 0.05]),
        scale in prop::sample::select(vec![1e-4, 1.0, 1e3]),
        offset in prop::sample::select(vec![0.0, 1e3, 1e6]),
    ) {
        let numbers = &mut Numbers(seed);
        let mesh = sphere(n, squash, scale, offset);
        let inside = numbers.vector();
        let origin: Vector = std::array::from_fn(|k| {
            0.4 * inside[k] * scale * if k == 2 { squash } else { 1.0 } + offset
        });
        let directions: Vec<Vector> =
            (0..400).map(|_| towards(origin, target(numbers, &mesh))).collect();
        let hits = cast_everywhere(&mesh, &vec![origin; directions.len()], &directions);
        prop_assert!(hits.iter().all(|hit| hit.triangle >= 0));
    }
}

#[test]
fn equal_triangles_go_to_the_first_on_all_ways() {
    let numbers = &mut Numbers(1);
    let (vertices, triangles) = sphere(6, 1.0, 1.0, 0.0);
    let n = triangles.len() as i64;
    let mesh = (vertices, triangles.iter().chain(&triangles).copied().collect::<Vec<_>>());
    let directions: Vec<Vector> =
        (0..320).map(|_| towards([0.0; 3], target(numbers, &mesh))).collect();
    let hits = cast_everywhere(&mesh, &vec![[0.0; 3]; 320], &directions);
    assert!(hits.iter().all(|hit| (0..n).contains(&hit.triangle)));
    assert_eq!(hits, cast_brute(&mesh, &vec![[0.0; 3]; 320], &directions));
}

#[test]
fn triangles_on_one_spot_do_not_make_the_tree_deep() {
    let numbers = &mut Numbers(2);
    let (mut vertices, _) = soup(numbers, 1, 1.0, 1.0, 0.0);
    // Powers of two: each cut leaves one triangle on its far side.
    for i in 0..1000 {
        let x = 2.0_f64.powi(-i);
        vertices.extend([[x, 0.0, 0.0], [x, x, 0.0], [x, 0.0, x]]);
    }
    let mut triangles: Vec<[i64; 3]> = (0..1001).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    triangles.extend(vec![[0, 1, 2]; 4_000]);
    let mesh = (vertices, triangles);
    let origins: Vec<Vector> = (0..64).map(|_| numbers.vector()).collect();
    let directions: Vec<Vector> =
        origins.iter().map(|&origin| towards(origin, target(numbers, &mesh))).collect();
    let hits = cast_everywhere(&mesh, &origins, &directions);
    assert_eq!(hits, cast_brute(&mesh, &origins, &directions));
}
