"""Checks of what users pass; each message names the argument, what was expected and what came."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]


MOST_JOBS = 1024
"""Threads that may be asked for."""


MOST_COORDINATE = 1e50
"""Largest coordinate, metres: products of six, which moments of points are, fit in float64."""


def as_rows(
    name: str,
    values: ArrayLike,
    n_columns: int,
    *,
    finite: bool = True,
    most: float = MOST_COORDINATE,
) -> Floats:
    """``values`` as a C-contiguous (n, n_columns) float64 array, within `most` if finite."""
    array = as_floats(name, values)
    if array.ndim != 2 or array.shape[1] != n_columns:
        raise ValueError(f"{name} must have shape (n, {n_columns}), not {array.shape}")
    if finite and array.size and not (array.max() <= most and array.min() >= -most):
        check_finite(name, array)
        check_within(name, array, most)
    return np.ascontiguousarray(array)


def check_within(name: str, array: Floats, most: float = MOST_COORDINATE) -> None:
    """Refuse finite numbers that are larger than `most`, and say where the first is."""
    is_large = np.abs(array) > most
    if is_large.any() and (is_large := is_large & np.isfinite(array)).any():
        row = int(np.argmax(is_large.any(axis=1)))
        raise ValueError(
            f"{name} must be within {most:g} m, but row {row} is {array[row].tolist()}: float64 "
            f"does not hold what is computed of it"
        )


def as_vector(name: str, values: ArrayLike, length: int) -> Floats:
    """``values`` as a finite float64 array of the given length."""
    array = as_floats(name, values)
    if array.shape != (length,):
        raise ValueError(f"{name} must have shape ({length},), not {array.shape}")
    check_finite(name, array)
    return array


def as_column(name: str, values: ArrayLike, n_rows: int) -> Floats:
    """``values`` as a float64 array of one number a row; one number serves for all."""
    array = as_floats(name, values)
    if array.shape not in ((), (n_rows,)):
        raise ValueError(f"{name} must be a number or have shape ({n_rows},), not {array.shape}")
    return np.ascontiguousarray(np.broadcast_to(array, (n_rows,)))


def as_floats(name: str, values: ArrayLike) -> Floats:
    """``values`` as a float64 array of any shape."""
    try:
        array = np.asarray(values)
        if array.dtype.kind not in "biuf" and array.size:
            raise TypeError(f"its elements are {array.dtype}")
        return array.astype(np.float64, copy=False)
    except (TypeError, ValueError) as error:
        raise TypeError(f"{name} must be an array of numbers: {error}") from None


def check_finite(name: str, array: Floats) -> None:
    """Refuse NaN and infinity, and say where the first is."""
    if array.size and not np.isfinite(array).all():
        bad = np.flatnonzero(~np.isfinite(array).reshape(len(array), -1).all(axis=1))
        raise ValueError(
            f"{name} must be finite, but {len(bad)} of {len(array)} rows are not (the first is row "
            f"{bad[0]}); leave them out, for example with np.isfinite({name})"
        )


def number(name: str, value: Any, *, low: float = -np.inf, above: float = -np.inf) -> float:
    """``value`` as a finite float that is at least ``low`` and greater than ``above``."""
    try:
        if isinstance(value, str | bytes) or np.ndim(value):
            raise TypeError
        result = float(value)
    except OverflowError:
        raise ValueError(f"{name} must be finite, not {value!r}") from None
    except (TypeError, ValueError):
        raise TypeError(f"{name} must be a number, not {value!r}") from None
    if not np.isfinite(result):
        raise ValueError(f"{name} must be finite, not {value!r}")
    if result <= above:
        raise ValueError(f"{name} must be greater than {above:g}, not {value!r}")
    if result < low:
        raise ValueError(f"{name} must be at least {low:g}, not {value!r}")
    return result


def turn(name: str, value: Any) -> float:
    """``value`` as a finite float, radians; more than a full turn warns: it may be degrees."""
    result = number(name, value)
    if abs(result) > 2.0 * np.pi:
        warnings.warn(
            f"{name} is {result:g} radians, more than a full turn; if degrees are meant, use "
            f"numpy.radians",
            stacklevel=3,
        )
    return result


MOST_CORNERS = 10_000
"""Corners of a polygon that may be asked for; a solid of them takes megabytes."""

MOST_INTEGER = 2**62
"""Largest whole number that a kernel gets; it has 64 bits for it, and for what it adds."""


def integer(name: str, value: Any, *, low: int, high: int = MOST_INTEGER) -> int:
    """``value`` as an int from ``low`` to ``high``; by default what fits in 64 bits."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer):
        raise TypeError(f"{name} must be an integer, not {value!r}")
    if value < low:
        raise ValueError(f"{name} must be at least {low}, not {value!r}")
    if value > high:
        most = "2**62" if high == MOST_INTEGER else high
        raise ValueError(f"{name} must be at most {most}, not {value!r}")
    return int(value)


def generator(rng: Any) -> np.random.Generator:
    """The random numbers of an argument `rng`."""
    try:
        return np.random.default_rng(rng)
    except (TypeError, ValueError) as error:
        raise type(error)(
            f"rng must be None, an integer of at least 0 or a numpy.random.Generator, not {rng!r}"
        ) from None


def choice(name: str, value: str, choices: Sequence[str]) -> str:
    """``value`` when it is one of ``choices``."""
    if not isinstance(value, str):
        raise TypeError(f"{name} must be one of {', '.join(map(repr, choices))}, not {value!r}")
    if value not in choices:
        raise ValueError(f"{name} must be one of {', '.join(map(repr, choices))}, not {value!r}")
    return value


def n_jobs_or_none(n_jobs: int | None) -> int | None:
    """The number of threads to ask for; -1 means as many as there are, which is the default."""
    if n_jobs is None or (isinstance(n_jobs, int) and n_jobs == -1):
        return None
    if integer("n_jobs", n_jobs, low=1) > MOST_JOBS:
        raise ValueError(f"n_jobs must be at most {MOST_JOBS}, not {n_jobs!r}")
    return int(n_jobs)


def range_of(name: str, values: Any, *, above: float = -np.inf) -> tuple[float, float]:
    """``values``, a number or a pair, as (low, high)."""
    try:
        low, high = np.broadcast_to(np.asarray(values, dtype=float), (2,))
    except (TypeError, ValueError):
        raise ValueError(
            f"{name} must be a number or a range (low, high), not {values!r}"
        ) from None
    if not (np.isfinite([low, high]).all() and above < low <= high):
        what = "a range of positive numbers" if above == 0.0 else "a range (low, high), low <= high"
        raise ValueError(f"{name} must be {what}, not {values!r}")
    return float(low), float(high)


def instance(name: str, value: Any, kind: type) -> None:
    """Refuse what is not of a class."""
    if not isinstance(value, kind):
        article = "an" if kind.__name__[0] in "AEIOU" else "a"
        raise TypeError(f"{name} must be {article} {kind.__name__}, not {type(value).__name__}")


def writable(array: NDArray[Any]) -> Any:
    """The array, or a copy when it must not be written to, which other libraries do not take."""
    return array if array.flags.writeable else array.copy()
