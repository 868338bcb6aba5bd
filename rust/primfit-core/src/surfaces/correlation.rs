//! How far errors of neighbouring points are alike.

use crate::neighbors::Search;
use crate::{Error, PointTree, Workers};

/// Neighbours whose errors are compared together, and most of such groups: an area of 128 points, ten
/// times that of the depth cameras that were measured.
const GROUP: usize = 8;
const MOST_GROUPS: usize = 16;
/// Points that are compared with their neighbours.
const SAMPLES: usize = 8192;
/// Standard errors above which a group is alike.
const CLEAR: f64 = 3.0;

/// Number of points whose errors are one: the sum of their correlations, over growing neighbourhoods
/// until a group is not clearly alike. 1 for independent errors.
///
/// The variance of what is fitted to n such points is that of n over this number of independent ones.
/// Errors are in the order in which the points were given.
///
/// # Errors
/// [`Error::Stopped`] when the caller does not want to go on.
pub fn correlation_area(tree: &PointTree, errors: &[f64], workers: &Workers) -> Result<f64, Error> {
    workers.check()?;
    let places: Vec<u32> = (0..errors.len() as u32).collect();
    let error = |place: u32| Some(errors[tree.rows()[place as usize] as usize]);
    Ok(workers.install(|| area_of(tree, &places, SAMPLES, error, &mut Search::default())))
}

/// The same for some places of a tree, around at most so many of them; `error` has none for others.
pub fn area_of(
    tree: &PointTree,
    places: &[u32],
    n_samples: usize,
    error: impl Fn(u32) -> Option<f64>,
    search: &mut Search,
) -> f64 {
    let n = places.len();
    let own = |place: &u32| error(*place).unwrap_or(0.0);
    let square = places.iter().map(|place| own(place).powi(2)).sum::<f64>() / n as f64;
    let n_groups = MOST_GROUPS.min(n / 2 / GROUP);
    if n_groups == 0 || square <= 0.0 || !square.is_finite() {
        return 1.0;
    }
    let mut area = 1.0;
    // The first group is the last one where errors are independent.
    for some in [0..1, 1..n_groups] {
        let mut sums = [(0.0, 0.0); MOST_GROUPS];
        for place in places.iter().step_by(n.div_ceil(n_samples)) {
            let at = &tree.points()[*place as usize];
            let near = tree.nearest(at, some.end * GROUP + 1, search);
            let others = near.iter().filter(|other| other.place != *place);
            for (k, other) in others.filter_map(|other| error(other.place)).enumerate() {
                let sum = &mut sums[k / GROUP];
                *sum = (sum.0 + own(place) * other, sum.1 + 1.0);
            }
        }
        for (products, n_pairs) in &sums[some] {
            let alike = products / n_pairs / square;
            // Each pair may come twice.
            if alike.is_nan() || alike < CLEAR * (2.0 / n_pairs).sqrt() {
                return area;
            }
            area += alike * GROUP as f64;
        }
    }
    area
}
