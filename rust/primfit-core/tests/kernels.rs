//! Closed forms and properties of the kernels.

#![allow(clippy::unwrap_used)]

use primfit_core::{
    Error, RayCaster, Score, Vector, Workers, dbscan, fit_plane, fit_plane_to_ranges, score_planes,
};
use proptest::prelude::*;
use std::cell::Cell;

const GO_ON: fn() -> bool = || true;

fn workers(n_threads: usize) -> Workers<'static> {
    Workers::new(Some(n_threads), &GO_ON).unwrap()
}

/// A closed box as twelve triangles.
fn cuboid(low: Vector, high: Vector) -> (Vec<Vector>, Vec<[i64; 3]>) {
    let corner =
        |i: usize| std::array::from_fn(|k| if i >> (2 - k) & 1 == 1 { high[k] } else { low[k] });
    let faces =
        [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]];
    let triangles = faces.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).collect();
    ((0..8).map(corner).collect(), triangles)
}

fn unit() -> impl Strategy<Value = f64> {
    0.0..1.0
}

fn point() -> impl Strategy<Value = Vector> {
    [unit(), unit(), unit()]
}

proptest! {
    #[test]
    fn no_ray_escapes_a_closed_box(
        inside in point(),
        along in unit(),
        edge in 0_usize..12,
        scale in prop::sample::select(vec![1e-4, 1.0, 1e4]),
        offset in prop::sample::select(vec![0.0, -1e6]),
    ) {
        let low = [offset; 3];
        let high = low.map(|x| x + scale);
        let (vertices, triangles) = cuboid(low, high);
        let caster = RayCaster::new(&vertices, &triangles, &workers(1)).unwrap();
        let triangle = triangles[edge];
        let origin: Vector =
            std::array::from_fn(|k| low[k] + (0.05 + 0.9 * inside[k]) * (high[k] - low[k]));
        for side in 0..3 {
            let a = vertices[triangle[side] as usize];
            let b = vertices[triangle[(side + 1) % 3] as usize];
            let target: Vector = std::array::from_fn(|k| a[k] + along * (b[k] - a[k]));
            let direction: Vector = std::array::from_fn(|k| target[k] - origin[k]);
            let length = direction.iter().map(|x| x * x).sum::<f64>().sqrt();
            let hits = caster.cast(&[origin], &[direction], &workers(1)).unwrap();
            prop_assert!(hits.ids[0] >= 0);
            prop_assert!((hits.ranges[0] / length - 1.0).abs() < 1e-6);
        }
    }

    #[test]
    fn scores_do_not_depend_on_threads(
        points in prop::collection::vec(point(), 0..3000),
        normals in prop::collection::vec((point(), unit()), 1..40),
        threshold in prop::sample::select(vec![0.2, 1e-7]),
    ) {
        let equations: Vec<[f64; 4]> =
            normals.iter().map(|(n, d)| [n[0], n[1], n[2], -d]).collect();
        for score in [Score::Count, Score::Msac] {
            let one = score_planes(&points, None, &equations, threshold, score, &workers(1));
            let two = score_planes(&points, None, &equations, threshold, score, &workers(3));
            prop_assert_eq!(one.unwrap(), two.unwrap());
        }
    }

    #[test]
    fn clusters_do_not_depend_on_threads(
        points in prop::collection::vec(point(), 5000..9000),
        eps in prop::sample::select(vec![0.01, 0.04, 0.3]),
        min_samples in 1_usize..12,
    ) {
        let one = dbscan(&points, eps, min_samples, &workers(1));
        let three = dbscan(&points, eps, min_samples, &workers(3));
        prop_assert_eq!(one.unwrap(), three.unwrap());
    }

    #[test]
    fn clusters_are_connected_components(points in prop::collection::vec(point(), 0..60)) {
        let eps = 0.2;
        let labels = dbscan(&points, eps, 1, &workers(1)).unwrap();
        let near = |a: Vector, b: Vector| {
            (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f64>() <= eps * eps
        };
        let mut expected: Vec<i64> = vec![-1; points.len()];
        let mut n_clusters = 0;
        for start in 0..points.len() {
            if expected[start] >= 0 {
                continue;
            }
            let mut stack = vec![start];
            while let Some(i) = stack.pop() {
                if expected[i] < 0 {
                    expected[i] = n_clusters;
                    stack.extend((0..points.len()).filter(|&j| near(points[i], points[j])));
                }
            }
            n_clusters += 1;
        }
        prop_assert_eq!(labels, expected);
    }

    #[test]
    fn exact_points_fit_without_residual(
        normal in point(),
        offset in unit(),
        places in prop::collection::vec((unit(), unit()), 3..50),
    ) {
        prop_assume!(normal[2] > 0.1);
        let points: Vec<Vector> = places
            .iter()
            .map(|&(x, y)| [x, y, -(normal[0] * x + normal[1] * y + offset) / normal[2]])
            .collect();
        let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        if let Some(fit) = fit_plane(&points, &vec![1.0; points.len()], &axes) {
            prop_assert!(fit.rms < 1e-9);
        }
    }
}

#[test]
fn hits_are_those_of_parry() {
    use parry3d_f64::query::{Ray, RayCast};
    use parry3d_f64::shape::TriMesh;

    let (vertices, triangles) = cuboid([-1.0, -2.0, 0.0], [1.0, 0.5, 3.0]);
    let indices = triangles.iter().map(|triangle| triangle.map(|vertex| vertex as u32)).collect();
    let mesh = TriMesh::new(vertices.iter().map(|&vertex| vertex.into()).collect(), indices);
    let mesh = mesh.unwrap();
    let caster = RayCaster::new(&vertices, &triangles, &workers(1)).unwrap();
    let mut n_hits = 0;
    // Away from edges, through which parry's rays may leak.
    for i in 0..1000 {
        let [s, t] = [f64::from(i % 37) / 36.0, f64::from(i % 41) / 40.0];
        let origin = [4.0 * s - 2.013, 5.0 * t - 3.017, 0.9 * s + 1.1 * t - 1.0];
        let direction: Vector = [0.31 - s, 0.27 - t, s * t + 0.1];
        let hits = caster.cast(&[origin], &[direction], &workers(1)).unwrap();
        let length = direction.iter().map(|x| x * x).sum::<f64>().sqrt();
        let ray = Ray::new(origin.into(), direction.map(|x| x / length).into());
        let range = mesh.cast_local_ray(&ray, f64::MAX, false).unwrap_or(f64::INFINITY);
        let found = hits.ranges[0];
        assert!(found == range || (found - range).abs() < 1e-9, "row {i}");
        n_hits += i32::from(range.is_finite());
    }
    assert!((200..1000).contains(&n_hits));
}

#[test]
fn a_wall_seen_along_beams_is_fitted_exactly() {
    let directions: Vec<Vector> = (0..20)
        .map(|i| {
            let angle = 0.05 * f64::from(i) - 0.5;
            [angle.cos() * 0.8, angle.sin() * 0.8, 0.6]
        })
        .collect();
    let points: Vec<Vector> = directions.iter().map(|u| u.map(|c| 2.0 * c / u[0])).collect();
    let upright = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    let start = [-0.98, 0.198_997_487, 0.0, 1.9];
    let sigmas = vec![0.01; 20];
    let fit = fit_plane_to_ranges(&points, &directions, &sigmas, start, &upright).unwrap();
    for (got, expected) in fit.equation.iter().zip([-1.0, 0.0, 0.0, 2.0]) {
        assert!((got - expected).abs() < 1e-9);
    }
    assert!(fit.rms < 1e-9);
}

#[test]
fn triangles_must_name_vertices() {
    let error = RayCaster::new(&[[0.0; 3]], &[[0, 0, 1]], &workers(1)).err();
    assert_eq!(error, Some(Error::VertexOutOfRange { triangle: 0, vertex: 1, n_vertices: 1 }));
}

#[test]
fn a_caller_can_stop_between_chunks() {
    let asked = Cell::new(0);
    let go_on = || {
        asked.set(asked.get() + 1);
        asked.get() < 3
    };
    let workers = Workers::new(None, &go_on).unwrap();
    let (vertices, triangles) = cuboid([0.0; 3], [1.0; 3]);
    let caster = RayCaster::new(&vertices, &triangles, &workers).unwrap();
    let rays = vec![[0.5; 3]; 1 << 20];
    assert_eq!(caster.cast(&rays, &rays, &workers).err(), Some(Error::Stopped));
    assert_eq!(asked.get(), 3);
}

#[test]
fn a_caller_can_stop_clustering() {
    let asked = Cell::new(0);
    let go_on = || {
        asked.set(asked.get() + 1);
        false
    };
    let workers = Workers::new(None, &go_on).unwrap();
    // All are within reach of all, but no cell has enough points by itself.
    let points: Vec<Vector> = (0..400_000)
        .map(|i| [0.618_034, 0.754_878, 0.569_840].map(|step| (f64::from(i) * step).fract()))
        .collect();
    assert_eq!(dbscan(&points, 0.6, 150_000, &workers), Err(Error::Stopped));
    assert_eq!(asked.get(), 1);
}
