//! The likelihood near one prism: a quadratic, and the beams at its silhouettes.

use super::beams::{BeamBlocks, Candidate};
use super::costs::costs;
use super::expansion::{Expansion, expand};
use super::family::Family;
use super::meeting::{Beam, Real};
use crate::{Error, Vector, Workers};

/// Where a prism may be for [`Local`] to tell its cost.
#[derive(Clone, Copy)]
pub struct Region<'a> {
    /// The prism in the middle.
    pub candidate: Candidate<'a>,
    /// How far corners may be from its own.
    pub slack: f64,
    /// The same of the top.
    pub top_slack: f64,
}

/// The likelihood of prisms near a given one.
pub struct Local {
    footprint: Vec<[f64; 2]>,
    bottom: f64,
    top: f64,
    slack: f64,
    top_slack: f64,
    /// How many beams each stands for.
    weight: f64,
    /// Of the beams that meet the same wall for all such prisms.
    pub smooth: Expansion,
    open: Vec<Beam<Real>>,
    middle: Vector,
    is_round: bool,
    is_open: bool,
}

impl Local {
    /// By some beams, each of which counts `weight` times.
    #[must_use]
    pub fn new(beams: &BeamBlocks, region: Region, weight: f64) -> Self {
        let Region { candidate, slack, top_slack } = region;
        let mut smooth = expand(beams, &candidate, slack, top_slack);
        smooth.cost *= weight;
        for sum in smooth.gradient.iter_mut().chain(&mut smooth.information) {
            *sum *= weight;
        }
        Self {
            footprint: candidate.footprint.to_vec(),
            bottom: candidate.bottom,
            top: candidate.top,
            slack,
            top_slack,
            weight,
            open: smooth.open.iter().map(|&i| beams.beams[i]).collect(),
            smooth,
            middle: beams.middle,
            is_round: candidate.is_round,
            is_open: candidate.is_open,
        }
    }

    /// Whether such prisms have footprints of a family: as many corners, or an ellipse.
    #[must_use]
    pub fn is_of(&self, family: &Family) -> bool {
        (self.footprint.len(), self.is_round) == (family.n_corners(), family.is_round())
    }

    /// Negative log-likelihood of members of a family, by rows of its parameters; those that are
    /// not proper or too far away cost infinitely much. A parameter beyond the family's is the top.
    ///
    /// # Errors
    /// [`Error::Stopped`] when the caller does not want to go on.
    pub fn costs(
        &self,
        family: &Family,
        rows: &[&[f64]],
        workers: &Workers,
    ) -> Result<Vec<f64>, Error> {
        let mut all = vec![f64::INFINITY; rows.len()];
        let (mut near, mut corners, mut tops) = (Vec::new(), Vec::new(), Vec::new());
        for (i, row) in rows.iter().enumerate() {
            let top = row.get(family.n_parameters()).copied().unwrap_or(self.top);
            if (top - self.top).abs() > self.top_slack || !family.is_proper(row) {
                continue;
            }
            let first = corners.len();
            corners.extend(family.footprint(row));
            if let Some(cost) = self.smooth_cost(&corners[first..]) {
                all[i] = cost;
                near.push(i);
                tops.push(top);
            } else {
                corners.truncate(first);
            }
        }
        let candidates: Vec<Candidate> = corners
            .chunks(self.footprint.len())
            .zip(&tops)
            .map(|(footprint, &top)| Candidate {
                footprint,
                is_round: self.is_round,
                bottom: self.bottom,
                top,
                is_open: self.is_open,
            })
            .collect();
        let costs = costs(&self.open, self.middle, &candidates, workers)?;
        for (i, cost) in near.into_iter().zip(costs) {
            all[i] += self.weight * cost;
        }
        Ok(all)
    }

    /// By the beams that are not open; none where a corner is too far away.
    fn smooth_cost(&self, footprint: &[[f64; 2]]) -> Option<f64> {
        let moves: Vec<f64> = footprint
            .iter()
            .zip(&self.footprint)
            .flat_map(|(there, here)| [there[0] - here[0], there[1] - here[1]])
            .collect();
        let is_near = |[x, y]: &[f64; 2]| x * x + y * y <= self.slack * self.slack;
        if !moves.as_chunks().0.iter().all(is_near) {
            return None;
        }
        let slopes = self.smooth.information.chunks(moves.len()).zip(&self.smooth.gradient);
        let change = |(row, slope): (&[f64], &f64)| {
            slope + 0.5 * row.iter().zip(&moves).map(|(a, b)| a * b).sum::<f64>()
        };
        Some(self.smooth.cost + slopes.map(change).zip(&moves).map(|(a, b)| a * b).sum::<f64>())
    }
}
