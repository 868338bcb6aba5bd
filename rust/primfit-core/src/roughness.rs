//! How the noise about a plane grows with its extent: not at all when it is white, as a power of it
//! where neighbouring points err alike, as in depth images and clouds of many views.

use crate::regions::Region;

/// Points of a region that tells of its roughness.
const TELLING: f64 = 60.0;
/// Second smallest over smallest variance of such a region: layers cut from clutter are thicker.
const THIN: f64 = 36.0;
/// Regions that tell a law.
const FEWEST: usize = 4;
/// Power below which noise counts as white: chance and curved strips reach it.
const WHITE: f64 = 0.15;
/// Largest power: beyond it nothing would be flat at any scale.
const ROUGHEST: f64 = 0.8;

/// Standard deviation about a plane = level x extent ^ power.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Roughness {
    power: f64,
    level: f64,
}

impl Roughness {
    /// The law of a cloud: regression of the logarithms over its regions, weighted by the root of
    /// their points; white when there are too few.
    pub fn of(regions: &[Region]) -> Self {
        let white = Self { power: 0.0, level: 0.0 };
        let telling: Vec<[f64; 3]> = regions
            .iter()
            .filter(|region| region.moments.count >= TELLING)
            .filter_map(|region| {
                let [thin, middle, _] = region.spread().variances;
                // Nothing is told by what rounding leaves of exact planes, nor by layers of clutter.
                (thin > 1e-10 * middle && THIN * thin < middle)
                    .then(|| [middle.ln() / 2.0, thin.ln() / 2.0, region.moments.count.sqrt()])
            })
            .collect();
        if telling.len() < FEWEST {
            return white;
        }
        let total: f64 = telling.iter().map(|row| row[2]).sum();
        let mean = |k: usize| telling.iter().map(|row| row[2] * row[k]).sum::<f64>() / total;
        let (x, y) = (mean(0), mean(1));
        let product = |k: usize, m: f64| {
            telling.iter().map(|row| row[2] * (row[0] - x) * (row[k] - m)).sum::<f64>()
        };
        let power = (product(1, y) / product(0, x)).min(ROUGHEST);
        if power.is_nan() || power < WHITE {
            return white;
        }
        Self { power, level: (y - power * x).exp() }
    }

    /// Standard deviation at an `extent`, of a plane that has `sigma` at the extent `own`; where
    /// noise grows, at least what the law tells, since small flat spots are a matter of luck.
    pub fn sigma(&self, sigma: f64, own: f64, extent: f64) -> f64 {
        if self.power == 0.0 || own <= 0.0 {
            return sigma;
        }
        let grown = sigma * (extent / own).max(1.0).powf(self.power);
        grown.max(self.level * extent.powf(self.power))
    }
}
