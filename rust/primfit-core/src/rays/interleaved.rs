//! Sixteen rays in flight: while one waits for memory, the others go on.

#![allow(clippy::inline_always)]

use super::caster::{Hit, cast_at_all};
use super::lanes::Isa;
use super::leaf::candidates;
use super::ray::{Approach, Ray};
use super::tree::{LEAF, Tree};
use super::triangle::ShearedRay;
use super::walk::Walk;
use crate::Vector;

/// Rays in flight.
const IN_FLIGHT: usize = 16;

/// A ray on its way, and what it does next; the memory for that has been asked for.
pub struct Flight {
    pub walk: Walk,
    step: Step,
}

#[derive(Clone, Copy)]
enum Step {
    Child(u32),
    /// The first triangle of a block, and its candidates.
    Decide(u32, u32),
    Done,
}

impl Flight {
    pub fn idle() -> Self {
        Self { walk: Walk::idle(), step: Step::Done }
    }

    /// Starts another ray at a child.
    #[inline(always)]
    pub fn restart(&mut self, tree: &Tree, ray: Ray, exact: ShearedRay, hit: Hit, child: u32) {
        self.walk.restart(ray, exact, hit);
        prefetch_child(tree, child);
        self.step = Step::Child(child);
    }

    /// Takes a step; whether there are more.
    #[inline(always)]
    fn advance<I: Isa>(&mut self, tree: &Tree) -> bool {
        let walk = &mut self.walk;
        let next = match self.step {
            Step::Done => return false,
            Step::Child(child) if child & LEAF == 0 => walk.enter::<I>(&tree.nodes[child as usize]),
            Step::Child(leaf) => {
                let block = &tree.blocks[(leaf ^ LEAF) as usize];
                let mask = candidates::<I>(block, &walk.ray);
                if mask != 0 {
                    let triangle = block.first + mask.trailing_zeros();
                    prefetch(&tree.exact[triangle as usize]);
                    self.step = Step::Decide(block.first, mask);
                    return true;
                }
                walk.pop()
            }
            Step::Decide(first, mask) => walk.decide(tree, first, mask),
        };
        let Some(child) = next else {
            self.step = Step::Done;
            return false;
        };
        prefetch_child(tree, child);
        self.step = Step::Child(child);
        true
    }
}

/// All steps of some rays.
#[inline(always)]
pub fn finish<I: Isa>(tree: &Tree, flights: &mut [Flight]) {
    let mut goes_on = true;
    while goes_on {
        goes_on = false;
        for flight in &mut *flights {
            goes_on |= flight.advance::<I>(tree);
        }
    }
}

/// Casts all rays.
#[inline(always)]
pub fn cast<I: Isa>(tree: &Tree, origins: &[Vector], directions: &[Vector], hits: &mut [Hit]) {
    let mut waiting = 0;
    let mut flights: Vec<Flight> = (0..IN_FLIGHT).map(|_| Flight::idle()).collect();
    let mut rows = [usize::MAX; IN_FLIGHT];
    let mut in_flight = IN_FLIGHT;
    while in_flight > 0 {
        for (flight, row) in flights.iter_mut().zip(&mut rows) {
            if flight.advance::<I>(tree) {
                continue;
            }
            if let Some(hit) = hits.get_mut(*row) {
                *hit = flight.walk.hit;
            }
            *row = usize::MAX;
            if let Some((next, ray)) = next(tree, origins, directions, hits, &mut waiting) {
                *row = next;
                let exact = ShearedRay::new(origins[next], directions[next]);
                flight.restart(tree, ray, exact, Hit::NONE, 0);
            }
        }
        if waiting == origins.len() {
            in_flight = rows.iter().filter(|row| **row != usize::MAX).count();
        }
    }
}

/// Asks for the memory of a child.
#[inline(always)]
pub fn prefetch_child(tree: &Tree, child: u32) {
    if child & LEAF == 0 {
        prefetch(&tree.nodes[child as usize]);
    } else {
        prefetch(&tree.blocks[(child ^ LEAF) as usize]);
    }
}

/// The next ray that enters the scene.
#[inline(always)]
fn next(
    tree: &Tree,
    origins: &[Vector],
    directions: &[Vector],
    hits: &mut [Hit],
    waiting: &mut usize,
) -> Option<(usize, Ray)> {
    while *waiting < origins.len() {
        let row = *waiting;
        *waiting += 1;
        match Ray::approach(origins[row], directions[row], &tree.frame) {
            Approach::Enters(ray) => return Some((row, ray)),
            Approach::Passes => {}
            Approach::Unclear => hits[row] = cast_at_all(tree, origins[row], directions[row]),
        }
    }
    None
}

/// Asks for the memory of something that is needed soon.
#[inline(always)]
fn prefetch<T>(item: &T) {
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        let start = std::ptr::from_ref(item).cast::<i8>();
        for offset in (0..size_of::<T>()).step_by(64) {
            // SAFETY: a prefetch reads nothing, and the address is within the item.
            unsafe { _mm_prefetch::<_MM_HINT_T0>(start.add(offset)) };
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = item;
}
