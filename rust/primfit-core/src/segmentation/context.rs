//! What every step of the search looks at.

use super::graph::Graph;
use super::regions::{self, Region};
use super::roughness::Surfaces;
use super::settings::Settings;
use crate::neighbors::PointTree;
use crate::{Vector, Workers};

/// A cloud, which points touch, and how far off their planes they may be.
#[derive(Clone, Copy)]
pub struct Context<'a> {
    pub tree: &'a PointTree,
    pub graph: &'a Graph,
    /// Standard deviation of the noise of each point, NaN where nothing tells it.
    pub noise: &'a [f32],
    pub surfaces: Surfaces,
    pub settings: &'a Settings,
}

impl<'a> Context<'a> {
    /// Points in the order of the tree.
    pub fn points(&self) -> &'a [Vector] {
        self.tree.points()
    }

    /// The plane of each label.
    pub fn fit(&self, labels: &[i32], workers: &Workers) -> Vec<Region> {
        regions::fit(self.points(), self.noise, labels, workers)
    }
}
