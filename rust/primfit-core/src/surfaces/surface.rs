//! The five kinds of surface: distance, normal, curvature, and how they change with the parameters.

use super::vectors::{along, cross, dot, minus, plus, scaled, unit};
use crate::Vector;
use crate::spread::axes_across;

/// Most parameters of a surface.
pub const MOST: usize = 7;

/// A kind of surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    /// Three parameters.
    Plane,
    /// Four parameters.
    Sphere,
    /// Five parameters.
    Cylinder,
    /// Six parameters.
    Cone,
    /// Seven parameters.
    Torus,
}

/// Columns of [`Frame::slopes`] that a kind has: along the two directions across the axis and along
/// it, turns about those two, and the sizes.
const COLUMNS: [&[usize]; 5] =
    [&[2, 3, 4], &[0, 1, 2, 5], &[0, 1, 3, 4, 5], &[0, 1, 2, 3, 4, 5], &[0, 1, 2, 3, 4, 5, 6]];

impl Kind {
    /// All kinds, those with fewer parameters first.
    pub const ALL: [Self; 5] = [Self::Plane, Self::Sphere, Self::Cylinder, Self::Cone, Self::Torus];

    /// Parameters that points determine.
    #[must_use]
    pub fn n_parameters(self) -> usize {
        COLUMNS[self as usize].len()
    }

    /// Fewest points with normals that determine a surface.
    #[must_use]
    pub fn least_points(self) -> usize {
        [1, 2, 2, 3, 4][self as usize]
    }
}

/// An unbounded surface of revolution; all vectors in metres, axes of unit length.
///
/// One shape for all kinds: `place` is a point of a plane, the centre of a sphere or torus, a point
/// of a cylinder's axis, the apex of a cone, whose `axis` points to where it opens.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Surface {
    /// Its kind.
    pub kind: Kind,
    /// The place that it lies at.
    pub place: Vector,
    /// Normal of a plane, else the axis; of no meaning for a sphere.
    pub axis: Vector,
    /// Radius of a sphere or a cylinder, cosine and sine of a cone's half angle, distance of the
    /// circle of a torus from its axis and radius about it.
    pub sizes: [f64; 2],
}

/// A point as a surface sees it.
#[derive(Debug, Clone, Copy)]
pub struct Sight {
    /// Signed distance, positive on the side of the normal.
    pub distance: f64,
    /// Unit normal at the foot of the point, away from the axis or the centre.
    pub normal: Vector,
    /// Distance from the axis (sphere: from the centre), and place along it.
    pub rho: f64,
    /// Place along the axis.
    pub height: f64,
}

impl Surface {
    /// Distance and normal at a point.
    #[inline]
    #[must_use]
    pub fn sight(&self, point: &Vector) -> Sight {
        let away = minus(point, &self.place);
        let height = dot(&away, &self.axis);
        match self.kind {
            Kind::Plane => Sight { distance: height, normal: self.axis, rho: 0.0, height },
            Kind::Sphere => {
                let rho = dot(&away, &away).sqrt();
                let normal = if rho > 0.0 { scaled(&away, 1.0 / rho) } else { self.axis };
                Sight { distance: rho - self.sizes[0], normal, rho, height }
            }
            _ => {
                let across = along(&away, &self.axis, -height);
                let rho = dot(&across, &across).sqrt();
                let radial =
                    if rho > 0.0 { scaled(&across, 1.0 / rho) } else { axes_across(&self.axis)[0] };
                self.in_profile(rho, height, &radial)
            }
        }
    }

    /// The same by the place in the plane through the axis, whose `radial` direction is known.
    #[inline]
    fn in_profile(&self, rho: f64, height: f64, radial: &Vector) -> Sight {
        let [first, second] = self.sizes;
        let (distance, out, up) = match self.kind {
            Kind::Cone => (rho * first - height * second, first, -second),
            Kind::Torus => {
                let ring = rho - first;
                let arm = (ring * ring + height * height).sqrt();
                let (out, up) = if arm > 0.0 { (ring / arm, height / arm) } else { (1.0, 0.0) };
                (arm - second, out, up)
            }
            _ => (rho - first, 1.0, 0.0),
        };
        let normal = along(&scaled(radial, out), &self.axis, up);
        Sight { distance, normal, rho, height }
    }

    /// Signed distance of a point.
    #[inline]
    #[must_use]
    pub fn distance(&self, point: &Vector) -> f64 {
        self.sight(point).distance
    }

    /// Sum of the principal curvatures at a point, which is the divergence of the normal; `least` is
    /// the radius that none falls below.
    #[inline]
    #[must_use]
    pub fn curvature(&self, at: &Sight, least: f64) -> f64 {
        let rho = at.rho.max(least);
        match self.kind {
            Kind::Plane => 0.0,
            Kind::Sphere => 2.0 / rho,
            Kind::Cylinder => 1.0 / rho,
            Kind::Cone => self.sizes[0] / rho,
            Kind::Torus => {
                let arm = (at.distance + self.sizes[1]).max(least);
                1.0 / arm + (at.rho - self.sizes[0]) / (arm * rho)
            }
        }
    }

    /// Whether a point is beyond the apex of a cone.
    #[inline]
    #[must_use]
    pub fn is_beyond_apex(&self, at: &Sight) -> bool {
        self.kind == Kind::Cone && at.height < 0.0
    }

    /// Moved and turned by a step of its parameters in a frame, and its sizes changed.
    #[must_use]
    pub fn stepped(&self, frame: &Frame, step: &[f64; MOST]) -> Self {
        let mut full = [0.0; MOST];
        for (&column, value) in COLUMNS[self.kind as usize].iter().zip(step) {
            full[column] = *value;
        }
        let [u, v, w] = &frame.axes;
        let shift = along(&along(&scaled(u, full[0]), v, full[1]), w, full[2]);
        let turn = along(&scaled(u, full[3]), v, full[4]);
        let from = minus(&self.place, &frame.middle);
        let place = plus(&plus(&frame.middle, &turned(&from, &turn)), &shift);
        let axis = unit(&turned(&self.axis, &turn));
        let [first, second] = self.sizes;
        let sizes = match self.kind {
            Kind::Cone => {
                let half = 0.5 * full[5];
                let (cosine, sine) = (1.0 - half * half, 2.0 * half);
                let scale = 1.0 / (1.0 + half * half);
                [(first * cosine - second * sine) * scale, (second * cosine + first * sine) * scale]
            }
            _ => [first + full[5], second + full[6]],
        };
        Self { place, axis, sizes, ..*self }
    }

    /// Whether the sizes are those of a surface, none larger than `most`, metres.
    #[must_use]
    pub fn is_sound(&self, most: f64) -> bool {
        /// Least half angle of a cone, radians, and least sine of what is missing to a plane.
        const LEAST_SLOPE: f64 = 0.02;
        /// Least radius of the circle of a torus in radii about it.
        const OPEN: f64 = 1.02;
        let [first, second] = self.sizes;
        self.place.iter().chain(&self.axis).all(|x| x.is_finite())
            && match self.kind {
                Kind::Plane => true,
                Kind::Sphere | Kind::Cylinder => first > 0.0 && first < most,
                Kind::Cone => first > LEAST_SLOPE && second > LEAST_SLOPE,
                Kind::Torus => second > 0.0 && first > OPEN * second && first < most,
            }
    }

    /// How place, axis and sizes (a cone: half angle) change with the parameters of a frame: columns
    /// of the Jacobian (8, k).
    #[must_use]
    pub fn world_slopes(&self, frame: &Frame) -> Vec<[f64; 8]> {
        let from = minus(&self.place, &frame.middle);
        COLUMNS[self.kind as usize]
            .iter()
            .map(|&column| {
                let mut slope = [0.0; 8];
                match column {
                    0..=2 => slope[..3].copy_from_slice(&frame.axes[column]),
                    3 | 4 => {
                        let about = &frame.axes[column - 3];
                        let shift = cross(about, &from);
                        let up = dot(&shift, &self.axis);
                        // Along what a surface does not end in, its place does not move.
                        let shift = match self.kind {
                            Kind::Plane => scaled(&self.axis, up),
                            Kind::Cylinder => along(&shift, &self.axis, -up),
                            _ => shift,
                        };
                        slope[..3].copy_from_slice(&shift);
                        slope[3..6].copy_from_slice(&cross(about, &self.axis));
                    }
                    _ => slope[column + 1] = 1.0,
                }
                slope
            })
            .collect()
    }
}

/// What the parameters of a surface are counted in: small motions about the middle of its points.
#[derive(Debug, Clone, Copy)]
pub struct Frame {
    middle: Vector,
    /// Two directions across the axis, and the axis.
    axes: [Vector; 3],
}

impl Frame {
    /// Of a surface through points with this mean.
    #[must_use]
    pub fn of(surface: &Surface, middle: Vector) -> Self {
        let [first, second] = axes_across(&surface.axis);
        Self { middle, axes: [first, second, surface.axis] }
    }

    /// How the distance of a point changes with the parameters of its surface; the first ones count.
    #[inline]
    #[must_use]
    pub fn slopes(&self, surface: &Surface, point: &Vector, at: &Sight) -> [f64; MOST] {
        let [u, v, w] = &self.axes;
        let normal = &at.normal;
        let moment = cross(&minus(point, &self.middle), normal);
        let [first, second] = surface.sizes;
        let size = match surface.kind {
            Kind::Cone => -at.rho * second - at.height * first,
            Kind::Torus => {
                let arm = at.distance + second;
                if arm > 0.0 { -(at.rho - first) / arm } else { -1.0 }
            }
            _ => -1.0,
        };
        let full = [
            -dot(normal, u),
            -dot(normal, v),
            -dot(normal, w),
            -dot(&moment, u),
            -dot(&moment, v),
            size,
            -1.0,
        ];
        let mut slopes = [0.0; MOST];
        for (slope, &column) in slopes.iter_mut().zip(COLUMNS[surface.kind as usize]) {
            *slope = full[column];
        }
        slopes
    }
}

/// A vector turned by a small angle about an axis: Cayley's rotation, of arithmetic alone.
fn turned(v: &Vector, turn: &Vector) -> Vector {
    let half = scaled(turn, 0.5);
    let first = cross(&half, v);
    let second = cross(&half, &first);
    let scale = 2.0 / (1.0 + dot(&half, &half));
    std::array::from_fn(|k| v[k] + scale * (first[k] + second[k]))
}
