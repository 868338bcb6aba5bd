"""Clouds and meshes in files; some formats need the libraries of the extra ``files``."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from primfit._check import Floats, Ints
from primfit._files import as_path, replacing
from primfit.clouds.cloud import Cloud
from primfit.clouds.foreign import PointsLike, borrowed, points_of
from primfit.clouds.formats import arrays, e57, kitti, las, pcd, ply, ptx, text

_FORMATS: dict[str, Any] = {
    ".ply": ply,
    ".pcd": pcd,
    ".las": las,
    ".laz": las,
    ".e57": e57,
    ".xyz": text,
    ".pts": text,
    ".txt": text,
    ".asc": text,
    ".csv": text,
    ".ptx": ptx,
    ".bin": kitti,
    ".npy": arrays,
    ".npz": arrays,
}

_TEXT = (text, ptx)
"""Formats that may be in .gz too."""


def read_cloud(file: str | PathLike[str], *, columns: Sequence[str] | None = None) -> Cloud:
    """The points of a file with what it says of each, all of them and in order.

    Coordinates are float64 and lose nothing; files that hold float32, as many .ply and .pcd do,
    have lost the digits of a national grid already. Takes up to 150 bytes a point.

    Parameters
    ----------
    file : path
        .ply, .pcd (organised ones keep their shape), .las, .laz, .e57 and .ptx (all scans, in the
        frame of the file), .xyz, .asc, .txt, .csv, .pts, .bin (x y z intensity in float32, as
        KITTI has them), .npy (n, 3), (h, w, 3) or with named columns, .npz with an array "points",
        as that of a scan of primfit. Those of text also in .gz, such as .xyz.gz.
    columns : sequence of str or None
        Names of the columns of a text file, such as ("x", "y", "z", "label"). None takes them from
        a line before the points, in any order; without one they are x, y, z, "column_4" and so on,
        and those of .pts x, y, z, intensity, red, green, blue.

    Returns
    -------
    Cloud

    Raises
    ------
    FileNotFoundError
        When there is no such file.
    ValueError
        When the format is not known, or the file is not readable as what its suffix says, such as
        an empty or a truncated one, or text whose first line is neither a point nor a title with
        x, y and z.
    PermissionError
        When the file must not be read.
    MemoryError
        When the memory is too small for what the file holds.
    ModuleNotFoundError
        When the extra ``files`` is not installed.

    Examples
    --------
    >>> import primfit, tempfile, os
    >>> file = os.path.join(tempfile.mkdtemp(), "cloud.xyz")
    >>> primfit.write_cloud(file, primfit.Cloud([[1, 2, 3]], {"label": [7]}))
    >>> primfit.read_cloud(file).fields["label"]
    array([7])
    """
    path = as_path(file)
    if path.suffix.lower() in (".bag", ".mcap", ".db3") or (path / "metadata.yaml").is_file():
        raise ValueError(f"{path} is a recording of many clouds: primfit.read_clouds reads them")
    if path.is_dir():
        raise IsADirectoryError(f"{path} is a folder, not a file")
    if not path.is_file():
        raise FileNotFoundError(f"there is no file {path}")
    suffix, kind = _format_of(path)
    if columns is not None and kind is not text:
        raise ValueError(f"columns are for text files with a point a line, not for {path.name!r}")
    with explained(path, suffix):
        cloud: Cloud = text.read(path, columns) if kind is text else kind.read(path)
    return cloud


@contextmanager
def explained(path: Path, suffix: str) -> Iterator[None]:
    """Errors of reading a file, as `read_cloud` raises them."""
    try:
        yield
    except ModuleNotFoundError as error:
        raise _missing(error, suffix) from None
    except PermissionError:
        raise
    except MemoryError as error:
        raise MemoryError(f"{path}: {_why(error)}") from None
    except Exception as error:  # each library has errors of its own
        raise ValueError(f"{path} is not readable as {suffix}: {_why(error)}") from error


def read_points(file: str | PathLike[str]) -> Floats:
    """The points of a file alone: ``read_cloud(file).points``.

    Parameters
    ----------
    file : path
        In any format of `read_cloud`.

    Returns
    -------
    points : (n, 3) float64, metres
        As the file has them; pixels and beams without a point are NaN.

    Raises
    ------
    FileNotFoundError, ValueError, ModuleNotFoundError
        As `read_cloud` does.

    Examples
    --------
    >>> import primfit, tempfile, os
    >>> file = os.path.join(tempfile.mkdtemp(), "cloud.xyz")
    >>> primfit.write_points(file, [[1, 2, 3]])
    >>> primfit.read_points(file)
    array([[1., 2., 3.]])
    """
    return read_cloud(file).points


def write_cloud(file: str | PathLike[str], cloud: PointsLike) -> None:
    """Write points with all their fields.

    Coordinates keep their float64, but in .las and .laz, which count in steps: of a micrometre for
    spans of up to 4 km, of more for longer ones. Whole numbers stay whole, in a type that the
    format has; .pcd, .npy and .npz keep the shape of an organised cloud.

    Parameters
    ----------
    file : path
        .ply, .pcd, .las, .laz, .e57, .xyz, .asc, .txt, .csv, .pts, .npy or .npz; those of text also
        with .gz. It takes the place of an older one only when all is written.
    cloud : Cloud, or whatever `as_cloud` takes

    Raises
    ------
    OSError
        When there is no such folder, or no room.
    ValueError
        When the format is not known, or cannot keep what the cloud has: points that are not finite
        and an intensity with fractions in .las and .laz, whole numbers of more than 32 bits in
        .ply, no point at all in .e57.
    ModuleNotFoundError
        When the extra ``files`` is not installed.

    Examples
    --------
    >>> import primfit, tempfile, os
    >>> file = os.path.join(tempfile.mkdtemp(), "cloud.ply")
    >>> primfit.write_cloud(file, primfit.Cloud([[1, 2, 3]], {"color": [[255, 0, 0]]}))
    >>> primfit.read_cloud(file)
    Cloud(1 point: color)
    """
    path = as_path(file)
    suffix, kind = _format_of(path)
    if not hasattr(kind, "write"):
        raise ValueError(f"file must not end in {suffix}, which is only read: {path.name!r}")
    cloud = borrowed("cloud", cloud)
    with replacing(path) as part:
        try:
            kind.write(part, cloud)
        except ModuleNotFoundError as error:
            raise _missing(error, suffix) from None
        except (MemoryError, OSError):
            raise
        except Exception as error:  # each library has errors of its own
            raise ValueError(f"{path} cannot hold {cloud!r}: {_why(error)}") from error


def write_points(
    file: str | PathLike[str], points: PointsLike, *, colors: ArrayLike | None = None
) -> None:
    """Write points, coloured if wanted.

    Parameters
    ----------
    file : path
        In any format of `write_cloud`.
    points : (n, 3) float64, metres, or whatever `as_cloud` takes
    colors : (n, 3) uint8 or None
        Red, green, blue.

    Raises
    ------
    ValueError, ModuleNotFoundError
        As `write_cloud` does, and when the arrays do not match.
    """
    rows = points_of("points", points, finite=False)
    fields = {}
    if colors is not None:
        given = np.asarray(colors)
        if given.dtype.kind not in "biuf":
            raise TypeError(f"colors must be whole numbers from 0 to 255, not {given.dtype}")
        with np.errstate(invalid="ignore"):
            fields["color"] = given.astype(np.uint8)
        if given.shape != rows.shape:
            raise ValueError(f"colors must have a row of three for each point, not {given.shape}")
        if not np.array_equal(fields["color"], given):
            raise ValueError("colors must be whole numbers from 0 to 255")
    write_cloud(file, Cloud(rows, fields))


def write_mesh(file: str | PathLike[str], vertices: Floats, triangles: Ints) -> None:
    """Write a triangle mesh in the format of the suffix: .ply, .obj or .stl."""
    path = as_path(file)
    suffix = path.suffix.lower()
    if suffix not in (".ply", ".obj", ".stl"):
        raise ValueError(f"file must end in .ply, .obj or .stl, not {path.name!r}")
    with replacing(path) as part:
        if suffix == ".ply":
            ply.write(part, Cloud(vertices), triangles)
            return
        try:
            import trimesh
        except ModuleNotFoundError as error:
            raise _missing(error, suffix) from None
        trimesh.Trimesh(vertices, triangles, process=False).export(part)


def _format_of(path: Path) -> tuple[str, Any]:
    """The suffix of a file, and the module for it."""
    suffixes = [suffix.lower() for suffix in path.suffixes]
    suffix = suffixes[-1] if suffixes else ""
    if suffix == ".gz" and len(suffixes) > 1 and _FORMATS.get(suffixes[-2]) in _TEXT:
        return f"{suffixes[-2]}.gz", _FORMATS[suffixes[-2]]
    if suffix not in _FORMATS:
        raise ValueError(f"file must end in one of {', '.join(_FORMATS)}, not {path.name!r}")
    return suffix, _FORMATS[suffix]


def _why(error: Exception) -> str:
    """The first line of its message: a library tells its own trace in the others."""
    return next(iter(str(error).splitlines()), type(error).__name__)


def _missing(error: ModuleNotFoundError, suffix: str) -> ModuleNotFoundError:
    return ModuleNotFoundError(
        f"{suffix} files need {error.name}: install it with pip install 'primfit[files]'"
    )
