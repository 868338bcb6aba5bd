//! Which rays go together: runs of one origin are cut into tiles of sixteen neighbouring beams.

// Lazy operators would be branches.
#![allow(clippy::needless_bitwise_bool)]
#![allow(clippy::inline_always)]

use crate::Vector;

/// Rays of a packet.
pub const RAYS: usize = 16;
/// Rays of a task, at least, where there are as many.
const TASK: usize = 1 << 11;

/// Sixteen beams, or fewer at the margin, of a grid of beams row by row.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tiles {
    /// Beams of a row.
    pub pitch: usize,
    pub width: usize,
    pub height: usize,
    /// From the first ray of a tile to each of its rays.
    steps: [u32; RAYS],
    /// Solid angle of a tile.
    solid_angle: f64,
}

/// Rays side by side: a run of one origin in tiles, or any.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Task {
    pub n_rays: usize,
    pub tiles: Option<Tiles>,
}

/// Cuts rays into tasks; tiles above a solid angle are not made. None when an origin is not finite.
pub fn tasks(origins: &[Vector], directions: &[Vector], largest_tile: f64) -> Option<Vec<Task>> {
    let mut tasks: Vec<Task> = Vec::new();
    let mut first = 0;
    while first < origins.len() {
        if !origins[first].iter().all(|x| x.is_finite()) {
            return None;
        }
        let n_rays = run_of_one(&origins[first..]);
        let tiles = Tiles::of(&directions[first..first + n_rays])
            .filter(|tiles| tiles.is_within(largest_tile));
        first += n_rays;
        if let Some(tiles) = tiles {
            let band = tiles.band();
            let step = band * TASK.div_ceil(band);
            for start in (0..n_rays).step_by(step) {
                tasks.push(Task { n_rays: step.min(n_rays - start), tiles: Some(tiles) });
            }
            continue;
        }
        match tasks.last_mut() {
            Some(Task { n_rays: n, tiles: None }) if *n < TASK => *n += n_rays,
            _ => tasks.push(Task { n_rays, tiles: None }),
        }
        while let Some(last) = tasks.last_mut().filter(|last| last.n_rays > 2 * TASK) {
            let n_rays = last.n_rays - TASK;
            last.n_rays = TASK;
            tasks.push(Task { n_rays, tiles: None });
        }
    }
    Some(tasks)
}

/// How many vectors are like the first.
fn run_of_one(vectors: &[Vector]) -> usize {
    const TOGETHER: usize = 8;
    if vectors.get(1) != Some(&vectors[0]) {
        return 1;
    }
    let first = [vectors[0]; TOGETHER];
    let mut n = 2;
    // Without a way out within a chunk, its numbers are compared as whole vectors.
    while let Some(chunk) = vectors[n..].first_chunk::<TOGETHER>()
        && chunk[0] == first[0]
        && std::iter::zip(chunk.as_flattened(), first.as_flattened())
            .fold(true, |same, (a, b)| same & (a == b))
    {
        n += TOGETHER;
    }
    n + vectors[n..].iter().take_while(|&v| *v == first[0]).count()
}

impl Tiles {
    /// None when neighbours in the array are not neighbours in direction.
    pub fn of(directions: &[Vector]) -> Option<Self> {
        let n = directions.len();
        if n < RAYS {
            return None;
        }
        let step = |i: usize, j: usize| -> Vector {
            std::array::from_fn(|k| directions[j][k] - directions[i][k])
        };
        let square = |a: Vector| a[0] * a[0] + a[1] * a[1] + a[2] * a[2];
        // A row goes on while one step is like the one before.
        let goes_on = |i: usize| {
            let (before, after) = (step(i - 1, i), step(i, i + 1));
            let change = std::array::from_fn(|k| after[k] - before[k]);
            square(change) <= 0.25 * square(before)
        };
        let pitch = (1..n - 1).find(|&i| !goes_on(i)).map_or(n, |i| i + 1);
        // The second row must be like the first.
        if (1..pitch - 1).any(|i| pitch + i + 1 < n && !goes_on(pitch + i)) {
            return None;
        }
        let along = square(step(0, 1)).sqrt();
        let across = if pitch < n { square(step(0, pitch)).sqrt() } else { 0.0 };
        let rows = n.div_ceil(pitch);
        let shape = |width: usize| {
            let height = RAYS / width;
            (width as f64 * along, height as f64 * across)
        };
        let width = [1, 2, 4, 8, 16]
            .into_iter()
            .filter(|width| *width <= pitch && RAYS / width <= rows.next_power_of_two())
            .min_by(|&a, &b| {
                let perimeter = |width| shape(width).0 + shape(width).1;
                perimeter(a).total_cmp(&perimeter(b))
            })?;
        let (wide, high) = shape(width);
        Some(Self::new(pitch, width, RAYS / width, wide * high.max(along)))
    }

    fn new(pitch: usize, width: usize, height: usize, solid_angle: f64) -> Self {
        let steps = std::array::from_fn(|i| (i / width * pitch + i % width) as u32);
        Self { pitch, width, height, steps, solid_angle }
    }

    /// Whether a tile covers no more than a solid angle.
    pub fn is_within(self, solid_angle: f64) -> bool {
        self.solid_angle <= solid_angle
    }

    /// Rays of a row of tiles.
    pub fn band(self) -> usize {
        self.pitch * self.height
    }

    /// How many tiles there are over `n` rays.
    pub fn count(self, n: usize) -> usize {
        n.div_ceil(self.band()) * self.pitch.div_ceil(self.width)
    }

    /// Rows of the rays of a tile, and how many they are; the others repeat the first.
    #[inline(always)]
    pub fn tile(self, tile: usize, n: usize) -> ([u32; RAYS], usize) {
        let across = self.pitch.div_ceil(self.width);
        let first = tile / across * self.band();
        let column = tile % across * self.width;
        let start = first + column;
        let last = start + self.steps[RAYS - 1] as usize;
        if column + self.width <= self.pitch && last < n {
            return (std::array::from_fn(|i| start as u32 + self.steps[i]), RAYS);
        }
        let mut rows = [start as u32; RAYS];
        let mut count = 0;
        for row in 0..self.height {
            for column in column..(column + self.width).min(self.pitch) {
                let ray = first + row * self.pitch + column;
                if ray < n {
                    rows[count] = ray as u32;
                    count += 1;
                }
            }
        }
        (rows, count)
    }
}

#[cfg(test)]
impl From<(usize, usize, usize)> for Tiles {
    fn from((pitch, width, height): (usize, usize, usize)) -> Self {
        Self::new(pitch, width, height, 0.0)
    }
}
