//! Beams from above: level lines, by which those that come near a place are found.

use crate::Vector;

/// Least share of a beam that is level, lest it have no way.
const LEAST_LEVEL: f64 = 1e-12;

/// Level lines of beams.
pub struct LevelLines(Vec<Line>);

struct Line {
    way: [f64; 2],
    /// How far along the line the beam starts.
    start: f64,
    /// How far to the left of the line the origin is.
    across: f64,
    /// The way that the beam makes along its line in a metre.
    level: f64,
}

impl Line {
    /// How far along the line a place is from the beam's start, and how far to its left.
    fn relative(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let [dx, dy] = self.way;
        [x * dx + y * dy - self.start, y * dx - x * dy - self.across]
    }
}

impl LevelLines {
    /// Of beams with unit directions.
    #[must_use]
    pub fn new(origins: &[Vector], directions: &[Vector]) -> Self {
        let line = |([x, y, _], [ux, uy, _]): (&Vector, &Vector)| {
            let level = ux.hypot(*uy).max(LEAST_LEVEL);
            let [dx, dy] = [ux / level, uy / level];
            Line { way: [dx, dy], start: x * dx + y * dy, across: y * dx - x * dy, level }
        };
        Self(origins.iter().zip(directions).map(line).collect())
    }

    /// How many there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// The beams, one in `stride`, that come within `radius` of a place before they have gone as
    /// far as `reach`.
    #[must_use]
    pub fn near(&self, place: [f64; 2], radius: f64, reach: f64, stride: usize) -> Vec<usize> {
        let comes_near = |line: &Line| {
            let [along, left] = line.relative(place);
            left.abs() < radius && along > -radius && along - radius < reach * line.level
        };
        let some = self.0.iter().enumerate().step_by(stride);
        some.filter(|(_, line)| comes_near(line)).map(|(row, _)| row).collect()
    }

    /// How far some beams have gone where they may come within `radius` of a place.
    pub fn entries(
        &self,
        rows: impl IntoIterator<Item = usize>,
        place: [f64; 2],
        radius: f64,
    ) -> Vec<f64> {
        let entry = |line: &Line| (line.relative(place)[0] - radius) / line.level;
        rows.into_iter().map(|row| entry(&self.0[row])).collect()
    }

    /// The bundle of each of some beams: in about the same of so many directions, and on the same
    /// of so many sides of a place, within `radius`.
    pub fn bundles(
        &self,
        rows: impl IntoIterator<Item = usize>,
        place: [f64; 2],
        radius: f64,
        [n_ways, n_sides]: [usize; 2],
    ) -> Vec<usize> {
        let part = |share: f64, n: usize| ((share * n as f64) as usize).min(n - 1);
        let bundle = |line: &Line| {
            let [dx, dy] = line.way;
            let turn = dy.atan2(dx) / std::f64::consts::TAU + 0.5;
            let side = f64::midpoint(line.relative(place)[1] / radius, 1.0);
            part(turn, n_ways) * n_sides + part(side, n_sides)
        };
        rows.into_iter().map(|row| bundle(&self.0[row])).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_that_come_near() {
        let origins = [[0.0, 0.0, 0.3], [0.0, 1.0, 0.3], [3.0, 0.0, 0.3], [0.0; 3]];
        let steep = [0.6, 0.0, 0.8];
        let lines = LevelLines::new(&origins, &[[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], steep, steep]);
        let place = [2.0, 0.1];
        assert_eq!(lines.near(place, 0.2, 5.0, 1), [0, 3]);
        assert_eq!(lines.near(place, 0.2, 5.0, 2), [0]);
        // Steeply upwards it has not come so far.
        assert_eq!(lines.near(place, 0.2, 2.9, 1), [0]);
        assert_eq!(lines.near(place, 1.01, 5.0, 1), [0, 2, 3]);
        let entries = lines.entries([0, 3], place, 0.2);
        assert!((entries[0] - 1.8).abs() < 1e-12 && (entries[1] - 3.0).abs() < 1e-12);
    }

    #[test]
    fn bundles_of_beams_that_run_alike() {
        let origins = [[0.0, 0.0, 0.0], [0.0, 0.01, 0.5], [0.0, 0.09, 0.0], [4.0, 0.0, 0.0]];
        let lines = LevelLines::new(&origins, &[[1.0, 1e-3, 0.0]; 4]);
        let bundles = lines.bundles(0..4, [2.0, 0.05], 0.1, [4, 2]);
        assert_eq!(bundles[0], bundles[3]);
        assert_ne!(bundles[0], bundles[2]);
        let back = LevelLines::new(&origins, &[[-1.0, -1e-3, 0.0]; 4]);
        assert!(back.bundles(0..4, [2.0, 0.05], 0.1, [4, 2]).iter().all(|b| !bundles.contains(b)));
        // Beside the place by the radius, or more.
        assert_eq!(lines.bundles([0], [0.0, 0.1], 0.1, [1, 2]), [1]);
        assert_eq!(lines.bundles([0], [0.0, 9.0], 0.1, [1, 2]), [1]);
        assert_eq!(lines.bundles([0], [0.0, -9.0], 0.1, [1, 2]), [0]);
    }
}
