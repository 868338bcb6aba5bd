//! Sixteen rays in flight: while one waits for memory, the others go on.

#![allow(clippy::inline_always)]

use super::bundle::Bundle;
use super::caster::Hit;
use super::leaf::candidates;
use super::query::Query;
use super::ray::Ray;
use super::supply::{Next, Supply};
use super::tree::{LEAF, ROUND_LEAF, Tree};
use super::triangle::ShearedRay;
use super::walk::Walk;
use crate::Vector;
use crate::lanes::Isa;

/// Rays in flight.
pub const IN_FLIGHT: usize = 16;

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
    pub fn restart<const ROUND: bool>(
        &mut self,
        tree: &Tree,
        (ray, exact, direction): (Ray, ShearedRay, Vector),
        hit: Hit,
        child: u32,
    ) {
        self.walk.restart::<ROUND>(ray, exact, direction, hit);
        prefetch_child::<ROUND>(tree, child);
        self.step = Step::Child(child);
    }

    /// Takes a step; whether there are more.
    #[inline(always)]
    fn advance<I: Isa, const ROUND: bool>(&mut self, tree: &Tree) -> bool {
        let walk = &mut self.walk;
        let next = match self.step {
            Step::Done => return false,
            Step::Child(child) if child & LEAF == 0 => walk.enter::<I>(&tree.nodes[child as usize]),
            Step::Child(leaf) if ROUND && leaf & ROUND_LEAF != 0 => {
                walk.meet(tree, leaf ^ (LEAF | ROUND_LEAF))
            }
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
        prefetch_child::<ROUND>(tree, child);
        self.step = Step::Child(child);
        true
    }
}

/// All steps of some rays.
#[inline(always)]
pub fn finish<I: Isa, const ROUND: bool>(tree: &Tree, flights: &mut [Flight]) {
    let mut goes_on = true;
    while goes_on {
        goes_on = false;
        for flight in &mut *flights {
            goes_on |= flight.advance::<I, ROUND>(tree);
        }
    }
}

/// Casts all rays; whether all have a direction.
#[inline(always)]
pub fn cast<I: Isa, Q: Query, const ROUND: bool>(
    tree: &Tree,
    query: &mut Q,
    bundle: &mut Bundle,
    flights: &mut [Flight; IN_FLIGHT],
) -> bool {
    let mut supply = Supply::new(bundle);
    // Of each flight, the row and the direction of its ray.
    let mut rays = [None; IN_FLIGHT];
    for flight in &mut *flights {
        flight.step = Step::Done;
    }
    loop {
        let mut goes_on = false;
        for (flight, flying) in flights.iter_mut().zip(&mut rays) {
            if flight.advance::<I, ROUND>(tree) {
                goes_on = true;
                continue;
            }
            if let Some((row, direction)) = flying.take() {
                query.answer_one(row, direction, flight.walk.hit);
            }
            match supply.next::<I, Q>(tree, query) {
                Next::Enters { row, direction, ray, exact } => {
                    flight.restart::<ROUND>(tree, (ray, exact, direction), Hit::NONE, 0);
                    *flying = Some((row, direction));
                    goes_on = true;
                }
                Next::NoDirection => return false,
                Next::NoMore => {}
            }
        }
        if !goes_on {
            return true;
        }
    }
}

/// Asks for the memory of a child.
#[inline(always)]
pub fn prefetch_child<const ROUND: bool>(tree: &Tree, child: u32) {
    if child & LEAF == 0 {
        prefetch(&tree.nodes[child as usize]);
    } else if ROUND && child & ROUND_LEAF != 0 {
        prefetch(&tree.rounds[(child ^ (LEAF | ROUND_LEAF)) as usize]);
    } else {
        prefetch(&tree.blocks[(child ^ LEAF) as usize]);
    }
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
