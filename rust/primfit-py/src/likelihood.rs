//! The likelihood of prisms, and the space that beams leave for them.

use crate::arrays::{rows, same_length};
use crate::door;
use crate::family::{Family, check_corners};
use numpy::{
    IntoPyArray, PyArray1, PyArray2, PyArray4, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2,
    PyReadonlyArray3, PyUntypedArrayMethods,
};
use primfit_core::{Beams, Candidate, Effort, Grid, Limits, Prices, Region, Slope, Spans};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// Parameters, cost and covariance at the end of a climb.
type Climb<'py> = (Bound<'py, PyArray1<f64>>, f64, Bound<'py, PyArray2<f64>>);

/// Mean, covariance, best draw, its cost, log evidence and size of a posterior.
type Posterior<'py> = (
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray1<f64>>,
    f64,
    f64,
    f64,
);

/// Beams ready for the costs of many prisms.
#[pyclass(frozen, module = "primfit._primfit")]
pub struct BeamBlocks(primfit_core::BeamBlocks);

/// Shortest and longest ranges that give a return: two numbers for all beams, or (2, n) of each.
#[derive(FromPyObject)]
pub enum BeamLimits<'py> {
    All([f64; 2]),
    Each(PyReadonlyArray2<'py, f64>),
}

impl BeamLimits<'_> {
    /// Those of `n` beams.
    pub fn checked(&self, n: usize) -> PyResult<Limits<'_>> {
        match self {
            Self::All(limits) => Ok(Limits::All(*limits)),
            Self::Each(limits) => {
                let [2, length] = limits.shape() else {
                    return Err(PyValueError::new_err("limits must have shape (2, n)"));
                };
                same_length("limits", *length, "origins", n)?;
                let (low, high) = limits.as_slice()?.split_at(n);
                Ok(Limits::Each([low, high]))
            }
        }
    }
}

#[pymethods]
impl BeamBlocks {
    #[new]
    // One array a property of beams.
    #[allow(clippy::too_many_arguments)]
    fn new(
        py: Python,
        origins: PyReadonlyArray2<f64>,
        directions: PyReadonlyArray2<f64>,
        ranges: PyReadonlyArray1<f64>,
        background: PyReadonlyArray1<f64>,
        sigmas: PyReadonlyArray1<f64>,
        limits: BeamLimits,
        outlier: f64,
        missing: f64,
    ) -> PyResult<Self> {
        let beams = Beams {
            origins: rows("origins", &origins)?,
            directions: rows("directions", &directions)?,
            ranges: ranges.as_slice()?,
            background: background.as_slice()?,
            sigmas: sigmas.as_slice()?,
            limits: limits.checked(origins.shape()[0])?,
        };
        let n = beams.origins.len();
        same_length("directions", beams.directions.len(), "origins", n)?;
        same_length("ranges", beams.ranges.len(), "origins", n)?;
        same_length("background", beams.background.len(), "origins", n)?;
        same_length("sigmas", beams.sigmas.len(), "origins", n)?;
        let prices = Prices { outlier, missing };
        Ok(Self(py.detach(|| primfit_core::BeamBlocks::new(beams, prices))))
    }

    fn __len__(&self) -> usize {
        self.0.len()
    }

    #[pyo3(signature = (
        footprints, bottoms, tops, is_open=false, is_round=false, n_jobs=None,
    ))]
    // What the prisms are, and by how many threads.
    #[allow(clippy::too_many_arguments)]
    fn costs<'py>(
        &self,
        py: Python<'py>,
        footprints: PyReadonlyArray3<f64>,
        bottoms: PyReadonlyArray1<f64>,
        tops: PyReadonlyArray1<f64>,
        is_open: bool,
        is_round: bool,
        n_jobs: Option<usize>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let &[n, n_corners, 2] = footprints.shape() else {
            return Err(PyValueError::new_err("footprints must have shape (k, m, 2)"));
        };
        check_corners(n_corners, is_round)?;
        let (bottoms, tops) = (bottoms.as_slice()?, tops.as_slice()?);
        same_length("bottoms", bottoms.len(), "footprints", n)?;
        same_length("tops", tops.len(), "footprints", n)?;
        let corners: &[[f64; 2]] = footprints.as_slice()?.as_chunks().0;
        let candidates: Vec<Candidate> = (0..n)
            .map(|k| Candidate {
                footprint: &corners[k * n_corners..(k + 1) * n_corners],
                is_round,
                bottom: bottoms[k],
                top: tops[k],
                is_open,
            })
            .collect();
        let costs = door::enter(py, n_jobs, |workers| {
            primfit_core::prism_costs(&self.0, &candidates, workers)
        })?;
        Ok(costs.into_pyarray(py))
    }

    fn wall_depths<'py>(
        &self,
        py: Python<'py>,
        footprint: PyReadonlyArray2<f64>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let footprint = corners(&footprint, false)?;
        Ok(py.detach(|| primfit_core::wall_depths(&self.0, footprint)).into_pyarray(py))
    }

    /// Range at which each beam first meets a prism; infinite for never.
    #[pyo3(signature = (footprint, bottom, top, is_round=false))]
    fn prism_ranges<'py>(
        &self,
        py: Python<'py>,
        footprint: PyReadonlyArray2<f64>,
        bottom: f64,
        top: f64,
        is_round: bool,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let footprint = corners(&footprint, is_round)?;
        let candidate = Candidate { footprint, is_round, bottom, top, is_open: false };
        Ok(py.detach(|| primfit_core::prism_ranges(&self.0, &candidate)).into_pyarray(py))
    }

    #[pyo3(signature = (
        footprint, bottom, top, slack=0.0, top_slack=0.0, weight=1.0, is_open=false,
        is_round=false,
    ))]
    // What the prism is, where it stands, and how far it may move.
    #[allow(clippy::too_many_arguments)]
    fn around(
        &self,
        py: Python,
        footprint: PyReadonlyArray2<f64>,
        bottom: f64,
        top: f64,
        slack: f64,
        top_slack: f64,
        weight: f64,
        is_open: bool,
        is_round: bool,
    ) -> PyResult<Local> {
        let footprint = corners(&footprint, is_round)?;
        let candidate = Candidate { footprint, is_round, bottom, top, is_open };
        let region = Region { candidate, slack, top_slack };
        Ok(Local(py.detach(|| primfit_core::Local::new(&self.0, region, weight))))
    }

    // What the prism is, where it stands, and how far to go.
    #[allow(clippy::too_many_arguments)]
    fn climb<'py>(
        &self,
        py: Python<'py>,
        family: &Family,
        start: PyReadonlyArray1<f64>,
        bottom: f64,
        top: f64,
        weight: f64,
        n_steps: usize,
        is_open: bool,
    ) -> PyResult<Climb<'py>> {
        let (family, start) = (family.core(), start.as_slice()?);
        let n = family.n_parameters();
        same_length("start", start.len(), "parameters", n)?;
        let slope = Slope { beams: &self.0, family, bottom, top, is_open, weight };
        let end = py.detach(|| slope.climb(start, n_steps));
        let covariance = end.covariance.into_pyarray(py).reshape([n, n])?;
        Ok((end.parameters.into_pyarray(py), end.cost, covariance))
    }
}

/// The likelihood of prisms near a given one.
#[pyclass(frozen, module = "primfit._primfit")]
pub struct Local(primfit_core::Local);

#[pymethods]
impl Local {
    /// Of the beams that meet the same wall for all such prisms.
    #[getter]
    fn cost(&self) -> f64 {
        self.0.smooth.cost
    }

    #[getter]
    fn gradient<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.0.smooth.gradient.clone().into_pyarray(py)
    }

    #[getter]
    fn information<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let n = self.0.smooth.gradient.len();
        self.0.smooth.information.clone().into_pyarray(py).reshape([n, n])
    }

    /// The other beams.
    #[getter]
    fn open<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<usize>> {
        self.0.smooth.open.clone().into_pyarray(py)
    }

    #[pyo3(signature = (family, parameters, n_jobs=None))]
    fn costs<'py>(
        &self,
        py: Python<'py>,
        family: &Family,
        parameters: PyReadonlyArray2<f64>,
        n_jobs: Option<usize>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let (rows, family) = (family.rows(&parameters)?, family.core());
        if !self.0.is_of(family) {
            return Err(PyValueError::new_err("family must be that of the footprint"));
        }
        let costs = door::enter(py, n_jobs, |workers| self.0.costs(family, &rows, workers))?;
        Ok(costs.into_pyarray(py))
    }
}

fn corners<'a>(footprint: &'a PyReadonlyArray2<f64>, is_round: bool) -> PyResult<&'a [[f64; 2]]> {
    let corners = rows("footprint", footprint)?;
    check_corners(corners.len(), is_round)?;
    Ok(corners)
}

#[pyfunction]
#[pyo3(signature = (
    origins, directions, starts, passed, ends, low, cell, shape, heights, n_jobs=None,
))]
// One array a property of beams and grid.
#[allow(clippy::too_many_arguments)]
pub fn carve<'py>(
    py: Python<'py>,
    origins: PyReadonlyArray2<f64>,
    directions: PyReadonlyArray2<f64>,
    starts: PyReadonlyArray1<f64>,
    passed: PyReadonlyArray1<f64>,
    ends: PyReadonlyArray1<f64>,
    low: [f64; 2],
    cell: f64,
    shape: [usize; 2],
    heights: PyReadonlyArray1<f64>,
    n_jobs: Option<usize>,
) -> PyResult<Bound<'py, PyArray4<u32>>> {
    let (origins, directions) = (rows("origins", &origins)?, rows("directions", &directions)?);
    let n = origins.len();
    same_length("directions", directions.len(), "origins", n)?;
    let spans =
        Spans { starts: starts.as_slice()?, passed: passed.as_slice()?, ends: ends.as_slice()? };
    same_length("starts", spans.starts.len(), "origins", n)?;
    same_length("passed", spans.passed.len(), "origins", n)?;
    same_length("ends", spans.ends.len(), "origins", n)?;
    let heights = heights.as_slice()?;
    if heights.len() < 2 {
        return Err(PyValueError::new_err("heights must be at least two"));
    }
    let n_layers = heights.len() - 1;
    let n_cells = shape[0].checked_mul(shape[1]).and_then(|n| n.checked_mul(n_layers));
    if n_cells.is_none_or(|n| n > u32::MAX as usize) {
        return Err(PyValueError::new_err("the grid must have at most 2**32 cells"));
    }
    let grid = Grid { low, cell, shape, heights };
    let counts = door::enter(py, n_jobs, |workers| {
        primfit_core::carve(origins, directions, spans, grid, workers)
    })?;
    counts.into_flattened().into_pyarray(py).reshape([shape[0], shape[1], n_layers, 2])
}

#[pyfunction]
// Where to start, and how hard to try.
#[allow(clippy::too_many_arguments)]
pub fn sample<'py>(
    py: Python<'py>,
    cost: Bound<'py, PyAny>,
    mean: PyReadonlyArray1<f64>,
    covariance: PyReadonlyArray2<f64>,
    seed: u64,
    n: usize,
    generations: usize,
    wanted: f64,
) -> PyResult<Posterior<'py>> {
    let (mean, covariance) = (mean.as_slice()?, covariance.as_slice()?);
    let d = mean.len();
    same_length("covariance", covariance.len(), "mean x mean", d * d)?;
    let cost = |draws: &[f64]| {
        let draws = draws.to_vec().into_pyarray(py).reshape([n, d])?;
        let costs =
            cost.call1((draws,))?.cast_into::<PyArray1<f64>>()?.readonly().as_array().to_vec();
        same_length("costs", costs.len(), "draws", n)?;
        Ok::<_, PyErr>(costs)
    };
    let effort = Effort { n, generations, wanted };
    let found = primfit_core::sample(cost, mean, covariance, seed, effort)?;
    Ok((
        found.mean.into_pyarray(py),
        found.covariance.into_pyarray(py).reshape([d, d])?,
        found.best.into_pyarray(py),
        found.cost,
        found.log_evidence,
        found.size,
    ))
}
