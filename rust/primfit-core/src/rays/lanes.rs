//! Eight and sixteen float32 numbers at once, on whatever the processor offers.
//!
//! Code generic over [`Isa`] is compiled once for each instruction set, behind functions that
//! enable it; all that is called there must be inlined, so there are no closures over lanes. What
//! the lanes compute may differ in the last bit between instruction sets (products are fused with
//! sums or not), which is why it only ever chooses what is then decided in float64.

#![allow(clippy::inline_always)]

use crate::instructions::Scalar;
#[cfg(target_arch = "x86_64")]
use crate::instructions::{Avx2, Avx512};
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
    /// `self`, negated where `sign` is negative.
    fn flip(self, sign: Self) -> Self;
    /// A bit for each lane that is not greater than that of `other`.
    fn le(self, other: Self) -> u32;
    /// The greatest of the lanes.
    fn greatest(self) -> f32;
    /// The least of the lanes.
    #[inline(always)]
    fn least(self) -> f32 {
        -(Self::splat(0.0) - self).greatest()
    }
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
    type Eight: Lanes<Array = [f32; 8]>;
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
    fn flip(self, sign: Self) -> Self {
        self.zip(sign, |a, sign| f32::from_bits(a.to_bits() ^ (sign.to_bits() & 1 << 31)))
    }
    #[inline(always)]
    fn le(self, other: Self) -> u32 {
        (0..N).fold(0, |mask, i| mask | u32::from(self.0[i] <= other.0[i]) << i)
    }
    #[inline(always)]
    fn greatest(self) -> f32 {
        self.0.iter().fold(f32::NEG_INFINITY, |a, &b| if a > b { a } else { b })
    }
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    #[allow(clippy::wildcard_imports)]
    use super::*;
    #[allow(clippy::wildcard_imports)]
    use std::arch::x86_64::*;

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
         $narrow:expr, $store:ident, $add:ident, $sub:ident, $mul:ident, $div:ident,
         $mul_add:ident, $min:ident, $max:ident,
         $and:ident, $and_not:ident, $xor:ident, $le:expr, $greatest:expr) => {
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
                    let [low, high] = doubles.as_chunks().0 else { unreachable!() };
                    // SAFETY: callers have enabled the instruction set; the array fills two
                    // registers.
                    Self(unsafe { $narrow(low, high) })
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
                fn flip(self, sign: Self) -> Self {
                    // SAFETY: callers have enabled the instruction set.
                    Self(unsafe { $xor(self.0, $and(sign.0, $splat(-0.0))) })
                }
                #[inline(always)]
                fn le(self, other: Self) -> u32 {
                    // SAFETY: callers have enabled the instruction set.
                    unsafe { $le(self.0, other.0) }
                }
                #[inline(always)]
                fn greatest(self) -> f32 {
                    // SAFETY: callers have enabled the instruction set.
                    unsafe { $greatest(self.0) }
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
        |low: &[f64; 4], high: &[f64; 4]| {
            let low = _mm256_cvtpd_ps(_mm256_loadu_pd(low.as_ptr()));
            let high = _mm256_cvtpd_ps(_mm256_loadu_pd(high.as_ptr()));
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
        _mm256_and_ps,
        _mm256_andnot_ps,
        _mm256_xor_ps,
        |a, b| _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(a, b)) as u32,
        |a| {
            let four = _mm_max_ps(_mm256_castps256_ps128(a), _mm256_extractf128_ps::<1>(a));
            let two = _mm_max_ps(four, _mm_movehl_ps(four, four));
            _mm_cvtss_f32(_mm_max_ss(two, _mm_movehdup_ps(two)))
        }
    );

    lanes!(
        Zmm,
        __m512,
        [f32; 16],
        [f64; 16],
        _mm512_set1_ps,
        _mm512_loadu_ps,
        |low: &[f64; 8], high: &[f64; 8]| {
            let low = _mm512_cvtpd_ps(_mm512_loadu_pd(low.as_ptr()));
            let high = _mm512_cvtpd_ps(_mm512_loadu_pd(high.as_ptr()));
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
        _mm512_and_ps,
        _mm512_andnot_ps,
        _mm512_xor_ps,
        |a, b| u32::from(_mm512_cmp_ps_mask::<_CMP_LE_OQ>(a, b)),
        |a| _mm512_reduce_max_ps(a)
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
        fn flip(self, sign: Self) -> Self {
            Self(self.0.flip(sign.0), self.1.flip(sign.1))
        }
        #[inline(always)]
        fn le(self, other: Self) -> u32 {
            self.0.le(other.0) | self.1.le(other.1) << 8
        }
        #[inline(always)]
        fn greatest(self) -> f32 {
            self.0.max(self.1).greatest()
        }
    }
}
