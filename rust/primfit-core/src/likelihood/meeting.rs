//! Where beams meet the walls of prisms, whichever of the two there are several of.

use super::ellipse::Ellipse;
use crate::lanes::Lanes;

/// Precision of the kernels: twice as many numbers a register as in double precision, and an error
/// of a ten-millionth of the sensor's reach, since they are taken from the middle of the beams.
pub(crate) type Real = f32;

/// A number for all lanes, or one for each.
pub(crate) trait Spread<L> {
    fn lanes(&self) -> L;
}

#[allow(clippy::inline_always)]
impl<L: Lanes> Spread<L> for Real {
    #[inline(always)]
    fn lanes(&self) -> L {
        L::splat(*self)
    }
}

#[allow(clippy::inline_always)]
impl<const N: usize, L: Lanes<Array = [Real; N]>> Spread<L> for [Real; N] {
    #[inline(always)]
    fn lanes(&self) -> L {
        L::load(self)
    }
}

/// A beam, or several by coordinate.
///
/// The moments are those of the level lines along which the beams run: `across` tells on which side
/// of a corner they pass, `before` where they are next to it.
#[derive(Clone, Copy)]
pub(crate) struct Beam<T> {
    pub z: T,
    pub uz: T,
    pub range: T,
    pub background: T,
    pub precision: T,
    /// Most that a beam costs where a surface is in range, and what it costs where none is.
    pub most: T,
    pub nothing: T,
    /// Lowest and highest true range that gives a return.
    pub low: T,
    pub high: T,
    pub ux: T,
    pub uy: T,
    pub across: T,
    pub before: T,
    pub level: T,
}

/// Where beams pass a corner: on which side, and how far along they come nearest.
#[derive(Clone, Copy)]
pub(crate) struct Passage<L> {
    pub side: L,
    pub depth: L,
}

/// An upright prism relative to the middle of the beams, or several.
pub(crate) struct Walls<T> {
    pub corners: Vec<[T; 2]>,
    /// What there is instead of corners.
    pub ellipse: Option<Ellipse<T>>,
    pub bottom: T,
    pub top: T,
    /// Whether there is no top face.
    pub is_open: bool,
}

#[allow(clippy::inline_always)]
impl<L: Lanes> Passage<L> {
    /// Negative where a beam passes between two corners.
    #[inline(always)]
    pub fn is_between(self, next: Self) -> L {
        self.side.flip(next.side)
    }

    /// What share of the way to the second corner a beam passes at, and how far along it that is.
    #[inline(always)]
    pub fn crossing(self, next: Self) -> (L, L) {
        let share = self.side / (self.side - next.side);
        (share, self.depth + share * (next.depth - self.depth))
    }
}

// Parts of loops that are compiled for several instruction sets.
#[allow(clippy::inline_always)]
impl<T> Beam<T> {
    #[inline(always)]
    pub fn pass<L: Lanes, U: Spread<L>>(&self, corner: &[U; 2]) -> Passage<L>
    where
        T: Spread<L>,
    {
        Passage { side: self.side(corner), depth: self.depth(corner) }
    }

    #[inline(always)]
    fn side<L: Lanes, U: Spread<L>>(&self, [x, y]: &[U; 2]) -> L
    where
        T: Spread<L>,
    {
        let (x, y): (L, L) = (x.lanes(), y.lanes());
        x * self.uy.lanes() - y * self.ux.lanes() - self.across.lanes()
    }

    #[inline(always)]
    fn depth<L: Lanes, U: Spread<L>>(&self, [x, y]: &[U; 2]) -> L
    where
        T: Spread<L>,
    {
        let (x, y): (L, L) = (x.lanes(), y.lanes());
        (x * self.ux.lanes() + y * self.uy.lanes() - self.before.lanes()) * self.level.lanes()
    }

    /// Range of what each beam meets first: walls from both sides, the top from above, or what is
    /// at `limit`.
    #[inline(always)]
    pub fn meet<L: Lanes, U: Spread<L>>(&self, walls: &Walls<U>, limit: L) -> L
    where
        T: Spread<L>,
    {
        if let Some(ellipse) = &walls.ellipse {
            return self.meet_ellipse(ellipse, walls, limit);
        }
        let (zero, one, never) = (L::splat(0.0), L::splat(1.0), L::splat(Real::INFINITY));
        let (bottom, top): (L, L) = (walls.bottom.lanes(), walls.top.lanes());
        let (z, uz): (L, L) = (self.z.lanes(), self.uz.lanes());
        let all = zero.le(zero);
        let is_over = !walls.is_open && (z.le(top) | zero.le(uz)) != all;
        let descent = if is_over { (top - z) / uz } else { never };
        // Negative after an odd number of walls beyond the height of the top.
        let mut beyond = one;
        let mut nearest = limit;
        let mut before = &walls.corners[walls.corners.len() - 1];
        let mut last: L = self.side(before);
        for corner in &walls.corners {
            let next: L = self.side(corner);
            let is_between = last.flip(next);
            if is_between.any_negative() {
                let start = Passage { side: last, depth: self.depth(before) };
                let end = Passage { side: next, depth: self.depth(corner) };
                let (_, range) = start.crossing(end);
                let height = z + range * uz;
                let met = height.where_le(top, range, never);
                let met = bottom.where_le(height, met, never);
                let met = zero.where_le(range, met, never);
                nearest = nearest.min(is_between.where_negative(met, never));
                if is_over {
                    let side = descent.where_le(range, zero - one, one);
                    beyond = beyond.flip(is_between.where_negative(side, one));
                }
            }
            (last, before) = (next, corner);
        }
        if is_over {
            let met = beyond.where_negative(descent, never);
            let met = zero.where_le(uz, never, met);
            nearest = nearest.min(z.where_le(top, never, met));
        }
        nearest
    }

    /// Cost of beams that should meet a surface at `expected`, those outside the limits none.
    #[inline(always)]
    pub fn costs<L: Lanes>(&self, expected: L) -> L
    where
        T: Spread<L>,
    {
        let residual = self.residuals(expected);
        let explained = (L::splat(0.5) * residual * residual).min(self.most.lanes());
        self.within(expected, explained, self.nothing.lanes())
    }

    /// What is `inside` where a range gives a return, and `outside` elsewhere.
    #[inline(always)]
    pub fn within<L: Lanes>(&self, range: L, inside: L, outside: L) -> L
    where
        T: Spread<L>,
    {
        let low: L = self.low.lanes();
        let inside = low.where_le(range, inside, outside);
        range.where_le(self.high.lanes(), inside, outside)
    }

    /// By how many standard deviations ranges exceed what is expected.
    #[inline(always)]
    pub fn residuals<L: Lanes>(&self, expected: L) -> L
    where
        T: Spread<L>,
    {
        (self.range.lanes() - expected) * self.precision.lanes()
    }
}

/// What bounds the ranges at which beams meet walls.
pub(super) struct Edges<L> {
    z: L,
    uz: L,
    top: L,
    top_slack: L,
    bottom: L,
    background: L,
    low: L,
    high: L,
}

#[allow(clippy::inline_always)]
impl<L: Lanes> Edges<L> {
    /// Of a block of beams before walls whose top may be `top_slack` higher or lower.
    #[inline(always)]
    pub fn of<T: Spread<L>>(block: &Beam<T>, walls: &Walls<Real>, top_slack: Real) -> Self {
        Self {
            z: block.z.lanes(),
            uz: block.uz.lanes(),
            top: L::splat(walls.top),
            top_slack: L::splat(top_slack),
            bottom: L::splat(walls.bottom),
            background: block.background.lanes(),
            low: block.low.lanes(),
            high: block.high.lanes(),
        }
    }

    /// A bit for each beam that may meet something else when its range changes by `slide`.
    #[inline(always)]
    pub fn may_change(&self, range: L, slide: L) -> u32 {
        let height = self.z + range * self.uz;
        let rise = slide * self.uz.abs();
        let at_top = (height - self.top).abs().le(self.top_slack + rise);
        let at_bottom = (height - self.bottom).abs().le(rise);
        let at_end = (range - self.background).abs().le(slide)
            | (range - self.low).abs().le(slide)
            | (range - self.high).abs().le(slide)
            | range.abs().le(slide);
        let reaches = range.le(self.background + slide) & (L::splat(0.0) - slide).le(range);
        reaches & (at_top | at_bottom | at_end)
    }
}
