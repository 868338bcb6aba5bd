//! Ray casting.

use crate::arrays::{from_rows, rows, rows_mut, same_length};
use crate::door;
use numpy::{
    IntoPyArray, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2,
    PyReadwriteArray1, PyReadwriteArray2,
};
use primfit_core::{DepthGate, Eye, RangeGate, Readings, Round};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

type Hits<'py> = (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<i64>>);

/// How a sensor makes readings, as the gates of `primfit.sensors.sensor` say it.
#[derive(FromPyObject)]
enum Gate {
    Range {
        min_range: f64,
        max_range: f64,
        sigma: f64,
        resolution: f64,
    },
    Depth {
        min_depth: f64,
        max_depth: f64,
        sigma: [f64; 3],
        resolution: f64,
        width: usize,
        disparity: f64,
        disparity_noise: f64,
        disparity_step: f64,
        shadow: bool,
        stereo: bool,
    },
}

impl Gate {
    fn with_seed(self, seed: u64) -> primfit_core::Gate {
        match self {
            Self::Range { min_range, max_range, sigma, resolution } => {
                let gate = RangeGate { min_range, max_range, sigma, seed, resolution };
                primfit_core::Gate::Range(gate)
            }
            Self::Depth {
                min_depth,
                max_depth,
                sigma,
                resolution,
                width,
                disparity,
                disparity_noise,
                disparity_step,
                shadow,
                stereo,
            } => {
                let eye = Eye {
                    disparity,
                    sigma: disparity_noise,
                    step: disparity_step,
                    has_shadow: shadow,
                    is_camera: stereo,
                };
                let gate = DepthGate { min_depth, max_depth, sigma, seed, resolution, width, eye };
                primfit_core::Gate::Depth(gate)
            }
        }
    }
}

type Parts<'py> =
    (Bound<'py, PyArray2<f64>>, Option<Bound<'py, PyArray1<i64>>>, Bound<'py, PyArray2<f64>>);

/// A triangle mesh, and round solids beside it, ready for rays.
#[pyclass(frozen, module = "primfit._primfit")]
pub struct RayCaster(primfit_core::RayCaster);

#[pymethods]
impl RayCaster {
    #[new]
    #[pyo3(signature = (vertices, triangles, names=None, rounds=None))]
    fn new(
        py: Python,
        vertices: PyReadonlyArray2<f64>,
        triangles: PyReadonlyArray2<i64>,
        names: Option<PyReadonlyArray1<i64>>,
        rounds: Option<PyReadonlyArray2<f64>>,
    ) -> PyResult<Self> {
        let (vertices, triangles) = (rows("vertices", &vertices)?, rows("triangles", &triangles)?);
        let names = names.map(|names| names.as_slice().map(<[i64]>::to_vec)).transpose()?;
        let rounds = rounds.as_ref().map_or(Ok(Vec::new()), as_rounds)?;
        if let Some(names) = &names {
            let n = triangles.len() + rounds.len();
            same_length("names", names.len(), "triangles and rounds", n)?;
        }
        let caster = door::enter(py, None, |workers| {
            primfit_core::RayCaster::with_rounds(vertices, triangles, &rounds, workers)
        })?;
        Ok(Self(match names {
            Some(names) => caster.named(names),
            None => caster,
        }))
    }

    /// The corners (3t, 3) of all triangles, row after row, what these are called, and the rows of
    /// the round solids.
    fn parts<'py>(&self, py: Python<'py>) -> PyResult<Parts<'py>> {
        let (triangles, names) = self.0.mesh();
        let corners = triangles.into_flattened();
        let n = corners.len();
        let corners = corners.into_flattened().into_pyarray(py).reshape([n, 3])?;
        let rounds = from_rows(py, self.0.rounds().iter().map(Round::row).collect())?;
        Ok((corners, names.map(|names| PyArray1::from_slice(py, names)), rounds))
    }

    fn __len__(&self) -> usize {
        self.0.len()
    }

    #[pyo3(signature = (origins, directions, n_jobs=None))]
    fn cast<'py>(
        &self,
        py: Python<'py>,
        origins: PyReadonlyArray2<f64>,
        directions: PyReadonlyArray2<f64>,
        n_jobs: Option<usize>,
    ) -> PyResult<Hits<'py>> {
        let (origins, directions) = (rows("origins", &origins)?, rows("directions", &directions)?);
        same_length("directions", directions.len(), "origins", origins.len())?;
        let hits = door::enter(py, n_jobs, |workers| self.0.cast(origins, directions, workers))?;
        Ok((hits.ranges.into_pyarray(py), hits.ids.into_pyarray(py)))
    }

    /// Fills in where `beams` (m, 3) end from each of `poses` (p, 16), their readings and ids; noise
    /// follows from a seed and the numbers of beams, from that of the first.
    #[pyo3(signature = (poses, beams, gate, noise, points, ranges, ids, n_jobs=None))]
    #[allow(clippy::too_many_arguments)]
    fn scan(
        &self,
        py: Python,
        poses: PyReadonlyArray2<f64>,
        beams: PyReadonlyArray2<f64>,
        gate: Gate,
        noise: (u64, u64),
        mut points: PyReadwriteArray2<f64>,
        mut ranges: PyReadwriteArray1<f64>,
        mut ids: PyReadwriteArray1<i64>,
        n_jobs: Option<usize>,
    ) -> PyResult<()> {
        let (poses, beams) = (rows("poses", &poses)?, rows("beams", &beams)?);
        let (seed, first) = noise;
        let gate = gate.with_seed(seed);
        let points = rows_mut("points", &mut points)?;
        let (ranges, ids) = (ranges.as_slice_mut()?, ids.as_slice_mut()?);
        let n = poses.len() * beams.len();
        for (name, length) in
            [("points", points.len()), ("ranges", ranges.len()), ("ids", ids.len())]
        {
            same_length(name, length, "poses x beams", n)?;
        }
        let readings = Readings { points, ranges, ids };
        door::enter(py, n_jobs, |workers| self.0.scan(poses, beams, gate, first, readings, workers))
    }
}

/// The round solids of rows (see [`Round::from_row`]).
fn as_rounds(array: &PyReadonlyArray2<f64>) -> PyResult<Vec<Round>> {
    let unknown = || PyValueError::new_err("rounds must be of kind 0, 1 or 2");
    rows("rounds", array)?.iter().map(|row| Round::from_row(row).ok_or_else(unknown)).collect()
}

/// Unit directions (p * m, 3) in the world of `beams` (m, 3) from each of `poses` (p, 16).
#[pyfunction]
pub fn turned<'py>(
    py: Python<'py>,
    poses: PyReadonlyArray2<f64>,
    beams: PyReadonlyArray2<f64>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let (poses, beams) = (rows("poses", &poses)?, rows("beams", &beams)?);
    let directions = door::enter(py, None, |workers| primfit_core::turned(poses, beams, workers))?;
    let n = directions.len();
    directions.into_flattened().into_pyarray(py).reshape([n, 3])
}
