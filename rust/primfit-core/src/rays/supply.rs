//! Rays that go alone, one after the other, made ready by bundles.

#![allow(clippy::inline_always)]

use super::bundle::Bundle;
use super::caster::{Hit, cast_at_all};
use super::query::Query;
use super::ray::{Approach, Ray};
use super::tiles::RAYS;
use super::tree::Tree;
use super::triangle::ShearedRay;
use crate::Vector;
use crate::lanes::{Isa, lane};

/// The rays of a query by row, of which those that pass the scene are answered here.
pub struct Supply<'a> {
    bundle: &'a mut Bundle,
    row: usize,
    /// A bit for each ray of the bundle that begins far away.
    far: u32,
}

/// The next ray that enters the scene.
// It is matched at once, never kept.
#[allow(clippy::large_enum_variant)]
pub enum Next {
    Enters { row: usize, direction: Vector, ray: Ray, exact: ShearedRay },
    NoDirection,
    NoMore,
}

impl<'a> Supply<'a> {
    pub fn new(bundle: &'a mut Bundle) -> Self {
        Self { bundle, row: 0, far: 0 }
    }

    #[inline(always)]
    pub fn next<I: Isa, Q: Query>(&mut self, tree: &Tree, query: &mut Q) -> Next {
        while self.row < query.len() {
            let row = self.row;
            let i = row % RAYS;
            if i == 0 {
                let last = query.len() - 1;
                let rows = std::array::from_fn(|i| (row + i).min(last) as u32);
                if !self.bundle.aim(query, rows) {
                    return Next::NoDirection;
                }
                self.far = self.bundle.place_each::<I>(&query.origins(rows), &tree.frame);
            }
            self.row += 1;
            let (origin, direction) = (query.origin(row), lane(&self.bundle.exact, i));
            let exact = self.bundle.sheared(i, origin);
            if self.far >> i & 1 == 0 {
                return Next::Enters { row, direction, ray: self.bundle.own_ray(i), exact };
            }
            match Ray::approach(origin, direction, &tree.frame) {
                Approach::Enters(ray) => return Next::Enters { row, direction, ray, exact },
                Approach::Passes => query.answer_one(row, direction, Hit::NONE),
                Approach::Unclear => {
                    query.answer_one(row, direction, cast_at_all(tree, origin, direction));
                }
            }
        }
        Next::NoMore
    }
}
