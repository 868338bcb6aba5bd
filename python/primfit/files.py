"""Clouds and meshes in files, through the libraries of the extra ``files``."""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from primfit._check import Floats, Ints, as_rows

_TEXT = (".xyz", ".txt", ".pts")
_SUFFIXES = (".ply", ".pcd", ".las", ".laz", ".npy", ".npz", *_TEXT)


def read_points(file: str | PathLike[str]) -> Floats:
    """Points of a file, all of them and in order.

    Parameters
    ----------
    file : path
        .ply, .pcd, .las, .laz, .xyz, .txt, .pts (columns x y z, more are left out), .npy (n, 3) or
        .npz (with an array ``points``, or a scan that primfit wrote).

    Returns
    -------
    points : (n, 3) float64, metres
        As the file has them; beams without return may be NaN.

    Raises
    ------
    FileNotFoundError
        When there is no such file.
    ValueError
        When the format is not known or the file is not readable as what its suffix says.
    ModuleNotFoundError
        When the extra ``files`` is not installed.

    Examples
    --------
    >>> import primfit, tempfile, os
    >>> file = os.path.join(tempfile.mkdtemp(), "cloud.xyz")
    >>> primfit.write_points(file, [[1, 2, 3]])
    >>> primfit.read_points(file)
    array([[1., 2., 3.]])
    """
    path = Path(file)
    if not path.is_file():
        raise FileNotFoundError(f"there is no file {path}")
    _check_suffix(path)
    try:
        points = _read(path)
        return as_rows("points", points, 3, finite=False)
    except ModuleNotFoundError as error:
        raise _missing(error, path) from None
    except MemoryError:
        raise
    except Exception as error:  # each library has errors of its own
        raise ValueError(f"{path} is not readable as {path.suffix}: {error}") from error


def _read(path: Path) -> ArrayLike:
    suffix = path.suffix.lower()
    if suffix in (".npy", ".npz"):
        with open(path, "rb") as stream:
            content = np.load(stream, allow_pickle=False)
            return content if suffix == ".npy" else content["points"]
    if suffix in _TEXT:
        return _read_text(path)
    if suffix == ".ply":
        import trimesh

        return np.asarray(trimesh.load(path, process=False).vertices)
    if suffix == ".pcd":
        import pypcd4

        return pypcd4.PointCloud.from_path(path).numpy(("x", "y", "z"))
    import laspy

    return np.asarray(laspy.read(path).xyz)


def _read_text(path: Path) -> Floats:
    with open(path) as stream:
        first = stream.readline()
        # A .pts file may begin with the number of its points.
        is_count = len(first.replace(",", " ").split()) == 1
        stream.seek(0)
        return np.loadtxt(
            stream,
            skiprows=int(is_count),
            delimiter="," if "," in first else None,
            comments=("#", "//"),
            usecols=(0, 1, 2),
            ndmin=2,
        )


def write_points(
    file: str | PathLike[str], points: ArrayLike, *, colors: ArrayLike | None = None
) -> None:
    """Write points, coloured if wanted.

    Parameters
    ----------
    file : path
        .ply, .pcd, .xyz, .txt, .pts, .npy or .npz; .las and .laz in steps of 0.1 mm.
    points : (n, 3) float64, metres
    colors : (n, 3) uint8 or None
        Red, green, blue; kept by .ply, .pcd, .las and .laz.

    Raises
    ------
    ValueError
        When the format is not known, or the arrays do not match.
    """
    path = Path(file)
    _check_suffix(path)
    cloud = as_rows("points", points, 3)
    rgb = None
    if colors is not None:
        rgb = np.asarray(colors, dtype=np.uint8)
        if rgb.shape != cloud.shape:
            raise ValueError(f"colors must have shape {cloud.shape}, not {rgb.shape}")
    try:
        _write(path, cloud, rgb)
    except ModuleNotFoundError as error:
        raise _missing(error, path) from None


def _write(path: Path, cloud: Floats, rgb: NDArray[np.uint8] | None) -> None:
    suffix = path.suffix.lower()
    if suffix == ".npy":
        np.save(path, cloud)
    elif suffix == ".npz":
        np.savez_compressed(path, points=cloud)
    elif suffix in _TEXT:
        np.savetxt(path, cloud, fmt="%.17g")
    elif suffix == ".ply":
        import trimesh

        trimesh.PointCloud(cloud, colors=rgb).export(path)
    elif suffix == ".pcd":
        _write_pcd(path, cloud, rgb)
    else:
        _write_las(path, cloud, rgb)


def _write_pcd(path: Path, cloud: Floats, rgb: NDArray[np.uint8] | None) -> None:
    import pypcd4

    names: tuple[str, ...] = ("x", "y", "z")
    types: tuple[Any, ...] = (np.float64,) * 3
    columns = list(cloud.T)
    if rgb is not None:
        names, types = (*names, "rgb"), (*types, np.float32)
        columns.append(pypcd4.PointCloud.encode_rgb(rgb))
    pypcd4.PointCloud.from_points(columns, names, types).save(path)


def _write_las(path: Path, cloud: Floats, rgb: NDArray[np.uint8] | None) -> None:
    import laspy

    header = laspy.LasHeader(point_format=7 if rgb is not None else 6, version="1.4")
    header.offsets = np.floor(cloud.min(axis=0)) if len(cloud) else np.zeros(3)
    header.scales = np.full(3, 1e-4)
    las = laspy.LasData(header)
    las.xyz = cloud
    if rgb is not None:
        las.red, las.green, las.blue = (rgb.astype(np.uint16) * 257).T
    las.write(path)


def write_mesh(file: str | PathLike[str], vertices: Floats, triangles: Ints) -> None:
    """Write a triangle mesh in the format of the suffix: .ply, .obj or .stl."""
    path = Path(file)
    if path.suffix.lower() not in (".ply", ".obj", ".stl"):
        raise ValueError(f"file must end in .ply, .obj or .stl, not {path.name!r}")
    try:
        import trimesh
    except ModuleNotFoundError as error:
        raise _missing(error, path) from None
    trimesh.Trimesh(vertices, triangles, process=False).export(path)


def _check_suffix(path: Path) -> None:
    if path.suffix.lower() not in _SUFFIXES:
        raise ValueError(f"file must end in one of {', '.join(_SUFFIXES)}, not {path.name!r}")


def _missing(error: ModuleNotFoundError, path: Path) -> ModuleNotFoundError:
    return ModuleNotFoundError(
        f"{path.suffix} files need {error.name}: install it with pip install 'primfit[files]'"
    )
