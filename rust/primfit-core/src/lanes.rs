//! Eight and sixteen float32 numbers at once, on whatever the processor offers.
//!
//! Code generic over [`Isa`] is compiled once for each instruction set, behind functions that
//! enable it; all that is called there must be inlined, so there are no closures over lanes. The
//! lanes are the same to the bit on all sets, but for `mul_add`, so what that computes may only
//! choose what is then decided in float64.

#![allow(clippy::inline_always)]

#[cfg(target_arch = "x86_64")]
mod x86;

use crate::instructions::Scalar;
use std::ops::{Add, Div, Mul, Sub};

/// Some float32 numbers side by side.
pub trait Lanes:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self>
{
    type Array: Copy;
    type Doubles;

    fn splat(value: f32) -> Self;
    fn load(array: &Self::Array) -> Self;
    /// The nearest numbers to some in float64.
    fn narrow(doubles: &Self::Doubles) -> Self;
    fn store(self) -> Self::Array;
    /// `self * factor + term`, rounded once where the processor can.
    fn mul_add(self, factor: Self, term: Self) -> Self;
    fn min(self, other: Self) -> Self;
    fn max(self, other: Self) -> Self;
    fn abs(self) -> Self;
    fn sqrt(self) -> Self;
    /// `self`, negated where `sign` is negative.
    fn flip(self, sign: Self) -> Self;
    /// A bit for each lane that is not greater than that of `other`.
    fn le(self, other: Self) -> u32;
    /// `yes` where a lane is not greater than that of `other`, else `no`.
    fn where_le(self, other: Self, yes: Self, no: Self) -> Self;
    /// `yes` where the sign of a lane is negative, -0 too, else `no`.
    fn where_negative(self, yes: Self, no: Self) -> Self;
    /// Whether the sign of some lane is negative.
    fn any_negative(self) -> bool;
    /// The greatest of the lanes.
    fn greatest(self) -> f32;
    /// The least of the lanes.
    #[inline(always)]
    fn least(self) -> f32 {
        -(Self::splat(0.0) - self).greatest()
    }
}

/// Two halves of four numbers.
pub trait Eight: Lanes<Array = [f32; 8]> {
    fn halves_swapped(self) -> Self;
    /// Whole numbers, rounded towards zero; what an `i32` does not hold may become any of them.
    fn truncated(self) -> [i32; 8];
}

/// A number on each axis.
#[inline(always)]
pub fn splat<L: Lanes>(vector: [f32; 3]) -> [L; 3] {
    [L::splat(vector[0]), L::splat(vector[1]), L::splat(vector[2])]
}

#[inline(always)]
pub fn load<L: Lanes>(rows: &[L::Array; 3]) -> [L; 3] {
    [L::load(&rows[0]), L::load(&rows[1]), L::load(&rows[2])]
}

#[inline(always)]
pub fn store<L: Lanes>(vectors: [L; 3]) -> [L::Array; 3] {
    [vectors[0].store(), vectors[1].store(), vectors[2].store()]
}

#[inline(always)]
pub fn subtract<L: Lanes>(a: [L; 3], b: [L; 3]) -> [L; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[inline(always)]
pub fn cross<L: Lanes>(a: [L; 3], b: [L; 3]) -> [L; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[inline(always)]
pub fn dot<L: Lanes>(a: [L; 3], b: [L; 3]) -> L {
    a[0].mul_add(b[0], a[1].mul_add(b[1], a[2] * b[2]))
}

/// The component of each axis in one lane.
#[inline(always)]
pub fn lane<T: Copy, const N: usize>(rows: &[[T; N]; 3], i: usize) -> [T; 3] {
    [rows[0][i], rows[1][i], rows[2][i]]
}

/// The lanes of an instruction set.
pub trait Isa {
    type Eight: Eight;
    type Sixteen: Lanes<Array = [f32; 16], Doubles = [f64; 16]>;
}

impl Isa for Scalar {
    type Eight = Plain<8>;
    type Sixteen = Plain<16>;
}

#[derive(Clone, Copy)]
pub struct Plain<const N: usize>([f32; N]);

impl<const N: usize> Plain<N> {
    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(f32, f32) -> f32) -> Self {
        Self(std::array::from_fn(|i| f(self.0[i], other.0[i])))
    }
}

impl<const N: usize> Add for Plain<N> {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.zip(other, |a, b| a + b)
    }
}

impl<const N: usize> Sub for Plain<N> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.zip(other, |a, b| a - b)
    }
}

impl<const N: usize> Mul for Plain<N> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.zip(other, |a, b| a * b)
    }
}

impl<const N: usize> Div for Plain<N> {
    type Output = Self;
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        self.zip(other, |a, b| a / b)
    }
}

impl<const N: usize> Lanes for Plain<N> {
    type Array = [f32; N];
    type Doubles = [f64; N];
    #[inline(always)]
    fn splat(value: f32) -> Self {
        Self([value; N])
    }
    #[inline(always)]
    fn load(array: &[f32; N]) -> Self {
        Self(*array)
    }
    #[inline(always)]
    fn narrow(doubles: &[f64; N]) -> Self {
        Self(doubles.map(|x| x as f32))
    }
    #[inline(always)]
    fn store(self) -> [f32; N] {
        self.0
    }
    #[inline(always)]
    fn mul_add(self, factor: Self, term: Self) -> Self {
        self * factor + term
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        self.zip(other, |a, b| if a < b { a } else { b })
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        self.zip(other, |a, b| if a > b { a } else { b })
    }
    #[inline(always)]
    fn abs(self) -> Self {
        Self(self.0.map(f32::abs))
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(self.0.map(f32::sqrt))
    }
    #[inline(always)]
    fn flip(self, sign: Self) -> Self {
        self.zip(sign, |a, sign| f32::from_bits(a.to_bits() ^ (sign.to_bits() & 1 << 31)))
    }
    #[inline(always)]
    fn le(self, other: Self) -> u32 {
        (0..N).fold(0, |mask, i| mask | u32::from(self.0[i] <= other.0[i]) << i)
    }
    #[inline(always)]
    fn where_le(self, other: Self, yes: Self, no: Self) -> Self {
        Self(std::array::from_fn(|i| if self.0[i] <= other.0[i] { yes.0[i] } else { no.0[i] }))
    }
    #[inline(always)]
    fn where_negative(self, yes: Self, no: Self) -> Self {
        Self(std::array::from_fn(|i| if self.0[i].is_sign_negative() { yes.0[i] } else { no.0[i] }))
    }
    #[inline(always)]
    fn any_negative(self) -> bool {
        self.0.iter().any(|x| x.is_sign_negative())
    }
    #[inline(always)]
    fn greatest(self) -> f32 {
        self.0.iter().fold(f32::NEG_INFINITY, |a, &b| if a > b { a } else { b })
    }
}

impl Eight for Plain<8> {
    #[inline(always)]
    fn halves_swapped(self) -> Self {
        let [a, b, c, d, e, f, g, h] = self.0;
        Self([e, f, g, h, a, b, c, d])
    }
    #[inline(always)]
    fn truncated(self) -> [i32; 8] {
        self.0.map(|x| x as i32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::instructions::{Instructions, for_each_set};

    for_each_set! {
        fn chosen(a: &[f32; 16], b: &[f32; 16]) -> ([[f32; 16]; 3], u32) {
            type Row = <Set as Isa>::Sixteen;
            let (a, b) = (Row::load(a), Row::load(b));
            let (yes, no) = (Row::splat(1.0), Row::splat(2.0));
            let rows = [a.where_le(b, yes, no), a.where_negative(yes, no), a.flip(b)];
            (rows.map(Row::store), a.le(b))
        }
    }

    for_each_set! {
        fn any_negative(a: &[f32; 16]) -> bool {
            <Set as Isa>::Sixteen::load(a).any_negative()
        }
    }

    for_each_set! {
        fn roots(a: &[f32; 16]) -> [f32; 16] {
            <Set as Isa>::Sixteen::load(a).sqrt().store()
        }
    }

    for_each_set! {
        fn swapped_and_truncated(a: &[f32; 8]) -> ([f32; 8], [i32; 8]) {
            let a = <Set as Isa>::Eight::load(a);
            (a.halves_swapped().store(), a.truncated())
        }
    }

    #[test]
    fn roots_are_rounded_as_ieee_wants() {
        let a = std::array::from_fn(|i| (i as f32).powi(9) * 0.37);
        for set in Instructions::available() {
            assert_eq!(roots(set, &a), a.map(f32::sqrt));
        }
    }

    #[test]
    fn halves_are_swapped_and_fractions_cut_off_on_all_sets() {
        for set in Instructions::available() {
            let a = [0.0, 1.5, -1.5, 7.999, -0.4, 16.0, 2e9, -2e9];
            let (swapped, truncated) = swapped_and_truncated(set, &a);
            assert_eq!(swapped, [-0.4, 16.0, 2e9, -2e9, 0.0, 1.5, -1.5, 7.999]);
            assert_eq!(truncated, [0, 1, -1, 7, 0, 16, 2_000_000_000, -2_000_000_000]);
        }
    }

    #[test]
    fn one_negative_lane_is_seen_on_all_sets() {
        for set in Instructions::available() {
            assert!(!any_negative(set, &[0.0; 16]));
            assert!(!any_negative(set, &[f32::NAN; 16]));
            for i in 0..16 {
                for negative in [-0.0, -1.0, -f32::NAN] {
                    let mut a = [1.0; 16];
                    a[i] = negative;
                    assert!(any_negative(set, &a));
                }
            }
        }
    }

    #[test]
    fn choices_are_the_same_on_all_sets() {
        let odd = [0.0, -0.0, 1.0, -1.0, f32::NAN, -f32::NAN, f32::INFINITY, f32::NEG_INFINITY];
        let a = std::array::from_fn(|i| odd[i % 8]);
        for turn in 0..8 {
            let b = std::array::from_fn(|i| odd[(i + turn) % 8]);
            for set in Instructions::available() {
                let ([by_order, by_sign, flipped], bits) = chosen(set, &a, &b);
                for i in 0..16 {
                    let is_le = a[i] <= b[i];
                    let is_negative = a[i].is_sign_negative();
                    assert_eq!(by_order[i].to_bits(), if is_le { 1.0_f32 } else { 2.0 }.to_bits());
                    assert_eq!(bits >> i & 1 == 1, is_le);
                    assert_eq!(
                        by_sign[i].to_bits(),
                        if is_negative { 1.0_f32 } else { 2.0 }.to_bits()
                    );
                    let sign = b[i].to_bits() & 1 << 31;
                    assert_eq!(flipped[i].to_bits(), a[i].to_bits() ^ sign);
                }
            }
        }
    }
}
