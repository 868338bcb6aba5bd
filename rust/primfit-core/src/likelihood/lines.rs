//! Beams from above: level lines, by which those that come near a place are found.

use crate::Vector;

/// Least share of a beam that is level, lest it have no way.
const LEAST_LEVEL: f64 = 1e-12;

/// Beams whose origins have a box in common.
const BLOCK: usize = 256;

/// Level lines of beams, relative to their middle: nearness needs no more than single precision.
pub struct LevelLines {
    middle: [f64; 2],
    ways: Vec<[f32; 2]>,
    /// How far to the left of each line the middle is.
    across: Vec<f32>,
    /// How far along its line each beam starts, and the way that it makes along it in a metre.
    steps: Vec<[f32; 2]>,
    /// Lowest and highest origins of each `BLOCK` beams: those of one pose stand together.
    blocks: Vec<[[f32; 2]; 2]>,
}

impl LevelLines {
    /// Of beams with unit directions.
    #[must_use]
    pub fn new(origins: &[Vector], directions: &[Vector]) -> Self {
        let share = 1.0 / origins.len().max(1) as f64;
        let middle = [0, 1].map(|k| origins.iter().map(|origin| share * origin[k]).sum());
        let mut lines = Self {
            middle,
            ways: Vec::with_capacity(origins.len()),
            across: Vec::with_capacity(origins.len()),
            steps: Vec::with_capacity(origins.len()),
            blocks: Vec::with_capacity(origins.len() / BLOCK + 1),
        };
        for (&[x, y, _], &[ux, uy, _]) in origins.iter().zip(directions) {
            let level = ux.hypot(uy).max(LEAST_LEVEL);
            let ([x, y], [dx, dy]) = ([x - middle[0], y - middle[1]], [ux / level, uy / level]);
            lines.ways.push([dx as f32, dy as f32]);
            lines.across.push((y * dx - x * dy) as f32);
            lines.steps.push([(x * dx + y * dy) as f32, level as f32]);
        }
        for block in origins.chunks(BLOCK) {
            let places = block.iter().map(|origin| lines.relative([origin[0], origin[1]]));
            let none = [[f32::INFINITY; 2], [f32::NEG_INFINITY; 2]];
            lines.blocks.push(places.fold(none, |[low, high], [x, y]| {
                [[low[0].min(x), low[1].min(y)], [high[0].max(x), high[1].max(y)]]
            }));
        }
        lines
    }

    fn relative(&self, place: [f64; 2]) -> [f32; 2] {
        [0, 1].map(|k| (place[k] - self.middle[k]) as f32)
    }

    /// How far a place is to the left of a line.
    fn left(&self, row: usize, [x, y]: [f32; 2]) -> f32 {
        let [dx, dy] = self.ways[row];
        y * dx - x * dy - self.across[row]
    }

    /// How far along its line from where a beam starts a place is.
    fn along(&self, row: usize, [x, y]: [f32; 2]) -> f32 {
        let [dx, dy] = self.ways[row];
        x * dx + y * dy - self.steps[row][0]
    }

    /// How many there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.ways.len()
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.ways.is_empty()
    }

    /// The beams, one in `stride`, that come within `radius` of a place before they have gone as
    /// far as `reach`.
    #[must_use]
    pub fn near(&self, place: [f64; 2], radius: f64, reach: f64, stride: usize) -> Vec<usize> {
        let place = self.relative(place);
        let (radius, reach) = (radius as f32, reach as f32);
        let comes_near = |&row: &usize| {
            self.left(row, place).abs() < radius && {
                let along = self.along(row, place);
                along > -radius && along - radius < reach * self.steps[row][1]
            }
        };
        let mut rows = Vec::new();
        let mut first = 0;
        while first < self.len() {
            let block = first / BLOCK;
            let end = self.len().min((block + 1) * BLOCK);
            let some = (first..end).step_by(stride);
            first += some.len() * stride;
            let [low, high] = self.blocks[block];
            let off = [0, 1].map(|k| (low[k] - place[k]).max(place[k] - high[k]).max(0.0));
            if off[0].hypot(off[1]) < 1.001 * (radius + reach) {
                rows.extend(some.filter(comes_near));
            }
        }
        rows
    }

    /// How far some beams have gone where they may come within `radius` of a place.
    pub fn entries(
        &self,
        rows: impl IntoIterator<Item = usize>,
        place: [f64; 2],
        radius: f64,
    ) -> Vec<f64> {
        let (place, radius) = (self.relative(place), radius as f32);
        let entry = |row| f64::from((self.along(row, place) - radius) / self.steps[row][1]);
        rows.into_iter().map(entry).collect()
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
        let (place, radius) = (self.relative(place), radius as f32);
        let part = |share: f32, n: usize| ((share * n as f32) as usize).min(n - 1);
        let bundle = |row: usize| {
            let [dx, dy] = self.ways[row];
            let turn = dy.atan2(dx) / std::f32::consts::TAU + 0.5;
            let side = f32::midpoint(self.left(row, place) / radius, 1.0);
            part(turn, n_ways) * n_sides + part(side, n_sides)
        };
        rows.into_iter().map(bundle).collect()
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
        assert!((entries[0] - 1.8).abs() < 1e-6 && (entries[1] - 3.0).abs() < 1e-6);
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
