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
    lines = [line for line in path.read_text().splitlines() if line.strip()]
    rows = [line for line in lines if not line.lstrip().startswith(("#", "//"))]
    # A .pts file may begin with the number of its points.
    if rows and rows[0].strip().isdigit():
        rows = rows[1:]
    if not rows:
        raise ValueError("it holds no point")
    delimiter = next((mark for mark in (",", ";") if mark in rows[0]), None)
    return np.loadtxt(rows, delimiter=delimiter, comments=("#", "//"), usecols=(0, 1, 2), ndmin=2)


def write_points(
    file: str | PathLike[str], points: ArrayLike, *, colors: ArrayLike | None = None
) -> None:
    """Write points, coloured if wanted.

    Parameters
    ----------
    file : path
        .ply, .pcd, .xyz, .txt, .pts, .npy or .npz; .las and .laz in steps of 0.1 mm, or more for
        spans that these cannot hold.
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
        given = np.asarray(colors)
        if given.shape != cloud.shape:
            raise ValueError(f"colors must have shape {cloud.shape}, not {given.shape}")
        rgb = given.astype(np.uint8)
        if not np.array_equal(rgb, given):
            raise ValueError("colors must be whole numbers from 0 to 255")
    try:
        _write(path, cloud, rgb)
    except ModuleNotFoundError as error:
        raise _missing(error, path) from None


def _write(path: Path, cloud: Floats, rgb: NDArray[np.uint8] | None) -> None:
    suffix = path.suffix.lower()
    if suffix in (".npy", ".npz"):
        with open(path, "wb") as stream:
            if suffix == ".npy":
                np.save(stream, cloud)
            else:
                np.savez_compressed(stream, points=cloud)
    elif suffix in _TEXT:
        np.savetxt(path, cloud, fmt="%.17g")
    elif suffix == ".ply":
        _write_ply(path, cloud, rgb, np.empty((0, 3), np.int64))
    elif suffix == ".pcd":
        _write_pcd(path, cloud, rgb)
    else:
        _write_las(path, cloud, rgb)


def _write_ply(
    path: Path, vertices: Floats, rgb: NDArray[np.uint8] | None, triangles: Ints
) -> None:
    """Binary PLY in float64, which the libraries at hand round to float32."""
    columns = [(name, "<f8") for name in "xyz"]
    if rgb is not None:
        columns += [(name, "u1") for name in ("red", "green", "blue")]
    rows = np.zeros(len(vertices), dtype=columns)
    for k, name in enumerate("xyz"):
        rows[name] = vertices[:, k]
    if rgb is not None:
        for k, name in enumerate(("red", "green", "blue")):
            rows[name] = rgb[:, k]
    faces = np.zeros(len(triangles), dtype=[("n", "u1"), ("corners", "<i4", 3)])
    faces["n"], faces["corners"] = 3, triangles
    types = {"<f8": "double", "u1": "uchar"}
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(rows)}"]
    header += [f"property {types[kind]} {name}" for name, kind in columns]
    if len(triangles):
        header += [f"element face {len(faces)}", "property list uchar int vertex_indices"]
    text = "\n".join([*header, "end_header", ""])
    path.write_bytes(text.encode() + rows.tobytes() + faces.tobytes())


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
    span = float(np.ptp(cloud, axis=0).max()) if len(cloud) else 0.0
    # A coordinate is a 32-bit count of steps.
    header.scales = np.full(3, max(1e-4, span / 2e9))
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
    if path.suffix.lower() == ".ply":
        _write_ply(path, vertices, None, triangles)
        return
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
