//! Points sorted by the cell of a grid that they lie in.

use super::near;
use crate::workers::Stop;
use crate::{Error, Vector};
use std::ops::Range;

/// Bits that one pass of the sort looks at.
const DIGIT: u32 = 11;
/// Points between two looks at the caller's wish.
const STRIDE: usize = 1 << 20;

/// Where cells lie, how large they are, and how far apart cells within reach can be.
#[derive(Clone, Copy)]
pub struct Lattice {
    low: Vector,
    side: f64,
    reach: u32,
    bits: [u32; 3],
}

impl Lattice {
    pub fn new([low, high]: [Vector; 2], side: f64, reach: u32) -> Self {
        let bits = std::array::from_fn(|k| {
            // One more than the last cell within reach of the last cell.
            let n_cells = ((high[k] - low[k]) / side) as u64 + 2 * u64::from(reach) + 1;
            u64::BITS - n_cells.leading_zeros()
        });
        Self { low, side, reach, bits }
    }

    /// Bits that name a cell.
    pub fn bits(&self) -> u32 {
        self.bits.iter().sum()
    }

    fn cell<K: Key>(&self, point: &Vector) -> K {
        let [x, y, z] = std::array::from_fn(|k| {
            ((point[k] - self.low[k]) / self.side) as u64 + u64::from(self.reach)
        });
        K::pack(x, y, z, self.bits[1], self.bits[2])
    }

    /// The columns of cells that are at most so many cells away, the nearer ones first.
    pub fn columns<K: Key>(&self, reach: i64) -> Vec<Column<K>> {
        let mut steps: Vec<[i64; 2]> =
            (-reach..=reach).flat_map(|x| (-reach..=reach).map(move |y| [x, y])).collect();
        steps.sort_by_key(|[x, y]| x * x + y * y);
        let key = |x: i64, y: i64, z: i64| {
            K::pack(x as u64, y as u64, z as u64, self.bits[1], self.bits[2])
        };
        let column = |[x, y]: [i64; 2]| Column {
            lowest: key(x, y, -reach),
            highest: key(x, y, reach),
            is_after: [x, y] > [0, 0],
        };
        steps.into_iter().map(column).collect()
    }
}

/// A run of cells beside a cell: the steps from its key to the first and the last of theirs.
#[derive(Clone, Copy)]
pub struct Column<K> {
    lowest: K,
    highest: K,
    /// Whether the cells come after the own one; some cells of the own column do, too.
    pub is_after: bool,
}

/// The coordinates of a cell in one number, x first.
pub trait Key: Copy + Ord + Send + Sync {
    /// Negative coordinates wrap around, for steps.
    fn pack(x: u64, y: u64, z: u64, y_bits: u32, z_bits: u32) -> Self;
    fn plus(self, step: Self) -> Self;
    fn digit(self, shift: u32) -> usize;
}

macro_rules! key {
    ($unsigned:ty) => {
        impl Key for $unsigned {
            fn pack(x: u64, y: u64, z: u64, y_bits: u32, z_bits: u32) -> Self {
                let [x, y, z] = [x, y, z].map(|c| c as i64 as $unsigned);
                ((x << y_bits).wrapping_add(y) << z_bits).wrapping_add(z)
            }

            fn plus(self, step: Self) -> Self {
                self.wrapping_add(step)
            }

            fn digit(self, shift: u32) -> usize {
                (self >> shift) as usize & ((1 << DIGIT) - 1)
            }
        }
    };
}

key!(u64);
key!(u128);

/// Rows of points in the order of their cells.
pub struct Order<K> {
    keys: Vec<K>,
    rows: Vec<u32>,
}

impl<K: Key> Order<K> {
    /// Radix sort, lowest digit first.
    pub fn new(points: &[Vector], lattice: &Lattice, stop: &Stop) -> Result<Self, Error> {
        let mut keys: Vec<K> = points.iter().map(|point| lattice.cell(point)).collect();
        let mut rows: Vec<u32> = (0..points.len() as u32).collect();
        let (mut sorted_keys, mut sorted_rows) = (keys.clone(), rows.clone());
        for shift in (0..lattice.bits()).step_by(DIGIT as usize) {
            let mut places = [0_usize; 1 << DIGIT];
            for key in &keys {
                places[key.digit(shift)] += 1;
            }
            let mut place = 0;
            for count in &mut places {
                place += std::mem::replace(count, place);
            }
            for (keys, rows) in keys.chunks(STRIDE).zip(rows.chunks(STRIDE)) {
                stop.check()?;
                for (&key, &row) in keys.iter().zip(rows) {
                    let place = &mut places[key.digit(shift)];
                    sorted_keys[*place] = key;
                    sorted_rows[*place] = row;
                    *place += 1;
                }
            }
            std::mem::swap(&mut keys, &mut sorted_keys);
            std::mem::swap(&mut rows, &mut sorted_rows);
        }
        Ok(Self { keys, rows })
    }

    /// Mean number of points in the cell of a point.
    pub fn company(&self) -> f64 {
        let squares = self.keys.chunk_by(K::eq).map(|cell| (cell.len() as f64).powi(2));
        squares.sum::<f64>() / self.keys.len() as f64
    }

    pub fn gather(self, points: &[Vector]) -> Grid<K> {
        Grid {
            points: self.rows.iter().map(|&row| points[row as usize]).collect(),
            rows: self.rows,
            cells: Cells::of(self.keys.chunk_by(K::eq).map(|cell| (cell[0], cell.len()))),
        }
    }
}

/// Points in the order of their cells.
pub struct Grid<K> {
    pub points: Vec<Vector>,
    /// Where each point came from.
    pub rows: Vec<u32>,
    pub cells: Cells<K>,
}

/// Occupied cells in rising order of their keys, and where their points start.
pub struct Cells<K> {
    keys: Vec<K>,
    starts: Vec<u32>,
}

impl<K: Key> Cells<K> {
    fn of(cells: impl Iterator<Item = (K, usize)>) -> Self {
        let (mut keys, mut starts) = (Vec::new(), vec![0]);
        let mut end = 0;
        for (key, len) in cells.filter(|&(_, len)| len > 0) {
            end += len as u32;
            keys.push(key);
            starts.push(end);
        }
        Self { keys, starts }
    }

    pub fn len(&self) -> usize {
        self.keys.len()
    }

    /// The points of a cell.
    pub fn points(&self, cell: usize) -> Range<usize> {
        self.starts[cell] as usize..self.starts[cell + 1] as usize
    }

    /// The points of a run of cells.
    pub fn span(&self, cells: &Range<usize>) -> Range<usize> {
        self.starts[cells.start] as usize..self.starts[cells.end] as usize
    }

    /// Calls `visit` for each cell that has some of `points`: with the cell, its share of them,
    /// and the runs of cells of `others` around it, one a column.
    pub fn visit_around(
        &self,
        points: Range<usize>,
        others: &Self,
        columns: &[Column<K>],
        mut visit: impl FnMut(usize, Range<usize>, &[Range<usize>]) -> Result<(), Error>,
    ) -> Result<(), Error> {
        let first = self.starts.partition_point(|&start| start as usize <= points.start) - 1;
        // Along z the cells around a cell are one run, whose ends only ever move forward.
        let mut runs: Vec<Range<usize>> = columns
            .iter()
            .map(|column| {
                let lowest = self.keys[first].plus(column.lowest);
                let start = others.keys.partition_point(|&key| key < lowest);
                start..start
            })
            .collect();
        for cell in first..self.len() {
            let own = self.points(cell);
            if own.start >= points.end {
                break;
            }
            for (run, column) in runs.iter_mut().zip(columns) {
                let lowest = self.keys[cell].plus(column.lowest);
                let highest = self.keys[cell].plus(column.highest);
                while run.start < others.len() && others.keys[run.start] < lowest {
                    run.start += 1;
                }
                run.end = run.end.max(run.start);
                while run.end < others.len() && others.keys[run.end] <= highest {
                    run.end += 1;
                }
            }
            visit(cell, own.start.max(points.start)..own.end.min(points.end), &runs)?;
        }
        Ok(())
    }
}

impl<K: Key> Grid<K> {
    pub fn count_near(&self, place: Vector, points: Range<usize>, eps_squared: f64) -> usize {
        self.points[points].iter().filter(|&&point| near(place, point, eps_squared)).count()
    }

    pub fn has_near(&self, place: Vector, points: Range<usize>, eps_squared: f64) -> bool {
        self.points[points].iter().any(|&point| near(place, point, eps_squared))
    }

    /// Whether enough points of some runs of cells are near.
    pub fn is_surrounded(
        &self,
        place: Vector,
        runs: &[Range<usize>],
        min_samples: usize,
        eps_squared: f64,
    ) -> bool {
        let mut count = 0;
        runs.iter().any(|run| {
            count += self.count_near(place, self.cells.span(run), eps_squared);
            count >= min_samples
        })
    }

    /// The points that are chosen, and the others.
    pub fn split(mut self, chosen: &[bool]) -> (Self, Self) {
        let n_chosen = chosen.iter().filter(|&&is| is).count();
        let n_others = chosen.len() - n_chosen;
        let mut others = (Vec::with_capacity(n_others), Vec::with_capacity(n_others));
        let cells_of = |wanted: bool| {
            Cells::of(self.cells.keys.iter().enumerate().map(|(cell, &key)| {
                let chosen = &chosen[self.cells.points(cell)];
                (key, chosen.iter().filter(|&&is| is == wanted).count())
            }))
        };
        let (chosen_cells, other_cells) = (cells_of(true), cells_of(false));
        let mut place = 0;
        for (i, &is) in chosen.iter().enumerate() {
            if is {
                self.points[place] = self.points[i];
                self.rows[place] = self.rows[i];
                place += 1;
            } else {
                others.0.push(self.points[i]);
                others.1.push(self.rows[i]);
            }
        }
        self.points.truncate(place);
        self.rows.truncate(place);
        self.cells = chosen_cells;
        (self, Self { points: others.0, rows: others.1, cells: other_cells })
    }
}
