//! Sampling a posterior whose cost jumps: silhouettes make the likelihood of a solid do so.
//!
//! Cornuet, Marin, Mira, Robert: Adaptive Multiple Importance Sampling, Scandinavian Journal of
//! Statistics 39, 2012.

use super::student::Student;
use nalgebra::{DMatrix, DVector};
use rand_xoshiro::Xoshiro256PlusPlus;
use rand_xoshiro::rand_core::SeedableRng;

/// Generations that are remembered.
const MEMORY: usize = 8;
/// Effective share of the draws of a generation by which the next one is adapted.
const LEAST_SIZE: f64 = 0.3;
/// Relative error of the power by which weights are tempered.
const POWER: f64 = 0.05;
/// By how much the variance of a generation exceeds that of the weighted ones before.
const GROWTH: f64 = 1.1;

/// How hard [`sample`] tries.
#[derive(Clone, Copy, Debug)]
pub struct Effort {
    /// Draws of a generation.
    pub n: usize,
    /// Most generations.
    pub generations: usize,
    /// Effective number of draws at which it ends.
    pub wanted: f64,
}

/// What draws say of the parameters.
#[derive(Clone, Debug)]
pub struct Posterior {
    /// Mean of the parameters.
    pub mean: Vec<f64>,
    /// Their covariance, rows first.
    pub covariance: Vec<f64>,
    /// Parameters of least cost seen.
    pub best: Vec<f64>,
    /// Theirs.
    pub cost: f64,
    /// Logarithm of the integral of `exp(-cost)`.
    pub log_evidence: f64,
    /// Effective number of draws behind mean, covariance and evidence.
    pub size: f64,
}

/// Adaptive importance sampling with a Student proposal that follows the posterior.
///
/// Each generation is drawn from mean and covariance of the ones before, weighted against the
/// mixture of their proposals; where few draws would carry all the weight, the weights are
/// tempered. It ends when the draws are worth as many independent ones as are wanted.
///
/// `cost` tells the negative log-likelihood of each of some draws, row by row; infinite where they
/// are not admitted. It begins with a mean and a covariance, rows first.
///
/// # Errors
/// Those of `cost`.
///
/// # Panics
/// When `cost` does not answer each draw.
pub fn sample<E>(
    mut cost: impl FnMut(&[f64]) -> Result<Vec<f64>, E>,
    mean: &[f64],
    covariance: &[f64],
    seed: u64,
    effort: Effort,
) -> Result<Posterior, E> {
    let d = mean.len();
    let (mut best, mut least) = (mean.to_vec(), f64::INFINITY);
    let mut mean = DVector::from_column_slice(mean);
    let mut covariance = DMatrix::from_row_slice(d, d, covariance);
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
    let mut draws = Draws::new(d, effort.n);
    let mut weights = Weights::default();
    for _ in 0..effort.generations {
        let drawn = draws.draw(Student::new(&mean, &covariance), &mut rng);
        let costs = cost(drawn)?;
        for (draw, &cost) in drawn.chunks_exact(d).zip(&costs) {
            if cost < least {
                (best, least) = (draw.to_vec(), cost);
            }
        }
        draws.assess(&costs);
        if draws.are_few() {
            // Too few are admitted to tell a spread.
            mean.copy_from_slice(&best);
            covariance /= 4.0;
            continue;
        }
        weights = draws.weights();
        if size(&weights.to_power(1.0)) >= effort.wanted {
            break;
        }
        let (center, around) = draws.moments(&weights.tempered(LEAST_SIZE * effort.n as f64));
        mean = center;
        // It shrinks by steps, lest a single draw with all the weight leave none.
        covariance = GROWTH * around + 1e-4 * covariance;
    }
    let (mut log_evidence, mut n_effective) = (f64::NEG_INFINITY, 0.0);
    if draws.are_few() {
        mean.copy_from_slice(&best);
    } else {
        let shares = weights.to_power(1.0);
        n_effective = size(&shares);
        log_evidence = (shares.iter().sum::<f64>() / shares.len() as f64).ln() + weights.highest;
        (mean, covariance) = draws.moments(&shares);
        // The spread of few draws is too small by about this much, as in Hotelling's statistic.
        covariance *= (n_effective + 1.0) / (n_effective - d as f64 - 2.0).max(1.0);
    }
    Ok(Posterior {
        mean: mean.as_slice().to_vec(),
        covariance: covariance.as_slice().to_vec(),
        best,
        cost: least,
        log_evidence,
        size: n_effective,
    })
}

/// The last generations of draws; each takes the place of the one [`MEMORY`] before.
struct Draws {
    d: usize,
    n: usize,
    /// Generations so far.
    age: usize,
    proposals: Vec<Student>,
    parameters: Vec<f64>,
    costs: Vec<f64>,
    /// Of each draw, by each of the proposals.
    densities: Vec<[f64; MEMORY]>,
}

impl Draws {
    fn new(d: usize, n: usize) -> Self {
        Self {
            d,
            n,
            age: 0,
            proposals: Vec::new(),
            parameters: Vec::new(),
            costs: Vec::new(),
            densities: Vec::new(),
        }
    }

    /// The place of the last generation.
    fn last(&self) -> usize {
        (self.age - 1) % MEMORY
    }

    /// Draws a generation, the first of which is the mean of its proposal.
    fn draw(&mut self, proposal: Student, rng: &mut Xoshiro256PlusPlus) -> &[f64] {
        let (d, n) = (self.d, self.n);
        self.age += 1;
        let place = self.last();
        if place == self.proposals.len() {
            self.proposals.push(proposal);
            self.parameters.resize((place + 1) * n * d, 0.0);
            self.costs.resize((place + 1) * n, f64::INFINITY);
            self.densities.resize((place + 1) * n, [0.0; MEMORY]);
        } else {
            self.proposals[place] = proposal;
        }
        let own = place * n..(place + 1) * n;
        let drawn = &mut self.parameters[own.start * d..own.end * d];
        self.proposals[place].center(&mut drawn[..d]);
        for draw in drawn[d..].chunks_exact_mut(d) {
            self.proposals[place].draw(rng, draw);
        }
        let rows = self.parameters.chunks_exact(d).zip(&mut self.densities).enumerate();
        for (row, (draw, densities)) in rows {
            if own.contains(&row) {
                for (density, proposal) in densities.iter_mut().zip(&self.proposals) {
                    *density = proposal.density(draw);
                }
            } else {
                densities[place] = self.proposals[place].density(draw);
            }
        }
        &self.parameters[own.start * d..own.end * d]
    }

    /// Takes the costs of the last generation.
    fn assess(&mut self, costs: &[f64]) {
        let first = self.last() * self.n;
        self.costs[first..first + self.n].copy_from_slice(costs);
    }

    /// Whether too few are admitted to tell a spread.
    fn are_few(&self) -> bool {
        self.costs.iter().filter(|cost| cost.is_finite()).count() <= 2 * self.d
    }

    fn weights(&self) -> Weights {
        let share = 1.0 / self.proposals.len() as f64;
        let logs = self.costs.iter().zip(&self.densities).map(|(cost, densities)| {
            let mixture = share * densities.iter().sum::<f64>();
            -cost - mixture.ln()
        });
        Weights::new(logs.collect())
    }

    /// Mean and covariance of weighted draws.
    fn moments(&self, weights: &[f64]) -> (DVector<f64>, DMatrix<f64>) {
        let scale = 1.0 / weights.iter().sum::<f64>();
        let draws = || self.parameters.chunks_exact(self.d).zip(weights.iter().map(|w| w * scale));
        let mut mean = DVector::zeros(self.d);
        for (draw, share) in draws() {
            for (sum, x) in mean.iter_mut().zip(draw) {
                *sum += share * x;
            }
        }
        let mut covariance = DMatrix::zeros(self.d, self.d);
        for (draw, share) in draws() {
            for i in 0..self.d {
                let off = share * (draw[i] - mean[i]);
                for j in 0..=i {
                    covariance[(i, j)] += off * (draw[j] - mean[j]);
                }
            }
        }
        covariance.fill_upper_triangle_with_lower_triangle();
        (mean, covariance)
    }
}

/// Logarithms of weights.
#[derive(Default)]
struct Weights {
    highest: f64,
    /// By how much each is behind that, negative.
    behind: Vec<f64>,
}

impl Weights {
    fn new(mut logs: Vec<f64>) -> Self {
        let highest = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        for log in &mut logs {
            *log -= highest;
        }
        Self { highest, behind: logs }
    }

    /// Weights to a power, the largest 1.
    fn to_power(&self, power: f64) -> Vec<f64> {
        self.behind.iter().map(|log| (power * log).exp()).collect()
    }

    /// Weights to the largest power, 1 at the most, with an effective size of `least_size`.
    fn tempered(&self, least_size: f64) -> Vec<f64> {
        let admitted = |log: &f64| f64::from(log.is_finite());
        if self.behind.iter().map(admitted).sum::<f64>() <= least_size {
            return self.behind.iter().map(admitted).collect();
        }
        let whole = self.to_power(1.0);
        if size(&whole) >= least_size {
            return whole;
        }
        let (mut low, mut high) = (0.0, 1.0);
        while high - low > POWER * high {
            let middle = f64::midpoint(low, high);
            if size(&self.to_power(middle)) > least_size {
                low = middle;
            } else {
                high = middle;
            }
        }
        self.to_power(low)
    }
}

/// Effective number of weighted draws (Kish).
fn size(weights: &[f64]) -> f64 {
    weights.iter().sum::<f64>().powi(2) / weights.iter().map(|w| w * w).sum::<f64>()
}
