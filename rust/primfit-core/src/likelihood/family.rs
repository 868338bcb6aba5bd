//! Families of footprints: corners by parameters.

use nalgebra::DMatrix;

/// A family of footprints. It looks at its first parameters; there may be more behind them.
pub enum Family {
    /// x, y, angle, and sizes that stretch an axis of all corners each.
    Template {
        /// Corners at angle zero for a unit of each size, or the four ends of the axes of an
        /// ellipse; they add.
        axes: Vec<Vec<[f64; 2]>>,
        /// Greatest last size over the first.
        slimmest: f64,
        /// Whether its footprints are ellipses.
        is_round: bool,
        /// Whether the angle is a parameter, as for all but a circle.
        has_angle: bool,
    },
    /// So many corners themselves.
    Polygon(usize),
}

impl Family {
    /// How many corners its footprints have.
    #[must_use]
    pub fn n_corners(&self) -> usize {
        match self {
            Self::Template { axes, .. } => axes[0].len(),
            Self::Polygon(n_corners) => *n_corners,
        }
    }

    /// How many parameters it looks at.
    #[must_use]
    pub fn n_parameters(&self) -> usize {
        match self {
            Self::Template { axes, .. } => self.n_places() + axes.len(),
            Self::Polygon(n_corners) => 2 * n_corners,
        }
    }

    /// Whether its footprints are ellipses.
    #[must_use]
    pub fn is_round(&self) -> bool {
        matches!(self, Self::Template { is_round: true, .. })
    }

    /// How many parameters of a template are no sizes.
    fn n_places(&self) -> usize {
        if matches!(self, Self::Template { has_angle: true, .. }) { 3 } else { 2 }
    }

    /// Corners for some parameters.
    pub fn footprint(&self, parameters: &[f64]) -> impl Iterator<Item = [f64; 2]> {
        let turn = match self {
            Self::Template { has_angle: true, .. } => parameters[2].sin_cos(),
            _ => (0.0, 1.0),
        };
        (0..self.n_corners()).map(move |corner| match self {
            Self::Template { axes, .. } => {
                let arm = turned(arm(axes, &parameters[self.n_places()..], corner), turn);
                [parameters[0] + arm[0], parameters[1] + arm[1]]
            }
            Self::Polygon(_) => [parameters[2 * corner], parameters[2 * corner + 1]],
        })
    }

    /// How x and y of each corner (rows) change with each parameter (columns).
    #[must_use]
    pub fn changes(&self, parameters: &[f64]) -> DMatrix<f64> {
        let n = self.n_parameters();
        let Self::Template { axes, has_angle, .. } = self else {
            return DMatrix::identity(n, n);
        };
        let turn = if *has_angle { parameters[2].sin_cos() } else { (0.0, 1.0) };
        let mut changes = DMatrix::zeros(2 * self.n_corners(), n);
        for corner in 0..self.n_corners() {
            let [x, y] = turned(arm(axes, &parameters[self.n_places()..], corner), turn);
            let sizes = axes.iter().map(|axis| turned(axis[corner], turn));
            let places = [[1.0, 0.0], [0.0, 1.0], [-y, x]].into_iter().take(self.n_places());
            let columns = places.chain(sizes);
            for (column, change) in columns.enumerate() {
                changes[(2 * corner, column)] = change[0];
                changes[(2 * corner + 1, column)] = change[1];
            }
        }
        changes
    }

    /// Whether sizes are positive and not too alike, or the sides of a polygon stay apart.
    #[must_use]
    pub fn is_proper(&self, parameters: &[f64]) -> bool {
        match self {
            Self::Template { slimmest, .. } => {
                let sizes = &parameters[self.n_places()..self.n_parameters()];
                sizes.iter().all(|&size| size > 0.0)
                    && sizes[sizes.len() - 1] <= slimmest * sizes[0]
            }
            Self::Polygon(n_corners) => is_simple(parameters[..2 * n_corners].as_chunks().0),
        }
    }
}

fn arm(axes: &[Vec<[f64; 2]>], sizes: &[f64], corner: usize) -> [f64; 2] {
    axes.iter().zip(sizes).fold([0.0; 2], |arm, (axis, size)| {
        [arm[0] + size * axis[corner][0], arm[1] + size * axis[corner][1]]
    })
}

fn turned([x, y]: [f64; 2], (sin, cos): (f64, f64)) -> [f64; 2] {
    [x * cos - y * sin, x * sin + y * cos]
}

/// Whether all sides have a length, and no two touch but neighbours at their common corner.
fn is_simple(corners: &[[f64; 2]]) -> bool {
    let m = corners.len();
    let side = |i: usize| [corners[i], corners[(i + 1) % m]];
    (0..m).all(|i| {
        let [a, b] = side(i);
        let [_, c] = side((i + 1) % m);
        let folds_back = turn(a, b, c) == 0.0 && along(a, b, b, c) <= 0.0;
        let others = (i + 2..m).filter(|&j| (j + 1) % m != i);
        !folds_back && others.map(side).all(|other| are_apart([a, b], other))
    })
}

/// Twice the area of a triangle, positive when it turns to the left.
fn turn(a: [f64; 2], b: [f64; 2], c: [f64; 2]) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

/// How far the way from `c` to `d` runs along that from `a` to `b`, times the length of the latter.
fn along(a: [f64; 2], b: [f64; 2], c: [f64; 2], d: [f64; 2]) -> f64 {
    (b[0] - a[0]) * (d[0] - c[0]) + (b[1] - a[1]) * (d[1] - c[1])
}

fn are_apart([a, b]: [[f64; 2]; 2], [c, d]: [[f64; 2]; 2]) -> bool {
    let on_sides = |p: f64, q: f64| (p > 0.0 && q > 0.0) || (p < 0.0 && q < 0.0);
    let overlap = |k: usize| a[k].min(b[k]) <= c[k].max(d[k]) && c[k].min(d[k]) <= a[k].max(b[k]);
    on_sides(turn(a, b, c), turn(a, b, d))
        || on_sides(turn(c, d, a), turn(c, d, b))
        || !overlap(0)
        || !overlap(1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn polygons_that_touch_themselves_are_not_simple() {
        let square = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
        assert!(is_simple(&square));
        assert!(is_simple(&square.map(|[x, y]| [y, x])));
        assert!(!is_simple(&[square[0], square[2], square[1], square[3]]));
        let spike = [[0.0, 0.0], [2.0, 0.0], [1.0, 0.0], [1.0, 1.0]];
        assert!(!is_simple(&spike));
        assert!(!is_simple(&[[0.0, 0.0], [0.0, 0.0], [1.0, 0.0], [1.0, 1.0]]));
        let touching = [[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [1.0, 0.0], [0.0, 1.0]];
        assert!(!is_simple(&touching));
    }

    #[test]
    fn sides_on_one_line_may_be_apart() {
        let u = [
            [0.0, 0.0],
            [3.0, 0.0],
            [3.0, 2.0],
            [2.0, 2.0],
            [2.0, 1.0],
            [1.0, 1.0],
            [1.0, 2.0],
            [0.0, 2.0],
        ];
        assert!(is_simple(&u));
    }
}
