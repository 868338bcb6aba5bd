//! Large arrays on large pages: rays that jump about in them seldom wait for a page's address.

/// An empty vector with room for `n` items.
pub fn with_room<T>(n: usize) -> Vec<T> {
    let items = Vec::with_capacity(n);
    #[cfg(target_os = "linux")]
    advise(items.as_ptr(), n * size_of::<T>());
    items
}

/// A vector of zeros.
pub fn zeros<T: Copy + Default>(n: usize) -> Vec<T> {
    let items = vec![T::default(); n];
    #[cfg(target_os = "linux")]
    advise(items.as_ptr(), n * size_of::<T>());
    items
}

#[cfg(target_os = "linux")]
fn advise<T>(start: *const T, n_bytes: usize) {
    const PAGE: usize = 4096;
    /// Below it, a processor keeps the addresses of small pages, too.
    const LARGE: usize = 4 << 20;
    if n_bytes < LARGE {
        return;
    }
    let skipped = start.addr().next_multiple_of(PAGE) - start.addr();
    let n_bytes = (n_bytes - skipped) / PAGE * PAGE;
    let start = start.cast::<u8>().wrapping_add(skipped).cast_mut();
    // SAFETY: the pages lie within an allocation of ours; the advice changes no contents, and
    // where it is refused nothing happens.
    unsafe { libc::madvise(start.cast(), n_bytes, libc::MADV_HUGEPAGE) };
}
