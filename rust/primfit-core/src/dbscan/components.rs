//! Connected components, joined from many threads at once.

use std::sync::atomic::{AtomicU32, Ordering};

/// Union and find over points.
///
/// Each tree hangs from its lowest point, so that the components do not depend on the order of
/// joins. Nothing but the links themselves is shared, hence the relaxed order of memory.
pub struct Components(Vec<AtomicU32>);

impl Components {
    /// Starts from a link of each point to itself or to a lower one.
    pub fn new(links: Vec<u32>) -> Self {
        Self(links.into_iter().map(AtomicU32::new).collect())
    }

    /// The lowest point of the component that has this one.
    pub fn root(&self, point: usize) -> usize {
        let mut at = point;
        loop {
            let above = self.0[at].load(Ordering::Relaxed);
            let higher = self.0[above as usize].load(Ordering::Relaxed);
            if above == higher {
                return above as usize;
            }
            // A link that another thread has moved meanwhile is set back, at worst: still upwards.
            self.0[at].store(higher, Ordering::Relaxed);
            at = higher as usize;
        }
    }

    /// Makes one component of two.
    pub fn join(&self, a: usize, b: usize) {
        loop {
            let (a, b) = (self.root(a), self.root(b));
            let (low, high) = (a.min(b), a.max(b));
            let link = &self.0[high];
            if low == high
                || link
                    .compare_exchange(high as u32, low as u32, Ordering::Relaxed, Ordering::Relaxed)
                    .is_ok()
            {
                return;
            }
        }
    }

    /// The number of the component of each point, in the order of their first rows.
    pub fn numbered_by(&self, rows: &[u32], n_rows: usize) -> Vec<i64> {
        let mut first_row = vec![u32::MAX; rows.len()];
        for (i, &row) in rows.iter().enumerate() {
            let first = &mut first_row[self.root(i)];
            *first = row.min(*first);
        }
        let mut starts = vec![false; n_rows];
        for &row in first_row.iter().filter(|&&row| row < u32::MAX) {
            starts[row as usize] = true;
        }
        let mut number_of_row = vec![0_u32; n_rows];
        let mut n_components = 0;
        for (number, starts) in number_of_row.iter_mut().zip(starts) {
            *number = n_components;
            n_components += u32::from(starts);
        }
        (0..rows.len())
            .map(|i| i64::from(number_of_row[first_row[self.root(i)] as usize]))
            .collect()
    }
}
