//! Where a beam meets a surface.

use super::surface::{Kind, Sight, Surface};
use super::vectors::{along, dot, minus};
use crate::Vector;

/// Steps of Newton's method along a beam to a torus; four to eight are usual.
const MOST_STEPS: usize = 30;
/// What rounding leaves of a distance, as a share of the numbers that it is computed of.
const ROUNDING: f64 = 1e-12;

impl Surface {
    /// How far along a beam from a point near the surface the beam meets it, and the surface there:
    /// of all crossings the nearest of those on whose side (`side`: sign of the product of normal
    /// and beam) the beam comes from.
    ///
    /// Planes, spheres, cylinders and cones in closed form; a torus by Newton's method from the
    /// point, which has to be nearer to it than its radius.
    #[must_use]
    pub fn meet(&self, point: &Vector, beam: &Vector, side: f64) -> Option<(f64, Sight)> {
        let away = minus(point, &self.place);
        let (up, height) = (dot(beam, &self.axis), dot(&away, &self.axis));
        let (forth, square) = (dot(&away, beam), dot(&away, &away));
        let [first, second] = self.sizes;
        let far = match self.kind {
            Kind::Plane => [-height / up, f64::NAN],
            Kind::Sphere => crossings(1.0, forth, square - first * first),
            Kind::Cylinder => crossings(
                1.0 - up * up,
                forth - height * up,
                square - height * height - first * first,
            ),
            Kind::Cone => {
                let opening = first * first;
                crossings(
                    opening - up * up,
                    opening * forth - height * up,
                    opening * square - height * height,
                )
            }
            Kind::Torus => [self.approach(point, beam), f64::NAN],
        };
        let seen = |far: f64| {
            let at = self.sight(&along(point, beam, far));
            let on_side = dot(&at.normal, beam) * side >= 0.0 && !self.is_beyond_apex(&at);
            // NaN is no place, and what is beyond the apex none of the surface.
            let size = first + second + square.sqrt();
            (on_side && at.distance.abs() <= ROUNDING.sqrt() * size).then_some((far, at))
        };
        let [near, other] = far.map(|far| far.is_finite().then(|| seen(far)).flatten());
        match (near, other) {
            (Some(a), Some(b)) => Some(if a.0.abs() <= b.0.abs() { a } else { b }),
            (a, b) => a.or(b),
        }
    }

    /// The crossing that Newton's method finds from a point; NaN where it finds none.
    fn approach(&self, point: &Vector, beam: &Vector) -> f64 {
        let mut far = 0.0;
        for _ in 0..MOST_STEPS {
            let at = self.sight(&along(point, beam, far));
            let step = at.distance / dot(&at.normal, beam);
            far -= step;
            if step.abs() <= ROUNDING * self.sizes[0] {
                return far;
            }
        }
        f64::NAN
    }
}

/// Roots of `a x^2 + 2 b x + c`, without a loss of digits; NaN where there are none.
fn crossings(a: f64, b: f64, c: f64) -> [f64; 2] {
    let root = (b * b - a * c).sqrt();
    let larger = -(b + root.copysign(b));
    [larger / a, c / larger]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surfaces::vectors::unit;
    use proptest::prelude::*;

    fn surface() -> impl Strategy<Value = Surface> {
        (
            0..5_usize,
            prop::array::uniform3(-1.0..1.0),
            prop::array::uniform3(0.1..1.0),
            0.1..0.4_f64,
        )
            .prop_map(|(kind, place, axis, size)| {
                let kind = Kind::ALL[kind];
                let sizes = match kind {
                    Kind::Cone => [(1.0 - size * size).sqrt(), size],
                    Kind::Torus => [2.5 * size, size],
                    _ => [size, 0.0],
                };
                Surface { kind, place, axis: unit(&axis), sizes }
            })
    }

    proptest! {
        #[test]
        fn beams_end_on_the_surface_at_the_nearest_crossing_of_their_side(
            surface in surface(),
            start in prop::array::uniform3(-1.0..1.0),
            beam in prop::array::uniform3(-1.0..1.0),
            off in -0.02..0.02,
        ) {
            prop_assume!(dot(&beam, &beam) > 0.01);
            let beam = unit(&beam);
            let at = surface.sight(&start);
            let foot = along(&start, &at.normal, -at.distance);
            let normal = surface.sight(&foot).normal;
            let steep = dot(&normal, &beam);
            prop_assume!(steep.abs() > 0.5 && !surface.is_beyond_apex(&surface.sight(&foot)));
            let measured = along(&foot, &beam, off);
            let met = surface.meet(&measured, &beam, steep.signum());
            prop_assert!(met.is_some());
            if let Some((far, seen)) = met {
                prop_assert!(seen.distance.abs() < 1e-9);
                prop_assert!(dot(&seen.normal, &beam) * steep > 0.0);
                // The foot is a crossing; no other one of its side is that near.
                prop_assert!((far + off).abs() < 1e-9 || far.abs() <= off.abs() + 1e-9);
            }
        }
    }
}
