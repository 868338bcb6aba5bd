//! The plane around each point, at the smallest scale that shows one.

use super::vicinity::{Ranking, Vicinity};
use super::{Neighbor, PointTree};
use crate::spread::{Moments, Spread, Sums};
use crate::{Error, Vector, Workers};

/// Sizes of neighbourhoods that are tried, smallest first.
const SIZES: [usize; 11] = [12, 16, 24, 32, 48, 64, 96, 128, 192, 256, 384];
/// Neighbours that most points are content with, and that all others get.
const FEW: usize = 96;
/// Most neighbours that are looked at.
pub const MOST: usize = 384;
/// Second smallest over smallest variance of a neighbourhood that is flat; more for small ones,
/// where chance flattens (by chance 17.9 with 12 points, 5.7 with 24, once in 10 000).
pub const FLAT: f64 = 6.0;
const FLAT_BY_CHANCE: f64 = 48.0 * FLAT;
/// Second largest over largest variance below which a neighbourhood is a line.
const LINE: f64 = 0.06;
/// How much larger the neighbourhood is of which a share must lie near the plane too. One ring of
/// a spinning sensor spans a perfect plane, which its neighbours do not lie on.
const WIDER: usize = 4;
const SUPPORT: f64 = 0.4;
/// Standard deviations within which a point lies near the plane.
const NEAR: f64 = 3.0;
/// Standard errors by which the variance of a flat neighbourhood may exceed the given one.
const THICKER: f64 = 4.0;
/// How much thicker than the noise a neighbourhood may be in which a plane is still looked for.
pub const THICKEST: f64 = 3.0;
/// Least standard deviation, as a fraction of the neighbourhood's radius: what rounding leaves.
pub const FLOOR: f64 = 1e-7;

/// Points that tell whether a neighbourhood is in two sheets, and their bimodality (Sarle's
/// coefficient: 0.33 for a normal distribution, 0.56 for an even one, 1 for two values) from which
/// it is: sheets 5 sigma apart have 0.65, 10 sigma apart 0.87.
const TELLS_LAYERS: usize = 48;
const TWO: f64 = 0.65;
/// How much thinner a sheet is than what it is part of: with two of them 5 sigma apart, 2.7 times.
const THINNER: f64 = 2.0;
/// Steps of the two means that part the sheets.
const CUTS: usize = 3;

/// Bytes that a plane and a normal take with what they are turned into.
const PLANE_BYTES: usize = 120;
const NORMAL_BYTES: usize = 56;

/// The plane of a neighbourhood.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct LocalPlane {
    /// Unit normal; zero when there are too few points.
    pub normal: Vector,
    /// Standard deviation of the neighbourhood across the plane.
    pub sigma: f64,
    /// Second smallest over smallest variance.
    pub flatness: f64,
    /// Points of the neighbourhood.
    pub size: u32,
    /// Whether the neighbourhood passes as flat; else it is the flattest of all.
    pub is_flat: bool,
}

impl PointTree {
    /// The plane around every `step`-th point, in the order of the tree.
    ///
    /// With `sigma`, the noise of each point in the same order, a neighbourhood is flat when it is
    /// as thin as that noise, whatever its chance variance.
    ///
    /// # Errors
    /// [`Error::Stopped`] when the caller does not want to go on.
    pub fn local_planes(
        &self,
        sigma: Option<&[f64]>,
        step: usize,
        workers: &Workers,
    ) -> Result<Vec<LocalPlane>, Error> {
        workers.room(PLANE_BYTES * self.points().len().div_ceil(step))?;
        let mut planes = vec![LocalPlane::default(); self.points().len().div_ceil(step)];
        workers.fill(
            &mut planes,
            1,
            || [(); 2].map(|()| Vicinity::new(self)),
            |[few, most], i, plane| {
                let i = i * step;
                let point = &self.points()[i];
                let sigma = sigma.map(|sigma| sigma[i]);
                plane[0] = self.flattest(point, few.nearest(i, FEW), sigma, FEW / WIDER);
                if !plane[0].is_flat {
                    most.expect(i, MOST, few);
                    plane[0] = self.flattest(point, most.nearest(i, MOST), sigma, MOST);
                }
            },
        )?;
        Ok(planes)
    }

    /// The unit normal of the `k` points nearest to each, by least squares, in the order in which
    /// points were given; zero where there are fewer than 3.
    ///
    /// # Errors
    /// [`Error::Stopped`] when the caller does not want to go on.
    pub fn normals(&self, k: usize, workers: &Workers) -> Result<Vec<Vector>, Error> {
        workers.room(NORMAL_BYTES * self.points().len())?;
        let mut normals = vec![[0.0; 3]; self.points().len()];
        if k.min(normals.len()) >= 3 {
            workers.fill(
                &mut normals,
                1,
                || Vicinity::new(self),
                |vicinity, i, normal| {
                    let near = vicinity.nearest_by_place(i, k).iter();
                    let near = near.map(|&place| &self.points()[place as usize]);
                    normal[0] = Moments::of(near, &self.points()[i]).spread().normal;
                },
            )?;
        }
        let mut given = vec![[0.0; 3]; normals.len()];
        for (&row, normal) in self.rows().iter().zip(normals) {
            given[row as usize] = normal;
        }
        Ok(given)
    }

    /// Looks again at neighbourhoods that are not flat, now that the noise is known around them:
    /// the largest one that is as thin.
    ///
    /// # Errors
    /// [`Error::Stopped`] when the caller does not want to go on.
    pub fn thin_planes(
        &self,
        local: &mut [LocalPlane],
        noise: &[f32],
        step: usize,
        workers: &Workers,
    ) -> Result<(), Error> {
        workers.fill(
            local,
            1,
            || Vicinity::new(self),
            |vicinity, i, plane| {
                let i = i * step;
                let sigma = f64::from(noise[i]);
                if !plane[0].is_flat && plane[0].sigma <= THICKEST * sigma {
                    let point = &self.points()[i];
                    let found = vicinity.nearest(i, MOST);
                    plane[0] = self.flattest(point, found, Some(sigma), MOST);
                }
            },
        )
    }

    /// The plane of the first size that is flat, up to `largest`; else of the flattest.
    fn flattest(
        &self,
        point: &Vector,
        mut found: Ranking,
        sigma: Option<f64>,
        largest: usize,
    ) -> LocalPlane {
        let mut sums = Sums::new(*point);
        let mut taken = 0;
        let mut wide = Vec::new();
        let mut best = LocalPlane::default();
        let mut best_rank = (false, -1.0);
        for size in SIZES.into_iter().filter(|&size| size <= largest) {
            let size = size.min(found.len());
            if size == taken || size < 4 {
                break;
            }
            for place in found.first(size).skip(taken) {
                sums.add(&self.points()[place as usize]);
            }
            taken = size;
            let spread = sums.moments().spread();
            let [thin, middle, long] = spread.variances;
            let n = size as f64;
            let thin = (thin * n / (n - 3.0)).max(FLOOR * FLOOR * long).max(f64::MIN_POSITIVE);
            let (variance, least) = match sigma {
                Some(sigma) if thin <= (1.0 + THICKER * (2.0 / n).sqrt()) * sigma * sigma => {
                    (sigma * sigma, FLAT)
                }
                _ => (thin, FLAT.max(FLAT_BY_CHANCE / n)),
            };
            let flatness = middle / variance;
            let is_thin = flatness > least && middle > LINE * long;
            if !is_thin && (true, flatness / least) <= best_rank {
                continue;
            }
            let n_wider = found.len().min(WIDER * size);
            let near = NEAR * variance.sqrt();
            let support = found
                .among(n_wider)
                .filter(|&place| spread.distance(&self.points()[place as usize]).abs() <= near)
                .count();
            let is_supported = support as f64 >= SUPPORT * n_wider as f64;
            let mut is_flat = is_thin && is_supported;
            if is_flat && sigma.is_none() && found.len() >= TELLS_LAYERS {
                wide.clear();
                wide.extend(found.first(size.max(TELLS_LAYERS)));
                match self.layer(&wide, point) {
                    Layer::Own(layer) if THINNER * layer.sigma < variance.sqrt() => {
                        best = layer;
                        break;
                    }
                    Layer::Unclear => is_flat = size < TELLS_LAYERS,
                    _ => (),
                }
            }
            // Whatever holds together beats what only one row of the scan lies on.
            let rank = (is_supported, flatness / least);
            if is_flat || rank > best_rank {
                best_rank = rank;
                best = LocalPlane {
                    normal: spread.normal,
                    sigma: variance.sqrt(),
                    flatness,
                    size: size as u32,
                    is_flat,
                };
            }
            if is_flat {
                break;
            }
        }
        best
    }
}

/// What a flat neighbourhood is made of.
enum Layer {
    /// One sheet of points.
    Only,
    /// Two, and the point is in a flat one.
    Own(LocalPlane),
    /// Two, or what is left of them.
    Unclear,
}

impl PointTree {
    /// Whether the points across a plane lie in two sheets, and the one in which the point is.
    fn layer(&self, found: &[u32], point: &Vector) -> Layer {
        let mut sums = Sums::new(*point);
        for &place in found {
            sums.add(&self.points()[place as usize]);
        }
        let spread = sums.moments().spread();
        let heights: Vec<f64> =
            found.iter().map(|&place| spread.distance(&self.points()[place as usize])).collect();
        let n = heights.len() as f64;
        let moment = |k: i32| heights.iter().map(|h| h.powi(k)).sum::<f64>() / n;
        let [second, third, fourth] = [2, 3, 4].map(moment);
        if second <= 0.0 || third * third / second.powi(3) + 1.0 <= TWO * fourth / second.powi(2) {
            return Layer::Only;
        }
        let mut cut = 0.0;
        for _ in 0..CUTS {
            let mean = |above: bool| {
                let own = || heights.iter().filter(|&&h| (h > cut) == above);
                own().sum::<f64>() / (own().count() as f64).max(1.0)
            };
            cut = f64::midpoint(mean(true), mean(false));
        }
        let side = spread.distance(point) > cut;
        let mut sums = Sums::new(*point);
        let own = found.iter().zip(&heights).filter(|(_, h)| (**h > cut) == side);
        for (&place, _) in own {
            sums.add(&self.points()[place as usize]);
        }
        let moments = sums.moments();
        if moments.count < SIZES[0] as f64 {
            return Layer::Unclear;
        }
        let own = moments.spread();
        let [thin, middle, long] = own.variances;
        let m = moments.count;
        let thin = (thin * m / (m - 3.0)).max(FLOOR * FLOOR * long).max(f64::MIN_POSITIVE);
        if middle <= thin * FLAT.max(FLAT_BY_CHANCE / m) || middle <= LINE * long {
            return Layer::Unclear;
        }
        Layer::Own(LocalPlane {
            normal: own.normal,
            sigma: thin.sqrt(),
            flatness: middle / thin,
            size: found.len() as u32,
            is_flat: true,
        })
    }
}

/// The plane of some of the points, hard-cut at `reach` and fitted again, and which are within.
pub fn cut_plane(
    points: &[Vector],
    window: &[Neighbor],
    start: Option<Spread>,
    reach: f64,
    n_times: usize,
    within: &mut Vec<u32>,
) -> Spread {
    let origin = points[window[0].place as usize];
    let of = |places: &[u32]| {
        let mut sums = Sums::new(origin);
        for &place in places {
            sums.add(&points[place as usize]);
        }
        sums.moments().spread()
    };
    within.clear();
    within.extend(window.iter().map(|n| n.place));
    let mut spread = start.unwrap_or_else(|| of(within));
    for _ in 0..n_times {
        within.clear();
        within.extend(
            window
                .iter()
                .map(|n| n.place)
                .filter(|&place| spread.distance(&points[place as usize]).abs() <= reach),
        );
        if within.len() < 4 {
            break;
        }
        spread = of(within);
    }
    spread
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    /// Noise that is found around the points of two sheets of 10 m2 so far apart, with 10 mm.
    fn noise(apart: f64) -> f64 {
        let points: Vec<Vector> = (0..8000_u32)
            .map(|i| {
                let (u, v) = (f64::from(i) * 0.618_034 % 1.0, f64::from(i) * 0.754_878 % 1.0);
                // As even noise, of this standard deviation.
                let off = 0.01 * 12.0_f64.sqrt() * ((1e4 * f64::from(i).sin()).fract().abs() - 0.5);
                [4.0 * u, 2.5 * v, off + apart * f64::from(i / 2 % 2)]
            })
            .collect();
        let workers = Workers::new(Some(1), &(|| true)).unwrap();
        let planes = PointTree::new(&points).local_planes(None, 1, &workers).unwrap();
        let mut sigmas: Vec<f64> =
            planes.iter().filter(|plane| plane.is_flat).map(|plane| plane.sigma).collect();
        let middle = sigmas.len() / 2;
        *sigmas.select_nth_unstable_by(middle, f64::total_cmp).1
    }

    #[test]
    fn two_sheets_have_the_noise_of_each() {
        for apart in [0.0, 0.1, 0.2] {
            let found = noise(apart);
            assert!((found / 0.01 - 1.0).abs() < 0.15, "{apart}: {found}");
        }
    }
}
