//! First surfaces from points with normals, whose signs do not matter.

use super::surface::{Kind, Surface};
use super::vectors::{along, cross, dot, mean, minus, plus, scaled, unit};
use crate::Vector;
use crate::spread::Spread;
use nalgebra::{Matrix3, Vector3};

/// Points with their normals.
#[derive(Clone, Copy)]
pub struct Oriented<'a> {
    /// Places, metres.
    pub points: &'a [Vector],
    /// Unit normals of either sign.
    pub normals: &'a [Vector],
}

impl Oriented<'_> {
    /// A surface of a kind; None where the points determine none.
    #[must_use]
    pub fn surface(&self, kind: Kind) -> Option<Surface> {
        if self.points.len() < kind.least_points() {
            return None;
        }
        let found = match kind {
            Kind::Plane => self.plane(),
            Kind::Sphere => self.sphere(),
            Kind::Cylinder => self.cylinder(),
            Kind::Cone => self.cone(),
            Kind::Torus => self.nearer(self.torus(), self.bend()),
        }?;
        found.is_sound(f64::INFINITY).then_some(found)
    }

    /// The one of two that the points are nearer to, if it is sound.
    fn nearer(&self, first: Option<Surface>, second: Option<Surface>) -> Option<Surface> {
        let off = |surface: &Surface| {
            self.points.iter().map(|point| surface.distance(point).abs()).sum::<f64>()
        };
        [first, second]
            .into_iter()
            .flatten()
            .filter(|surface| surface.is_sound(f64::INFINITY))
            .min_by(|a, b| off(a).total_cmp(&off(b)))
    }

    /// The torus of a bend of a pipe, of which little more than a quarter may be there: the cylinders
    /// of both halves along the pipe are tangent to its circle.
    fn bend(&self) -> Option<Surface> {
        let whole = self.cylinder()?;
        let middle = mean(self.points.iter());
        let is_low = |point: &Vector| dot(&minus(point, &middle), &whole.axis) < 0.0;
        let half = |low: bool| {
            let some = self.pairs().filter(|(point, _)| is_low(point) == low);
            let (points, normals): (Vec<Vector>, Vec<Vector>) = some.map(|(p, n)| (*p, *n)).unzip();
            if points.len() < Kind::Cylinder.least_points() {
                return None;
            }
            let one = Oriented { points: &points, normals: &normals }.cylinder()?;
            let up = dot(&minus(&mean(points.iter()), &one.place), &one.axis);
            let axis =
                if dot(&one.axis, &whole.axis) < 0.0 { one.axis.map(|x| -x) } else { one.axis };
            Some((along(&one.place, &one.axis, up), axis, one.sizes[0]))
        };
        let ((first, start, near), (second, end, far)) = (half(true)?, half(false)?);
        let turn = cross(&start, &end);
        let sine = dot(&turn, &turn).sqrt();
        let axis = unit(&turn);
        let chord = minus(&second, &first);
        // Half of the angle between the tangents by its sine: they turn by less than a right angle.
        let half_sine = (0.5 * (1.0 - (1.0 - sine * sine).max(0.0).sqrt())).sqrt();
        let ring = 0.5 * dot(&chord, &chord).sqrt() / half_sine;
        let inward = cross(&axis, &start);
        let place = along(&first, &inward, ring);
        let sizes = [ring, 0.5 * (near + far)];
        Some(Surface { kind: Kind::Torus, place, axis, sizes })
    }

    fn pairs(&self) -> impl Iterator<Item = (&Vector, &Vector)> {
        self.points.iter().zip(self.normals)
    }

    /// Through the mean, across the direction that most normals have.
    fn plane(&self) -> Option<Surface> {
        let [x, y, z] = symmetric(self.normals.iter()).map(|row| row.map(|x| -x));
        // The largest axis of a matrix is the least of its negative.
        let axis = least_axis(&[x, y, z])?;
        let place = mean(self.points.iter());
        Some(Surface { kind: Kind::Plane, place, axis, sizes: [0.0; 2] })
    }

    /// The centre is nearest to all lines along normals.
    fn sphere(&self) -> Option<Surface> {
        let middle = mean(self.points.iter());
        let mut matrix = [[0.0; 3]; 3];
        let mut right = [0.0; 3];
        for (point, normal) in self.pairs() {
            let away = minus(point, &middle);
            let off = dot(&away, normal);
            for i in 0..3 {
                for j in 0..3 {
                    matrix[i][j] += f64::from(u8::from(i == j)) - normal[i] * normal[j];
                }
                right[i] += away[i] - off * normal[i];
            }
        }
        let place = plus(&middle, &solve(&matrix, &right)?);
        let radius = average(self.points.iter().map(|point| {
            let away = minus(point, &place);
            dot(&away, &away).sqrt()
        }));
        Some(Surface { kind: Kind::Sphere, place, axis: [0.0, 0.0, 1.0], sizes: [radius, 0.0] })
    }

    /// The axis is across all normals; its place is nearest to all lines along them.
    fn cylinder(&self) -> Option<Surface> {
        let axis = least_axis(&symmetric(self.normals.iter()))?;
        let middle = mean(self.points.iter());
        // Along the axis nothing pulls but this.
        let mut matrix =
            [axis.map(|x| x * axis[0]), axis.map(|x| x * axis[1]), axis.map(|x| x * axis[2])];
        let mut right = [0.0; 3];
        for (point, normal) in self.pairs() {
            let away = minus(point, &middle);
            let away = along(&away, &axis, -dot(&away, &axis));
            let normal = along(normal, &axis, -dot(normal, &axis));
            let square = dot(&normal, &normal);
            let off = dot(&away, &normal);
            for i in 0..3 {
                for j in 0..3 {
                    let across = f64::from(u8::from(i == j)) - axis[i] * axis[j];
                    matrix[i][j] += across * square - normal[i] * normal[j];
                }
                right[i] += away[i] * square - off * normal[i];
            }
        }
        let place = plus(&middle, &solve(&matrix, &right)?);
        let radius = average(self.points.iter().map(|point| {
            let away = minus(point, &place);
            let height = dot(&away, &axis);
            (dot(&away, &away) - height * height).max(0.0).sqrt()
        }));
        Some(Surface { kind: Kind::Cylinder, place, axis, sizes: [radius, 0.0] })
    }

    /// The apex is on all tangent planes; directions from it end on a circle across the axis.
    fn cone(&self) -> Option<Surface> {
        let middle = mean(self.points.iter());
        let mut right = [0.0; 3];
        for (point, normal) in self.pairs() {
            right = along(&right, normal, dot(&minus(point, &middle), normal));
        }
        let place = plus(&middle, &solve(&symmetric(self.normals.iter()), &right)?);
        let rays: Vec<Vector> = self
            .points
            .iter()
            .map(|point| minus(point, &place))
            .filter(|away| dot(away, away) > 0.0)
            .map(|away| unit(&away))
            .collect();
        let center = mean(rays.iter());
        let apart: Vec<Vector> = rays.iter().map(|ray| minus(ray, &center)).collect();
        let mut axis = least_axis(&symmetric(apart.iter()))?;
        let cosine = dot(&center, &axis);
        if cosine < 0.0 {
            axis = scaled(&axis, -1.0);
        }
        let cosine = cosine.abs();
        let sizes = [cosine, (1.0 - cosine * cosine).max(0.0).sqrt()];
        Some(Surface { kind: Kind::Cone, place, axis, sizes })
    }

    /// The axis meets all lines along normals as nearly as a linear complex can (Pottmann, Randrup:
    /// Rotational and helical surface approximation for reverse engineering, Computing 60, 1998);
    /// then a circle through the points turned about it into one plane (Kåsa, 1976).
    fn torus(&self) -> Option<Surface> {
        let middle = mean(self.points.iter());
        let mut products = [[0.0; 3]; 3];
        let mut moments = Vec::with_capacity(self.points.len());
        for (point, normal) in self.pairs() {
            let moment = cross(&minus(point, &middle), normal);
            for i in 0..3 {
                for j in 0..3 {
                    products[i][j] += normal[i] * moment[j];
                }
            }
            moments.push(moment);
        }
        let lines = symmetric(self.normals.iter());
        let columns = [0, 1, 2].map(|j| products.map(|row| row[j]));
        let [first, second, third] =
            [solve(&lines, &columns[0])?, solve(&lines, &columns[1])?, solve(&lines, &columns[2])?];
        let mut left = symmetric(moments.iter());
        for (i, column) in columns.iter().enumerate() {
            for (j, solved) in [&first, &second, &third].into_iter().enumerate() {
                left[i][j] -= dot(column, solved);
            }
        }
        let axis = least_axis(&left)?;
        let bar: Vector = std::array::from_fn(|k| {
            -(first[k] * axis[0] + second[k] * axis[1] + third[k] * axis[2])
        });
        let from = cross(&axis, &bar);
        let profile = self.points.iter().map(|point| {
            let away = minus(&minus(point, &middle), &from);
            let height = dot(&away, &axis);
            [(dot(&away, &away) - height * height).max(0.0).sqrt(), height]
        });
        let [ring, height, radius] = circle(profile)?;
        let place = along(&plus(&middle, &from), &axis, height);
        Some(Surface { kind: Kind::Torus, place, axis, sizes: [ring, radius] })
    }
}

/// Centre and radius of the circle through places in the plane.
fn circle(places: impl Iterator<Item = [f64; 2]> + Clone) -> Option<[f64; 3]> {
    let middle = [0, 1].map(|k| average(places.clone().map(|place| place[k])));
    let mut matrix = [[0.0; 3]; 3];
    let mut right = [0.0; 3];
    for place in places {
        let [x, y] = [place[0] - middle[0], place[1] - middle[1]];
        let row = [x, y, 1.0];
        for i in 0..3 {
            for j in 0..3 {
                matrix[i][j] += row[i] * row[j];
            }
            right[i] += row[i] * (x * x + y * y);
        }
    }
    let [a, b, c] = solve(&matrix, &right)?;
    let [x, y] = [0.5 * a, 0.5 * b];
    Some([middle[0] + x, middle[1] + y, (c + x * x + y * y).max(0.0).sqrt()])
}

fn average(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0.0), |(sum, count), value| (sum + value, count + 1.0));
    sum / count
}

/// Sum of the products of vectors with themselves.
fn symmetric<'a>(vectors: impl Iterator<Item = &'a Vector>) -> [[f64; 3]; 3] {
    let mut sum = [[0.0; 3]; 3];
    for v in vectors {
        for i in 0..3 {
            for j in 0..3 {
                sum[i][j] += v[i] * v[j];
            }
        }
    }
    sum
}

/// Eigenvector of the least eigenvalue of a symmetric matrix.
fn least_axis(matrix: &[[f64; 3]; 3]) -> Option<Vector> {
    // The characteristic polynomial wants a matrix without negative eigenvalues.
    let trace = matrix[0][0] + matrix[1][1] + matrix[2][2];
    let shift = if trace < 0.0 { -trace } else { 0.0 };
    let [a, b, c] = matrix;
    let upper = [a[0] + shift, a[1], a[2], b[1] + shift, b[2], c[2] + shift];
    let axis = Spread::of(&upper, [0.0; 3]).normal;
    axis.iter().all(|x| x.is_finite()).then_some(axis)
}

fn solve(matrix: &[[f64; 3]; 3], right: &Vector) -> Option<Vector> {
    let matrix = Matrix3::from_fn(|i, j| matrix[i][j]);
    let solved = matrix.lu().solve(&Vector3::from_column_slice(right))?;
    let solved = [solved[0], solved[1], solved[2]];
    solved.iter().all(|x| x.is_finite()).then_some(solved)
}
