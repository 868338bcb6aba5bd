//! The box around points.

use crate::Vector;

/// Coordinates that are compared side by side: those of four points.
const LANES: usize = 12;

/// Lowest and highest coordinates; infinity and minus infinity without points.
pub fn bounds(points: &[Vector]) -> [Vector; 2] {
    let (mut lows, mut highs) = ([f64::INFINITY; LANES], [f64::NEG_INFINITY; LANES]);
    let (chunks, rest) = points.as_flattened().as_chunks::<LANES>();
    // NaN is neither lower nor higher.
    let mut last = [f64::NAN; LANES];
    last[..rest.len()].copy_from_slice(rest);
    for chunk in chunks.iter().chain([&last]) {
        for k in 0..LANES {
            lows[k] = if chunk[k] < lows[k] { chunk[k] } else { lows[k] };
            highs[k] = if chunk[k] > highs[k] { chunk[k] } else { highs[k] };
        }
    }
    let lanes = |axis: usize| (axis..LANES).step_by(3);
    [
        std::array::from_fn(|axis| lanes(axis).map(|k| lows[k]).fold(f64::INFINITY, f64::min)),
        std::array::from_fn(|axis| lanes(axis).map(|k| highs[k]).fold(f64::NEG_INFINITY, f64::max)),
    ]
}
