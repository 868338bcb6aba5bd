"""A bar, or a callable that is told how far a long call has come."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from tqdm import tqdm

Progress = bool | Callable[[int, int], None]


@contextmanager
def reporting(progress: Progress, total: int, unit: str) -> Iterator[Callable[[int], None]]:
    """Gives a function to call with the number done so far.

    True shows a bar of `total` units; a callable gets the number done and in all.
    """
    with tqdm(total=total, unit=unit, disable=progress is not True) as bar:

        def tell(n_done: int) -> None:
            bar.update(n_done - bar.n)
            if callable(progress):
                progress(n_done, total)

        yield tell
