//! One function for several instruction sets.

/// An instruction set that kernels are compiled for, all with the same results.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd)]
pub enum Instructions {
    Scalar,
    #[cfg(target_arch = "x86_64")]
    Avx2,
    #[cfg(target_arch = "x86_64")]
    Avx512,
}

impl Instructions {
    /// The fastest that this processor has.
    pub fn best() -> Self {
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2")
            && is_x86_feature_detected!("fma")
            && is_x86_feature_detected!("bmi1")
            && is_x86_feature_detected!("bmi2")
            && is_x86_feature_detected!("lzcnt")
            && is_x86_feature_detected!("popcnt")
        {
            let has_avx512 = is_x86_feature_detected!("avx512f")
                && is_x86_feature_detected!("avx512vl")
                && is_x86_feature_detected!("avx512dq");
            return if has_avx512 { Self::Avx512 } else { Self::Avx2 };
        }
        Self::Scalar
    }

    /// All that this processor has.
    #[cfg(test)]
    pub fn available() -> impl Iterator<Item = Self> {
        #[cfg(target_arch = "x86_64")]
        let all = [Self::Scalar, Self::Avx2, Self::Avx512];
        #[cfg(not(target_arch = "x86_64"))]
        let all = [Self::Scalar];
        all.into_iter().filter(|&set| set <= Self::best())
    }
}

/// The sets as types; any processor has the first.
pub struct Scalar;
/// AVX2 with FMA and what came with them.
#[cfg(target_arch = "x86_64")]
pub struct Avx2;
/// AVX-512 F, VL and DQ.
#[cfg(target_arch = "x86_64")]
pub struct Avx512;

/// Compiles a function once for each instruction set; its first argument says which is to run, and
/// `Set` is its type in the body.
///
/// Products are fused with sums only where the body says so, and plain functions that it calls
/// must be inlined to be compiled alike.
macro_rules! for_each_set {
    (
        $(#[$about:meta])*
        $visible:vis fn $name:ident$(<$generic:ident: $bound:ident, const $flag:ident: bool>)?($($argument:ident: $kind:ty),* $(,)?)
            -> $result:ty $body:block
    ) => {
        $(#[$about])*
        $visible fn $name$(<$generic: $bound, const $flag: bool>)?(
            instructions: $crate::instructions::Instructions,
            $($argument: $kind),*
        ) -> $result {
            match instructions {
                $crate::instructions::Instructions::Scalar => {
                    #[allow(dead_code)]
                    type Set = $crate::instructions::Scalar;
                    $body
                }
                #[cfg(target_arch = "x86_64")]
                $crate::instructions::Instructions::Avx2 => {
                    #[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
                    fn avx2$(<$generic: $bound, const $flag: bool>)?($($argument: $kind),*) -> $result {
                        #[allow(dead_code)]
                        type Set = $crate::instructions::Avx2;
                        $body
                    }
                    // SAFETY: chosen only where the processor has it.
                    unsafe { avx2$(::<$generic, $flag>)?($($argument),*) }
                }
                #[cfg(target_arch = "x86_64")]
                $crate::instructions::Instructions::Avx512 => {
                    #[target_feature(
                        enable = "avx512f,avx512vl,avx512dq,avx2,fma,bmi1,bmi2,lzcnt,popcnt"
                    )]
                    fn avx512$(<$generic: $bound, const $flag: bool>)?($($argument: $kind),*) -> $result {
                        #[allow(dead_code)]
                        type Set = $crate::instructions::Avx512;
                        $body
                    }
                    // SAFETY: chosen only where the processor has it.
                    unsafe { avx512$(::<$generic, $flag>)?($($argument),*) }
                }
            }
        }
    };
}
pub(crate) use for_each_set;

/// Compiles a function once for each instruction set; the best one runs.
macro_rules! widest {
    (fn $name:ident($($argument:ident: $kind:ty),* $(,)?) -> $result:ty $body:block) => {
        fn $name($($argument: $kind),*) -> $result {
            $crate::instructions::for_each_set! {
                fn on_set($($argument: $kind),*) -> $result $body
            }
            on_set($crate::instructions::Instructions::best(), $($argument),*)
        }
    };
}
pub(crate) use widest;
