"""Scans in archives of NumPy."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from os import PathLike
from typing import Any

import numpy as np

from primfit._files import as_path, replacing
from primfit.clouds.cloud import Field
from primfit.clouds.formats.archive import Archive


def save_arrays(file: str | PathLike[str], fields: Mapping[str, Any]) -> None:
    """Write what is known of a scan; every number survives exactly."""
    known = {name: value for name, value in fields.items() if value is not None}
    with replacing(file) as part, open(part, "wb") as stream:
        np.savez_compressed(stream, primfit="scan", **known)


def load_arrays(
    file: str | PathLike[str],
    arrays: Collection[str],
    indices: Collection[str],
    numbers: Collection[str],
    paths: Collection[str],
    truths: Collection[str],
) -> dict[str, Any]:
    """Arrays, whole numbers, numbers, paths and truths of a scan; all arrays must be there.

    Raises
    ------
    OSError
        When the file cannot be opened.
    ValueError
        When it is no scan that primfit wrote.
    MemoryError
        When the memory is too small for it.
    """
    path = as_path(file)
    with open(path, "rb"):
        pass
    try:
        with Archive(path) as archive:
            if "primfit" not in archive or archive["primfit"] != "scan":
                raise ValueError("it has no array 'primfit' that says 'scan'")
            names = sorted({*arrays, *indices, *numbers, *paths, *truths} & {*archive})
            missing = [name for name in arrays if name not in names]
            if missing:
                raise ValueError(f"it lacks {', '.join(missing)}")
            n = max(archive.shape("ranges"), default=0)
            return {
                name: _checked_path(name, archive[name])
                if name in paths
                else _checked(name, archive[name], n, name in indices, name in numbers)
                for name in names
            }
    except MemoryError as error:
        raise MemoryError(f"{file}: {error or 'too large'}") from None
    except Exception as error:  # archives that are damaged fail in many a place
        raise ValueError(f"{file} is not a scan that primfit wrote: {error}") from None


def _checked(name: str, array: Field, n: int, is_index: bool, is_number: bool) -> Any:
    """An array of a scan of `n` beams, whose type and shape are right."""
    if name == "is_mixed":
        if array.shape != (n,) or array.dtype.kind != "b":
            raise ValueError(f"its array {name!r} is {array.dtype} {array.shape}")
        return array
    is_column = is_index or name in ("ranges", "depths", "true_ranges")
    shapes: list[tuple[int, ...]] = [(n,)] if is_column else [(n, 3)]
    if is_number:
        shapes = [(), (n,)]
    if array.shape not in shapes or array.dtype.kind not in ("iu" if is_index else "fiu"):
        raise ValueError(f"its array {name!r} is {array.dtype} {array.shape}")
    if is_index:
        return array.astype(np.int64, copy=False)
    if is_number and not (np.isfinite(array).all() and (array >= 0.0).all()):
        raise ValueError(f"its {name} must be finite and at least 0, not {array}")
    return float(array) if array.ndim == 0 else array.astype(np.float64, copy=False)


def _checked_path(name: str, array: Field) -> Any:
    """Poses (p, 3) whose type and shape are right."""
    if array.ndim != 2 or array.shape[1] != 3 or array.dtype.kind not in "fiu":
        raise ValueError(f"its array {name!r} is {array.dtype} {array.shape}")
    if not np.isfinite(array).all():
        raise ValueError(f"its {name} must be finite")
    return array.astype(np.float64, copy=False)
