//! What beams say of the poses that they were taken from.

use crate::arrays::{rows, same_length};
use crate::door;
use crate::likelihood::BeamLimits;
use numpy::{
    IntoPyArray, PyArray1, PyArray2, PyArray3, PyArray4, PyArrayMethods, PyReadonlyArray1,
    PyReadonlyArray2,
};
use primfit_core::{Candidate, RIGID, Robust, Surroundings};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// Costs and numbers (p,), information (p, 7, 7), descent (p, 7), cross (p, w, 7, 2), walls (w, 5).
type Sums<'py> = (
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray3<f64>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray4<f64>>,
    Bound<'py, PyArray2<f64>>,
);

/// Prisms as Python hands them over: corners (c, 2) of all, first corner of each and their number,
/// bottoms, tops, and which have no top face.
#[derive(FromPyObject)]
struct Prisms<'py>(PyReadonlyArray2<'py, f64>, Vec<usize>, Vec<f64>, Vec<f64>, Vec<bool>);

impl Prisms<'_> {
    fn candidates(&self) -> PyResult<Vec<Candidate<'_>>> {
        let Self(corners, starts, bottoms, tops, is_open) = self;
        let corners: &[[f64; 2]] = rows("corners", corners)?;
        let n = bottoms.len();
        same_length("tops", tops.len(), "bottoms", n)?;
        same_length("is_open", is_open.len(), "bottoms", n)?;
        same_length("starts", starts.len(), "bottoms and one", n + 1)?;
        let is_proper = starts.windows(2).all(|pair| pair[0] + 3 <= pair[1]);
        if !is_proper || starts.last().is_some_and(|&end| end > corners.len()) {
            return Err(PyValueError::new_err("every prism must have at least 3 of the corners"));
        }
        Ok((0..n)
            .map(|k| Candidate {
                footprint: &corners[starts[k]..starts[k + 1]],
                is_round: false,
                bottom: bottoms[k],
                top: tops[k],
                is_open: is_open[k],
            })
            .collect())
    }
}

/// Beams in the frame of their robot, pose by pose.
#[pyclass(frozen, module = "primfit._primfit")]
pub struct PoseBeams(primfit_core::PoseBeams);

#[pymethods]
impl PoseBeams {
    #[new]
    fn new(
        starts: Vec<usize>,
        origins: PyReadonlyArray2<f64>,
        directions: PyReadonlyArray2<f64>,
        ranges: PyReadonlyArray1<f64>,
        sigmas: PyReadonlyArray1<f64>,
        limits: BeamLimits,
    ) -> PyResult<Self> {
        let n = ranges.len()?;
        let limits = limits.checked(n)?;
        let beams = primfit_core::PoseBeams {
            starts,
            origins: rows("origins", &origins)?.to_vec(),
            directions: rows("directions", &directions)?.to_vec(),
            ranges: ranges.as_slice()?.to_vec(),
            sigmas: sigmas.as_slice()?.to_vec(),
            limits: (0..n).map(|row| limits.of(row)).collect(),
        };
        same_length("directions", beams.directions.len(), "ranges", n)?;
        same_length("origins", beams.origins.len(), "ranges", n)?;
        same_length("sigmas", beams.sigmas.len(), "ranges", n)?;
        let ascends = beams.starts.is_sorted() && beams.starts.last() == Some(&n);
        if !ascends {
            return Err(PyValueError::new_err("starts must ascend up to the number of beams"));
        }
        Ok(Self(beams))
    }

    fn __len__(&self) -> usize {
        self.0.n_poses()
    }

    #[pyo3(signature = (poses, prisms, floor, shared, robust, n_jobs=None))]
    // Where the beams come from, what is around, and how it counts.
    #[allow(clippy::too_many_arguments)]
    fn sums<'py>(
        &self,
        py: Python<'py>,
        poses: PyReadonlyArray2<f64>,
        prisms: Prisms<'py>,
        floor: f64,
        shared: [f64; 4],
        robust: [f64; 3],
        n_jobs: Option<usize>,
    ) -> PyResult<Sums<'py>> {
        let (poses, prisms) = (rows("poses", &poses)?, prisms.candidates()?);
        let p = self.0.n_poses();
        same_length("poses", poses.len(), "starts less one", p)?;
        let around = Surroundings { prisms: &prisms, floor, globals: shared };
        let found =
            door::enter(py, n_jobs, |workers| self.0.sums(poses, &around, told(robust), workers))?;
        let w = prisms.iter().map(|prism| prism.footprint.len()).sum();
        let mut walls = vec![0.0; 5 * w];
        let (mut costs, mut numbers, mut descents) = (vec![], vec![], vec![]);
        let (mut informations, mut crosses) = (vec![], vec![]);
        // In the order of the poses, whatever thread summed them up.
        for sums in found {
            costs.push(sums.cost);
            numbers.push(sums.n);
            descents.extend(sums.descent);
            informations.extend(sums.information.into_iter().flatten());
            crosses.extend(sums.cross.into_iter().flatten().flatten());
            for (total, term) in walls.iter_mut().zip(sums.walls.into_iter().flatten()) {
                *total += term;
            }
        }
        Ok((
            costs.into_pyarray(py),
            numbers.into_pyarray(py),
            informations.into_pyarray(py).reshape([p, RIGID, RIGID])?,
            descents.into_pyarray(py).reshape([p, RIGID])?,
            crosses.into_pyarray(py).reshape([p, w, RIGID, 2])?,
            walls.into_pyarray(py).reshape([w, 5])?,
        ))
    }

    #[pyo3(signature = (of, places, prisms, floor, shared, robust, stride=1, n_jobs=None))]
    // Where the beams may come from, what is around, and how it counts.
    #[allow(clippy::too_many_arguments)]
    fn costs<'py>(
        &self,
        py: Python<'py>,
        of: Vec<usize>,
        places: PyReadonlyArray2<f64>,
        prisms: Prisms<'py>,
        floor: f64,
        shared: [f64; 4],
        robust: [f64; 3],
        stride: usize,
        n_jobs: Option<usize>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let (places, prisms) = (rows("places", &places)?, prisms.candidates()?);
        same_length("of", of.len(), "places", places.len())?;
        if of.iter().any(|&k| k >= self.0.n_poses()) {
            return Err(PyValueError::new_err("of must be numbers of poses"));
        }
        let around = Surroundings { prisms: &prisms, floor, globals: shared };
        let stride = stride.max(1);
        let costs = door::enter(py, n_jobs, |workers| {
            self.0.costs(&of, places, &around, told(robust), stride, workers)
        })?;
        Ok(costs.into_pyarray(py))
    }
}

fn told([blur, scale, cut]: [f64; 3]) -> Robust {
    Robust { blur, scale, cut }
}
