//! Sixteen rays made ready for the tree at once.

#![allow(clippy::inline_always)]
// Lazy operators would be branches; lanes are counted, so that the compiler sees whole vectors.
#![allow(clippy::needless_bitwise_bool, clippy::needless_range_loop)]

use super::query::{Query, is_near_unit, is_unit};
use super::ray::{FAR, Ray, STEEPEST, Start};
use super::tiles::RAYS;
use super::tree::Frame;
use super::triangle::ShearedRay;
use crate::Vector;
use crate::lanes::{Isa, Lanes, lane, splat};

pub type Floats = [f32; RAYS];
pub type Doubles = [f64; RAYS];

/// Sixteen rays by axis.
pub struct Bundle {
    /// Unit directions.
    pub exact: [Doubles; 3],
    /// The inverses of their largest components without sign.
    shrink: Doubles,
    /// From ranges to positions.
    pub scales: Doubles,
    origins: [Floats; 3],
    reaches: Floats,
    /// Scaled to a largest component of 1, and what [`Ray`] needs of them.
    pub directions: [Floats; 3],
    pub inverses: [Floats; 3],
    pub near: [Floats; 3],
    pub far: [Floats; 3],
}

impl Bundle {
    pub fn new() -> Self {
        Self {
            exact: [[0.0; RAYS]; 3],
            shrink: [0.0; RAYS],
            scales: [0.0; RAYS],
            origins: [[0.0; RAYS]; 3],
            reaches: [0.0; RAYS],
            directions: [[0.0; RAYS]; 3],
            inverses: [[0.0; RAYS]; 3],
            near: [[0.0; RAYS]; 3],
            far: [[0.0; RAYS]; 3],
        }
    }

    /// Takes the unit directions of some rays; whether all have one.
    #[inline(always)]
    pub fn aim<Q: Query>(&mut self, query: &Q, rows: [u32; RAYS]) -> bool {
        let [x, y, z] = query.directions(rows);
        let mut squares = [0.0; RAYS];
        let mut are_units = true;
        for i in 0..RAYS {
            squares[i] = x[i] * x[i] + y[i] * y[i] + z[i] * z[i];
            are_units &= is_unit(squares[i]);
        }
        self.exact = [x, y, z];
        are_units || self.normalize(squares) || self.aim_anew(query, rows)
    }

    /// Gives directions unit length; whether all were near it.
    #[inline(always)]
    fn normalize(&mut self, squares: Doubles) -> bool {
        let mut scales = [0.0; RAYS];
        for i in 0..RAYS {
            scales[i] = 1.0 / squares[i].sqrt();
        }
        let mut are_near = true;
        for i in 0..RAYS {
            scales[i] = if is_unit(squares[i]) { 1.0 } else { scales[i] };
            are_near &= is_near_unit(squares[i]);
        }
        for k in 0..3 {
            for i in 0..RAYS {
                self.exact[k][i] *= scales[i];
            }
        }
        are_near
    }

    /// The same for rays of any length.
    #[cold]
    fn aim_anew<Q: Query>(&mut self, query: &Q, rows: [u32; RAYS]) -> bool {
        for i in 0..RAYS {
            let Some(direction) = query.unit(rows[i] as usize) else { return false };
            for k in 0..3 {
                self.exact[k][i] = direction[k];
            }
        }
        true
    }

    /// Places rays that begin at one origin.
    #[inline(always)]
    pub fn place_together<I: Isa>(&mut self, start: Start, frame: &Frame) {
        self.place::<I>(splat(start.origin), I::Sixteen::splat(start.reach), frame);
    }

    /// Places rays at their origins; a bit for each that is far.
    #[inline(always)]
    pub fn place_each<I: Isa>(&mut self, origins: &[Doubles; 3], frame: &Frame) -> u32 {
        let mut placed = [[0.0; RAYS]; 3];
        let mut distances = [0.0_f64; RAYS];
        for k in 0..3 {
            for i in 0..RAYS {
                placed[k][i] = (origins[k][i] - frame.center[k]) * frame.scale;
                let distance = placed[k][i].abs();
                distances[i] = if distance > distances[i] { distance } else { distances[i] };
            }
        }
        let mut far = 0;
        for i in 0..RAYS {
            far |= u32::from(distances[i] > FAR) << i;
        }
        let [x, y, z] = &placed;
        let reach = I::Sixteen::narrow(&distances) + I::Sixteen::splat(1.0);
        let origins = [I::Sixteen::narrow(x), I::Sixteen::narrow(y), I::Sixteen::narrow(z)];
        for k in 0..3 {
            self.origins[k] = origins[k].store();
        }
        self.reaches = reach.store();
        self.place::<I>(origins, reach, frame);
        far
    }

    #[inline(always)]
    fn place<I: Isa>(&mut self, origins: [I::Sixteen; 3], reach: I::Sixteen, frame: &Frame) {
        let [x, y, z] = &self.exact;
        for i in 0..RAYS {
            let largest = x[i].abs().max(y[i].abs()).max(z[i].abs());
            self.scales[i] = largest * frame.scale;
            self.shrink[i] = 1.0 / largest;
        }
        let one = I::Sixteen::splat(1.0);
        let slack = I::Sixteen::splat(Start::SLACK) * reach;
        for k in 0..3 {
            let mut scaled = self.exact[k];
            for i in 0..RAYS {
                scaled[i] *= self.shrink[i];
            }
            let direction = I::Sixteen::narrow(&scaled);
            let direction = direction.abs().max(I::Sixteen::splat(STEEPEST)).flip(direction);
            let inverse = one / direction;
            let place = I::Sixteen::splat(0.0) - origins[k] * inverse;
            let slack = slack * inverse.abs();
            self.directions[k] = direction.store();
            self.inverses[k] = inverse.store();
            self.near[k] = (place - slack).store();
            self.far[k] = (place + slack).store();
        }
    }

    /// One of the rays from `start`.
    #[inline(always)]
    pub fn ray(&self, i: usize, start: Start, limit: f32) -> Ray {
        Ray::ready(
            start,
            lane(&self.directions, i),
            lane(&self.inverses, i),
            [lane(&self.near, i), lane(&self.far, i)],
            limit,
            self.scales[i],
        )
    }

    /// One of the rays from its own origin.
    #[inline(always)]
    pub fn own_ray(&self, i: usize) -> Ray {
        let (origin, reach) = (lane(&self.origins, i), self.reaches[i]);
        let start = Start { origin, reach, is_far: false };
        self.ray(i, start, start.limit())
    }

    #[inline(always)]
    pub fn sheared(&self, i: usize, origin: Vector) -> ShearedRay {
        ShearedRay::with_inverse(origin, lane(&self.exact, i), self.shrink[i])
    }

    /// The axes of the first ray, when it shares them with all, and the shears of all for them.
    #[inline(always)]
    pub fn shear(&self) -> (Option<[usize; 3]>, [Doubles; 3]) {
        let [kx, ky, kz] = ShearedRay::axes_of(lane(&self.exact, 0));
        let [dx, dy, dz] = [kx, ky, kz].map(|k| &self.exact[k]);
        let mut shears = [[0.0; RAYS]; 3];
        let mut agree = true;
        for i in 0..RAYS {
            let (x, y, z) = (dx[i].abs(), dy[i].abs(), dz[i].abs());
            // Ties are left to the general way.
            agree &= (z > x) & (z > y) & ((dz[i] < 0.0) == (dz[0] < 0.0));
            let inverse = self.shrink[i].copysign(dz[i]);
            shears[0][i] = dx[i] * inverse;
            shears[1][i] = dy[i] * inverse;
            shears[2][i] = inverse;
        }
        (agree.then_some([kx, ky, kz]), shears)
    }
}
