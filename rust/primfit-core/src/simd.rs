//! One function for several instruction sets.

/// Compiles a function for the widest vectors too, and chooses at run time.
///
/// No multiplication is fused with an addition, so the results are the same bits everywhere.
macro_rules! widest {
    (fn $name:ident($($argument:ident: $kind:ty),* $(,)?) -> $result:ty $body:block) => {
        fn $name($($argument: $kind),*) -> $result {
            // A plain function would not be compiled for the instruction set of its caller.
            #[allow(clippy::inline_always)]
            #[inline(always)]
            fn plain($($argument: $kind),*) -> $result $body
            #[cfg(target_arch = "x86_64")]
            {
                #[target_feature(enable = "avx512f,avx512vl,avx512dq")]
                fn avx512($($argument: $kind),*) -> $result {
                    plain($($argument),*)
                }
                #[target_feature(enable = "avx2")]
                fn avx2($($argument: $kind),*) -> $result {
                    plain($($argument),*)
                }
                if is_x86_feature_detected!("avx512f")
                    && is_x86_feature_detected!("avx512vl")
                    && is_x86_feature_detected!("avx512dq")
                {
                    // SAFETY: the processor has what the function is compiled for.
                    return unsafe { avx512($($argument),*) };
                }
                if is_x86_feature_detected!("avx2") {
                    // SAFETY: the processor has what the function is compiled for.
                    return unsafe { avx2($($argument),*) };
                }
            }
            plain($($argument),*)
        }
    };
}
pub(crate) use widest;
