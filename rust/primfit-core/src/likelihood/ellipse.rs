//! Where beams meet an upright elliptic cylinder, in closed form, and how that changes with it.
//!
//! A candidate tells its ellipse by the ends of its axes, in order; the centre is their mean. On the
//! outline, `center + a u + b v` with the half axes u and v and the unit vector (a, b).

use super::Candidate;
use super::beams::{Block, Row};
use super::meeting::{Beam, Edges, Real, Spread, Walls};
use crate::lanes::Lanes;

/// Sums of slopes over beams: two of first order by each half axis and three of second order, as
/// the gradient weighs them, and the upper triangle of their products.
pub(super) const N_SUMS: usize = N_SLOPES + N_SLOPES * (N_SLOPES + 1) / 2;
const N_SLOPES: usize = 5;

/// Chords shorter than twice so many standard deviations belong to beams that may as well pass by,
/// so their ranges tell no slope: a move that changes them by one sigma changes them by a quarter of
/// another through the curvature.
const GRAZING: Real = 2.0;

/// Standard deviations by which the curvature may change a range beside its slope within the slack.
const BEND: Real = 0.25;

/// An ellipse, or several, relative to the middle of the beams.
pub(crate) struct Ellipse<T> {
    center: [T; 2],
    /// Half of each axis, the second to the left of the first.
    axes: [[T; 2]; 2],
    /// Their vector product: a pi-th of the area.
    area: T,
}

impl<T> Ellipse<T> {
    /// From its centre, both half axes and their product, each by `value`.
    pub fn of(value: impl Fn(&dyn Fn(&Candidate) -> f64) -> T, [x, y]: [f64; 2]) -> Self {
        let middle = |each: &Candidate, k: usize| {
            each.footprint.iter().map(|end| end[k]).sum::<f64>() / each.footprint.len() as f64
        };
        Self {
            center: [value(&|each| middle(each, 0) - x), value(&|each| middle(each, 1) - y)],
            axes: [0, 1].map(|axis| [0, 1].map(|k| value(&|each| half(each, axis)[k]))),
            area: value(&|each| {
                let [u, v] = [half(each, 0), half(each, 1)];
                u[0] * v[1] - u[1] * v[0]
            }),
        }
    }
}

/// Half of an axis of a candidate.
fn half(candidate: &Candidate, axis: usize) -> [f64; 2] {
    [0, 1].map(|k| 0.5 * (candidate.footprint[axis][k] - candidate.footprint[axis + 2][k]))
}

/// How beams pass an ellipse, in the scale of their level lines.
#[derive(Clone, Copy)]
struct Chord<L> {
    /// Of the centre.
    side: L,
    /// Of both half axes.
    sides: [L; 2],
    /// Greatest side of the outline, from the centre.
    width: L,
    /// Side by side with the width, how much of it is beyond the beam; none for beams that pass by.
    room: L,
    /// Root of the room.
    depth: L,
    /// Range of the chord's middle, and half its length.
    middle: L,
    half: L,
}

// Parts of loops that are compiled for several instruction sets.
#[allow(clippy::inline_always)]
impl<L: Lanes> Chord<L> {
    /// Both ends with the direction of the beam there: out to in, and in to out.
    #[inline(always)]
    fn ends(&self) -> [(L, L); 2] {
        let one = L::splat(1.0);
        [(one, self.middle - self.half), (L::splat(0.0) - one, self.middle + self.half)]
    }

    /// The unit vector (a, b) of an end.
    #[inline(always)]
    fn place(&self, inwards: L) -> [L; 2] {
        let [u, v] = self.sides;
        let depth = inwards * self.depth;
        let square = self.width * self.width;
        [(depth * v - self.side * u) / square, (L::splat(0.0) - self.side * v - depth * u) / square]
    }
}

#[allow(clippy::inline_always)]
impl<T> Beam<T> {
    #[inline(always)]
    fn chord<L: Lanes, U: Spread<L>>(&self, ellipse: &Ellipse<U>) -> Chord<L>
    where
        T: Spread<L>,
    {
        let (ux, uy): (L, L) = (self.ux.lanes(), self.uy.lanes());
        let center = self.pass(&ellipse.center);
        let [u, v] = &ellipse.axes;
        let [u, v]: [[L; 2]; 2] = [u, v].map(|[x, y]| [x.lanes(), y.lanes()]);
        let sides = [u, v].map(|[x, y]| x * uy - y * ux);
        let depths = [u, v].map(|[x, y]| x * ux + y * uy);
        let square = sides[0] * sides[0] + sides[1] * sides[1];
        let width = square.sqrt();
        let room = (width - center.side) * (width + center.side);
        let depth = room.max(L::splat(0.0)).sqrt();
        let skew = sides[0] * depths[0] + sides[1] * depths[1];
        let middle = center.depth - center.side * self.level.lanes() * skew / square;
        let half = ellipse.area.lanes() * depth / square;
        Chord { side: center.side, sides, width, room, depth, middle, half }
    }

    /// [`Beam::meet`] for an ellipse.
    #[inline(always)]
    pub(super) fn meet_ellipse<L: Lanes, U: Spread<L>>(
        &self,
        ellipse: &Ellipse<U>,
        walls: &Walls<U>,
        limit: L,
    ) -> L
    where
        T: Spread<L>,
    {
        let (zero, never) = (L::splat(0.0), L::splat(Real::INFINITY));
        let chord = self.chord(ellipse);
        if chord.room.le(zero) == zero.le(zero) {
            return limit;
        }
        let (bottom, top): (L, L) = (walls.bottom.lanes(), walls.top.lanes());
        let (z, uz): (L, L) = (self.z.lanes(), self.uz.lanes());
        let mut nearest = limit;
        let [(_, entry), (_, exit)] = chord.ends();
        for range in [entry, exit] {
            let height = z + range * uz;
            let met = height.where_le(top, range, never);
            let met = bottom.where_le(height, met, never);
            let met = zero.where_le(range, met, never);
            nearest = nearest.min(chord.room.where_le(zero, never, met));
        }
        if !walls.is_open && (z.le(top) | zero.le(uz)) != zero.le(zero) {
            let descent = (top - z) / uz;
            let met = entry.where_le(descent, descent, never);
            let met = descent.where_le(exit, met, never);
            let met = chord.room.where_le(zero, never, met);
            let met = zero.where_le(uz, never, met);
            nearest = nearest.min(z.where_le(top, never, met));
        }
        nearest
    }
}

/// Adds what the beams of a block that meet the outline say of it: `precision` in sigmas a metre.
#[allow(clippy::inline_always)]
#[inline(always)]
pub(super) fn add_slopes<L: Row>(
    block: &Block,
    ellipse: &Ellipse<Real>,
    nearest: L,
    residual: L,
    precision: L,
    sums: &mut [L],
) {
    let zero = L::splat(0.0);
    let chord: Chord<L> = block.chord(ellipse);
    if chord.room.le(zero) == zero.le(zero) {
        return;
    }
    let rate = (chord.half * precision).where_le(L::splat(GRAZING), zero, precision / chord.depth);
    let rate = chord.room.where_le(zero, zero, rate);
    for (inwards, range) in chord.ends() {
        // The very steps by which the nearest was found, so it is found again.
        let met = nearest.where_le(range, rate, zero);
        let met = range.where_le(nearest, met, zero);
        let [a, b] = chord.place(inwards);
        let [a, b] = [a, b].map(|each| met.where_le(zero, zero, each));
        let rate = zero - inwards * met;
        let slopes = [a, b, a * a, a * b, b * b].map(|each| rate * each);
        let (first, products) = sums.split_at_mut(N_SLOPES);
        let mut k = 0;
        for i in 0..N_SLOPES {
            first[i] = first[i] - residual * slopes[i];
            for j in i..N_SLOPES {
                products[k] = products[k] + slopes[i] * slopes[j];
                k += 1;
            }
        }
    }
}

/// The sums as derivatives by x and y of the ends of the axes, and the rows of their matrix.
pub(super) fn assemble(candidate: &Candidate, sums: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let [u, v] = [half(candidate, 0), half(candidate, 1)];
    // The normal is a times the first of these and b times the second.
    let normals = [[v[1], -v[0]], [-u[1], u[0]]];
    let m = candidate.footprint.len();
    let mut rows = vec![[0.0; N_SLOPES]; 2 * m];
    for end in 0..m {
        let (axis, sign) = (end % 2, if end < 2 { 0.5 } else { -0.5 });
        for x in 0..2 {
            for (k, normal) in normals.iter().enumerate() {
                // An end takes the centre along by a quarter, and its own axis by a half.
                rows[2 * end + x][k] += 0.25 * normal[x];
                rows[2 * end + x][2 + axis + k] += sign * normal[x];
            }
        }
    }
    let (first, products) = sums.split_at(N_SLOPES);
    let product = |i: usize, j: usize| {
        let (i, j) = (i.min(j), i.max(j));
        products[i * (2 * N_SLOPES - 1 - i) / 2 + j]
    };
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let gradient = rows.iter().map(|row| dot(row, first)).collect();
    let matrix = rows
        .iter()
        .flat_map(|row| {
            let of_row: [f64; N_SLOPES] = std::array::from_fn(|i| {
                row.iter().enumerate().map(|(j, value)| product(i, j) * value).sum()
            });
            rows.iter().map(move |column| dot(&of_row, column))
        })
        .collect();
    (gradient, matrix)
}

/// A bit for each beam of a block that may meet something else when the ends of the axes move by
/// `slack`, or whose range then does not change as its slope tells; and for each that crosses the
/// ellipse ahead.
#[allow(clippy::inline_always)]
#[inline(always)]
pub(super) fn may_change<L: Row>(
    block: &Block,
    ellipse: &Ellipse<Real>,
    nearest: L,
    slack: Real,
    edges: &Edges<L>,
) -> (u32, u32) {
    let zero = L::splat(0.0);
    let level = L::load(&block.level);
    let chord: Chord<L> = block.chord(ellipse);
    // Between the ends of the axes, the outline moves by up to the root of two as far.
    let reach = L::splat(std::f32::consts::SQRT_2 * slack);
    let play = reach * L::load(&block.level.map(Real::sqrt));
    let crosses = !chord.room.le(zero);
    let (mut open, mut crossed) = (0, 0);
    for (inwards, range) in chord.ends() {
        let [a, b] = chord.place(inwards);
        let [u, v] = ellipse.axes.map(|axis| axis.map(L::splat));
        let normal = [a * v[1] - b * u[1], b * u[0] - a * v[0]];
        let length = (normal[0] * normal[0] + normal[1] * normal[1]).sqrt();
        let slide = reach * length / chord.depth;
        open |= crosses & edges.may_change(range, slide);
        crossed |= crosses & zero.le(range);
    }
    let [(_, entry), (_, exit)] = chord.ends();
    let reaches = entry.le(nearest + play) & (zero - play).le(exit);
    let cube = level * chord.depth * chord.depth * chord.depth;
    let bend = L::splat(0.5 * ellipse.area) * reach * reach / cube;
    open |= crosses & reaches & !(bend * L::load(&block.precision)).le(L::splat(BEND));
    // A silhouette near the beam, before what it meets.
    let off = chord.side.abs() - chord.width;
    let near = (off * off * level).le(reach * reach);
    let around = L::splat(ellipse.area) / chord.width + play;
    open |= near & (zero - around).le(chord.middle) & chord.middle.le(nearest + around + play);
    (open, crossed)
}

#[cfg(test)]
mod tests {
    use super::super::beams::{BeamBlocks, Beams, Limits, Prices};
    use super::super::expansion::expand;
    use super::super::prism_ranges;
    use super::*;

    /// Circle of radius 0.5 around (2, 0), and beams along x whose lines miss its centre by `offs`.
    fn ahead(offs: &[f64], ranges: &[f64]) -> (BeamBlocks, [[f64; 2]; 4]) {
        let origins: Vec<_> = offs.iter().map(|&y| [0.0, y, 0.5]).collect();
        let n = offs.len();
        let beams = Beams {
            origins: &origins,
            directions: &vec![[1.0, 0.0, 0.0]; n],
            ranges,
            background: &vec![f64::INFINITY; n],
            sigmas: &vec![0.01; n],
            limits: Limits::All([0.0, 9.0]),
        };
        let ends = [[2.5, 0.0], [2.0, 0.5], [1.5, 0.0], [2.0, -0.5]];
        (BeamBlocks::new(beams, Prices { outlier: 100.0, missing: 100.0 }), ends)
    }

    fn circle(footprint: &[[f64; 2]]) -> Candidate<'_> {
        Candidate { footprint, is_round: true, bottom: 0.0, top: 1.0, is_open: false }
    }

    #[test]
    fn ranges_of_a_circle() {
        let offs = [0.0, 0.3, -0.4, 0.6];
        let (beams, ends) = ahead(&offs, &[1.0; 4]);
        let met = prism_ranges(&beams, &circle(&ends));
        for (met, expected) in met.iter().zip([1.5, 1.6, 1.7, f64::INFINITY]) {
            assert!(*met == expected || (met - expected).abs() < 1e-6, "{met} {expected}");
        }
    }

    #[test]
    fn slopes_by_centre_and_radius() {
        let offs = [0.0, 0.3, -0.4];
        // Each is a standard deviation too long.
        let (beams, ends) = ahead(&offs, &[1.51, 1.61, 1.71]);
        let found = expand(&beams, &circle(&ends), 0.0, 0.0);
        assert!((found.cost - 1.5).abs() < 1e-3);
        let along = |moves: [[f64; 2]; 4]| {
            moves.as_flattened().iter().zip(&found.gradient).map(|(a, b)| a * b).sum::<f64>()
        };
        // A range changes along x by 1, along y by tan, and by -1 / cos with the radius.
        let expected = [-3.0, 0.3 / 0.4 - 0.4 / 0.3, 1.0 + 0.5 / 0.4 + 0.5 / 0.3];
        let moves =
            [[[1.0, 0.0]; 4], [[0.0, 1.0]; 4], [[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]]];
        for (moves, expected) in moves.into_iter().zip(expected) {
            assert!((0.01 * along(moves) - expected).abs() < 0.01, "{expected}");
        }
        let square: f64 =
            found.information.chunks(8).step_by(2).flat_map(|row| row.iter().step_by(2)).sum();
        assert!((square / 1e4 - 3.0).abs() < 1e-3, "{square}");
    }

    #[test]
    fn a_beam_that_may_pass_by_is_open() {
        let offs = [0.0, 0.499, 0.501, 0.7];
        let (beams, ends) = ahead(&offs, &[1.5; 4]);
        assert_eq!(expand(&beams, &circle(&ends), 0.002, 0.0).open, [1, 2]);
    }
}
