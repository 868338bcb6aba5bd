//! Lanes in the registers of x86.

#![allow(clippy::inline_always)]

use super::{Eight, Isa, Lanes};
use crate::instructions::{Avx2, Avx512};
#[allow(clippy::wildcard_imports)]
use std::arch::x86_64::*;
use std::ops::{Add, Div, Mul, Sub};

impl Isa for Avx2 {
    type Eight = Ymm;
    type Sixteen = Pair;
}

impl Isa for Avx512 {
    type Eight = Ymm;
    type Sixteen = Zmm;
}

/// Implements [`Lanes`] by instructions on one register.
macro_rules! lanes {
    ($name:ident, $register:ty, $array:ty, $doubles:ty, $splat:ident, $load:ident,
     |$wide:ident| $narrow:block, $store:ident, $add:ident, $sub:ident, $mul:ident, $div:ident,
     $mul_add:ident, $min:ident, $max:ident, $sqrt:ident,
     $and:ident, $and_not:ident, $xor:ident,
     |$a:ident, $b:ident| $le:block, |$all:ident| $greatest:block, $any:block,
     |$c:ident, $d:ident, $yes:ident, $no:ident| $where_le:block, $where_negative:block) => {
        #[derive(Clone, Copy)]
        pub struct $name($register);

        impl Add for $name {
            type Output = Self;
            #[inline(always)]
            fn add(self, other: Self) -> Self {
                // SAFETY: callers have enabled the instruction set.
                Self(unsafe { $add(self.0, other.0) })
            }
        }

        impl Sub for $name {
            type Output = Self;
            #[inline(always)]
            fn sub(self, other: Self) -> Self {
                // SAFETY: callers have enabled the instruction set.
                Self(unsafe { $sub(self.0, other.0) })
            }
        }

        impl Mul for $name {
            type Output = Self;
            #[inline(always)]
            fn mul(self, other: Self) -> Self {
                // SAFETY: callers have enabled the instruction set.
                Self(unsafe { $mul(self.0, other.0) })
            }
        }

        impl Div for $name {
            type Output = Self;
            #[inline(always)]
            fn div(self, other: Self) -> Self {
                // SAFETY: callers have enabled the instruction set.
                Self(unsafe { $div(self.0, other.0) })
            }
        }

        impl Lanes for $name {
            type Array = $array;
            type Doubles = $doubles;
            #[inline(always)]
            fn splat(value: f32) -> Self {
                // SAFETY: callers have enabled the instruction set.
                Self(unsafe { $splat(value) })
            }
            #[inline(always)]
            fn load(array: &$array) -> Self {
                // SAFETY: callers have enabled the instruction set; the array fills a
                // register.
                Self(unsafe { $load(array.as_ptr()) })
            }
            #[inline(always)]
            fn narrow(doubles: &$doubles) -> Self {
                let $wide = doubles.as_ptr();
                // SAFETY: callers have enabled the instruction set; the array fills two
                // registers.
                Self(unsafe { $narrow })
            }
            #[inline(always)]
            fn store(self) -> $array {
                let mut array = <$array>::default();
                // SAFETY: callers have enabled the instruction set; the array holds a
                // register.
                unsafe { $store(array.as_mut_ptr(), self.0) };
                array
            }
            #[inline(always)]
            fn mul_add(self, factor: Self, term: Self) -> Self {
                // SAFETY: callers have enabled the instruction set.
                Self(unsafe { $mul_add(self.0, factor.0, term.0) })
            }
            #[inline(always)]
            fn min(self, other: Self) -> Self {
                // SAFETY: callers have enabled the instruction set.
                Self(unsafe { $min(self.0, other.0) })
            }
            #[inline(always)]
            fn max(self, other: Self) -> Self {
                // SAFETY: callers have enabled the instruction set.
                Self(unsafe { $max(self.0, other.0) })
            }
            #[inline(always)]
            fn abs(self) -> Self {
                // SAFETY: callers have enabled the instruction set.
                Self(unsafe { $and_not($splat(-0.0), self.0) })
            }
            #[inline(always)]
            fn sqrt(self) -> Self {
                // SAFETY: callers have enabled the instruction set.
                Self(unsafe { $sqrt(self.0) })
            }
            #[inline(always)]
            fn flip(self, sign: Self) -> Self {
                // SAFETY: callers have enabled the instruction set.
                Self(unsafe { $xor(self.0, $and(sign.0, $splat(-0.0))) })
            }
            #[inline(always)]
            fn le(self, other: Self) -> u32 {
                let ($a, $b) = (self.0, other.0);
                // SAFETY: callers have enabled the instruction set.
                unsafe { $le }
            }
            #[inline(always)]
            fn where_le(self, other: Self, yes: Self, no: Self) -> Self {
                let ($c, $d, $yes, $no) = (self.0, other.0, yes.0, no.0);
                // SAFETY: callers have enabled the instruction set.
                Self(unsafe { $where_le })
            }
            #[inline(always)]
            fn where_negative(self, yes: Self, no: Self) -> Self {
                let ($c, $yes, $no) = (self.0, yes.0, no.0);
                // SAFETY: callers have enabled the instruction set.
                Self(unsafe { $where_negative })
            }
            #[inline(always)]
            fn any_negative(self) -> bool {
                let $all = self.0;
                // SAFETY: callers have enabled the instruction set.
                unsafe { $any }
            }
            #[inline(always)]
            fn greatest(self) -> f32 {
                let $all = self.0;
                // SAFETY: callers have enabled the instruction set.
                unsafe { $greatest }
            }
        }
    };
}

lanes!(
    Ymm,
    __m256,
    [f32; 8],
    [f64; 8],
    _mm256_set1_ps,
    _mm256_loadu_ps,
    |wide| {
        let low = _mm256_cvtpd_ps(_mm256_loadu_pd(wide));
        let high = _mm256_cvtpd_ps(_mm256_loadu_pd(wide.add(4)));
        _mm256_set_m128(high, low)
    },
    _mm256_storeu_ps,
    _mm256_add_ps,
    _mm256_sub_ps,
    _mm256_mul_ps,
    _mm256_div_ps,
    _mm256_fmadd_ps,
    _mm256_min_ps,
    _mm256_max_ps,
    _mm256_sqrt_ps,
    _mm256_and_ps,
    _mm256_andnot_ps,
    _mm256_xor_ps,
    |a, b| { _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(a, b)) as u32 },
    |a| {
        let four = _mm_max_ps(_mm256_castps256_ps128(a), _mm256_extractf128_ps::<1>(a));
        let two = _mm_max_ps(four, _mm_movehl_ps(four, four));
        _mm_cvtss_f32(_mm_max_ss(two, _mm_movehdup_ps(two)))
    },
    { _mm256_movemask_ps(a) != 0 },
    |a, b, yes, no| { _mm256_blendv_ps(no, yes, _mm256_cmp_ps::<_CMP_LE_OQ>(a, b)) },
    { _mm256_blendv_ps(no, yes, a) }
);

impl Eight for Ymm {
    #[inline(always)]
    fn halves_swapped(self) -> Self {
        // SAFETY: callers have enabled the instruction set.
        Self(unsafe { _mm256_permute2f128_ps::<1>(self.0, self.0) })
    }
    #[inline(always)]
    fn truncated(self) -> [i32; 8] {
        let mut array = [0; 8];
        // SAFETY: callers have enabled the instruction set; the array holds a register.
        unsafe { _mm256_storeu_si256(array.as_mut_ptr().cast(), _mm256_cvttps_epi32(self.0)) };
        array
    }
}

lanes!(
    Zmm,
    __m512,
    [f32; 16],
    [f64; 16],
    _mm512_set1_ps,
    _mm512_loadu_ps,
    |wide| {
        let low = _mm512_cvtpd_ps(_mm512_loadu_pd(wide));
        let high = _mm512_cvtpd_ps(_mm512_loadu_pd(wide.add(8)));
        _mm512_insertf32x8::<1>(_mm512_castps256_ps512(low), high)
    },
    _mm512_storeu_ps,
    _mm512_add_ps,
    _mm512_sub_ps,
    _mm512_mul_ps,
    _mm512_div_ps,
    _mm512_fmadd_ps,
    _mm512_min_ps,
    _mm512_max_ps,
    _mm512_sqrt_ps,
    _mm512_and_ps,
    _mm512_andnot_ps,
    _mm512_xor_ps,
    |a, b| { u32::from(_mm512_cmp_ps_mask::<_CMP_LE_OQ>(a, b)) },
    |a| { _mm512_reduce_max_ps(a) },
    { _mm512_movepi32_mask(_mm512_castps_si512(a)) != 0 },
    |a, b, yes, no| { _mm512_mask_blend_ps(_mm512_cmp_ps_mask::<_CMP_LE_OQ>(a, b), no, yes) },
    { _mm512_mask_blend_ps(_mm512_movepi32_mask(_mm512_castps_si512(a)), no, yes) }
);

/// Sixteen lanes in two registers.
#[derive(Clone, Copy)]
pub struct Pair(Ymm, Ymm);

impl Add for Pair {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self(self.0 + other.0, self.1 + other.1)
    }
}

impl Sub for Pair {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self(self.0 - other.0, self.1 - other.1)
    }
}

impl Mul for Pair {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        Self(self.0 * other.0, self.1 * other.1)
    }
}

impl Div for Pair {
    type Output = Self;
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        Self(self.0 / other.0, self.1 / other.1)
    }
}

impl Lanes for Pair {
    type Array = [f32; 16];
    type Doubles = [f64; 16];
    #[inline(always)]
    fn splat(value: f32) -> Self {
        Self(Ymm::splat(value), Ymm::splat(value))
    }
    #[inline(always)]
    fn load(array: &[f32; 16]) -> Self {
        let [low, high] = array.as_chunks().0 else { unreachable!() };
        Self(Ymm::load(low), Ymm::load(high))
    }
    #[inline(always)]
    fn narrow(doubles: &[f64; 16]) -> Self {
        let [low, high] = doubles.as_chunks().0 else { unreachable!() };
        Self(Ymm::narrow(low), Ymm::narrow(high))
    }
    #[inline(always)]
    fn store(self) -> [f32; 16] {
        let mut array = [0.0; 16];
        array[..8].copy_from_slice(&self.0.store());
        array[8..].copy_from_slice(&self.1.store());
        array
    }
    #[inline(always)]
    fn mul_add(self, factor: Self, term: Self) -> Self {
        Self(self.0.mul_add(factor.0, term.0), self.1.mul_add(factor.1, term.1))
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Self(self.0.min(other.0), self.1.min(other.1))
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Self(self.0.max(other.0), self.1.max(other.1))
    }
    #[inline(always)]
    fn abs(self) -> Self {
        Self(self.0.abs(), self.1.abs())
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(self.0.sqrt(), self.1.sqrt())
    }
    #[inline(always)]
    fn flip(self, sign: Self) -> Self {
        Self(self.0.flip(sign.0), self.1.flip(sign.1))
    }
    #[inline(always)]
    fn le(self, other: Self) -> u32 {
        self.0.le(other.0) | self.1.le(other.1) << 8
    }
    #[inline(always)]
    fn where_le(self, other: Self, yes: Self, no: Self) -> Self {
        Self(self.0.where_le(other.0, yes.0, no.0), self.1.where_le(other.1, yes.1, no.1))
    }
    #[inline(always)]
    fn where_negative(self, yes: Self, no: Self) -> Self {
        Self(self.0.where_negative(yes.0, no.0), self.1.where_negative(yes.1, no.1))
    }
    #[inline(always)]
    fn any_negative(self) -> bool {
        self.0.any_negative() | self.1.any_negative()
    }
    #[inline(always)]
    fn greatest(self) -> f32 {
        self.0.max(self.1).greatest()
    }
}
