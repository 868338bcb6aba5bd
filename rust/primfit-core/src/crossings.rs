//! Where beams meet a plane, and how far that is from where they ended.

use crate::Vector;

/// The distance of each point to the plane `[a, b, c, d]`.
///
/// It is perpendicular and signed; with `directions`, the unit direction of each point's beam, it
/// is what the beam lacks to the plane, and infinite for a beam that meets the plane from behind
/// or never.
#[must_use]
pub fn residuals(
    points: &[Vector],
    directions: Option<&[Vector]>,
    [a, b, c, d]: [f64; 4],
) -> Vec<f64> {
    let normal = [a, b, c];
    let above = |point: &Vector| dot(normal, *point) + d;
    match directions {
        None => points.iter().map(above).collect(),
        Some(directions) => points
            .iter()
            .zip(directions)
            .map(|(point, direction)| {
                let approach = -dot(normal, *direction);
                if approach > 0.0 { above(point) / approach } else { f64::INFINITY }
            })
            .collect(),
    }
}

/// Where beams met the plane `[a, b, c, d]` from its front and went on by more than `clear`,
/// along two axes of the plane.
///
/// `lengths` tells how far each beam went at the least.
#[must_use]
pub fn passages(
    origins: &[Vector],
    directions: &[Vector],
    lengths: impl IntoIterator<Item = f64>,
    [a, b, c, d]: [f64; 4],
    axes: [Vector; 2],
    clear: f64,
) -> Vec<[f64; 2]> {
    let normal = [a, b, c];
    let mut places = Vec::new();
    for ((origin, direction), length) in origins.iter().zip(directions).zip(lengths) {
        let (approach, height) = (-dot(normal, *direction), dot(normal, *origin) + d);
        if !(approach > 0.0 && height > 0.0) {
            continue;
        }
        let crossing = height / approach;
        if length > crossing + clear {
            let place = std::array::from_fn(|k| origin[k] + crossing * direction[k]);
            places.push(axes.map(|axis| dot(axis, place)));
        }
    }
    places
}

fn dot(a: Vector, b: Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[cfg(test)]
mod tests {
    use super::{passages, residuals};

    const FLOOR: [f64; 4] = [0.0, 0.0, 1.0, 0.0];

    #[test]
    fn a_beam_lacks_what_is_left_along_it() {
        let points = [[0.0, 0.0, 1.0]; 3];
        let directions = [[0.6, 0.0, -0.8], [0.6, 0.0, 0.8], [1.0, 0.0, 0.0]];
        assert_eq!(residuals(&points, None, FLOOR), [1.0; 3]);
        assert_eq!(
            residuals(&points, Some(&directions), FLOOR),
            [1.25, f64::INFINITY, f64::INFINITY]
        );
    }

    #[test]
    fn only_beams_from_the_front_that_go_on_have_passed() {
        let origins = [[1.0, 2.0, 1.0], [1.0, 2.0, -1.0], [1.0, 2.0, 1.0], [1.0, 2.0, 1.0]];
        let (down, up, level) = ([0.0, 0.0, -1.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]);
        let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let passed =
            passages(&origins, &[down, up, level, down], [1.5, 9.0, 9.0, 1.1], FLOOR, axes, 0.2);
        assert_eq!(passed, [[1.0, 2.0]]);
    }
}
