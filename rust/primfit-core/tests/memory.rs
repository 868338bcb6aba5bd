//! What the kernels ask for at their entry is enough for what they take.

#![allow(clippy::unwrap_used)]

use primfit_core::{
    PointTree, RayCaster, SegmentationSettings, Vector, Workers, dbscan, segment, turned,
};
use rand_xoshiro::Xoshiro256PlusPlus;
use rand_xoshiro::rand_core::{Rng, SeedableRng};
use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Bytes that are taken now, most bytes that were, and the largest part of them that was asked for
/// in one piece.
static NOW: AtomicUsize = AtomicUsize::new(0);
static PEAK: AtomicUsize = AtomicUsize::new(0);
static LARGEST: AtomicUsize = AtomicUsize::new(0);

struct Counting;

// SAFETY: the system's allocator does the work.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let now = NOW.fetch_add(layout.size(), Ordering::Relaxed) + layout.size();
        LARGEST.fetch_max(layout.size(), Ordering::Relaxed);
        PEAK.fetch_max(now, Ordering::Relaxed);
        // SAFETY: the caller keeps the promises of `GlobalAlloc`.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, place: *mut u8, layout: Layout) {
        NOW.fetch_sub(layout.size(), Ordering::Relaxed);
        // SAFETY: the caller keeps the promises of `GlobalAlloc`.
        unsafe { System.dealloc(place, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

const N: usize = 10_000;

/// Bytes that do not grow with the input: what each thread has at hand.
const FEW: usize = 1 << 18;

fn numbers(n: usize) -> Vec<f64> {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(1);
    (0..n).map(|_| random.next_u64() as f64 / u64::MAX as f64).collect()
}

/// A third of the points in a plane, the others anywhere.
fn cloud() -> Vec<Vector> {
    let mut points: Vec<Vector> = numbers(3 * N).as_chunks().0.to_vec();
    points.iter_mut().step_by(3).for_each(|point| point[2] *= 1e-3);
    points
}

/// The peak of a call beyond what was taken before, and what it asked for at once.
fn peak_of<R>(name: &str, work: impl FnOnce(&Workers) -> R) -> R {
    let workers = Workers::new(Some(2), &|| true).unwrap();
    let before = NOW.load(Ordering::Relaxed);
    PEAK.store(before, Ordering::Relaxed);
    LARGEST.store(0, Ordering::Relaxed);
    let result = work(&workers);
    let peak = PEAK.load(Ordering::Relaxed) - before;
    let asked = LARGEST.load(Ordering::Relaxed);
    assert!(peak <= asked + FEW, "{name} takes {peak} bytes, and asks for {asked}");
    result
}

static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());

#[test]
fn of_clouds() {
    let _alone = ONE_AT_A_TIME.lock();
    let points = cloud();
    let tree = peak_of("tree", |w| PointTree::within_memory(&points, w).unwrap());
    peak_of("neighbors 16", |w| tree.neighbors(&points, 16, w).unwrap());
    peak_of("normals 16", |w| tree.normals(16, w).unwrap());
    peak_of("local", |w| tree.local_planes(None, 1, w).unwrap());
    let settings = SegmentationSettings::default();
    peak_of("segment", |w| segment(&tree, None, &settings, w).unwrap());
    let sheet: Vec<Vector> = points.iter().map(|p| [p[0], p[1], p[2] * 1e-3]).collect();
    let flat = PointTree::new(&sheet);
    peak_of("segment flat", |w| segment(&flat, None, &settings, w).unwrap());
    for eps in [1e-3, 0.03, 0.1, 0.3] {
        peak_of(&format!("dbscan {eps}"), |w| dbscan(&points, eps, 10, w).unwrap());
    }
    let wide: Vec<Vector> = points.iter().map(|p| p.map(|x| x * 1e9)).collect();
    peak_of("dbscan wide", |w| dbscan(&wide, 1.0, 1, w).unwrap());
}

#[test]
fn of_rays() {
    let _alone = ONE_AT_A_TIME.lock();
    let vertices = cloud();
    let triangles: Vec<[i64; 3]> =
        (0..N as i64).map(|i| [i, (i + 1) % N as i64, (i + 2) % N as i64]).collect();
    peak_of("caster", |w| RayCaster::new(&vertices, &triangles, w).unwrap());
    let large: Vec<[i64; 3]> = triangles.iter().map(|t| t.map(|v| v * 7919 % N as i64)).collect();
    peak_of("caster of large ones", |w| RayCaster::new(&vertices, &large, w).unwrap());
    let pose = [1.0, 0.0, 0.0, 0.5, 0.0, 1.0, 0.0, 0.5, 0.0, 0.0, 1.0, 0.5, 0.0, 0.0, 0.0, 1.0];
    peak_of("turned", |w| turned(&[pose], &vertices, w).unwrap());
}
