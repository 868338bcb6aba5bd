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
    let n = errors.len();
    let square = errors.iter().map(|u| u * u).sum::<f64>() / n as f64;
    let n_neighbors = (GROUP * MOST_GROUPS).min(n / 2);
    if n_neighbors < GROUP || square <= 0.0 || !square.is_finite() {
        return Ok(1.0);
    }
    let stride = n.div_ceil(SAMPLES);
    let n_groups = n_neighbors / GROUP;
    let mut products = vec![[0.0; MOST_GROUPS]; n.div_ceil(stride)];
    workers.fill(&mut products, 1, Search::default, |search, i, row| {
        let place = i * stride;
        let own = errors[tree.rows()[place] as usize];
        let near = tree.nearest(&tree.points()[place], n_neighbors + 1, search);
        let others = near.iter().filter(|other| other.place as usize != place);
        for (k, other) in others.take(n_groups * GROUP).enumerate() {
            row[0][k / GROUP] += own * errors[other.row as usize] / GROUP as f64;
        }
    })?;
    let n_samples = products.len() as f64;
    // Each pair may come twice.
    let chance = CLEAR * (2.0 / (n_samples * GROUP as f64)).sqrt();
    let mut area = 1.0;
    for group in 0..n_groups {
        let alike = products.iter().map(|row| row[group]).sum::<f64>() / n_samples / square;
        if alike < chance {
            break;
        }
        area += alike * GROUP as f64;
    }
    Ok(area)
}
