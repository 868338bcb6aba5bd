"""Pieces of work on any executor, again where a worker is lost."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Hashable, Iterator
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from contextlib import ExitStack
from typing import Any, TypeVar

Key = TypeVar("Key", bound=Hashable)
Result = TypeVar("Result")

_TRIES = 3
"""Times that a piece is tried: once more could be chance, which a second loss is not."""

_AT_ONCE = 1 << 28
"""Bytes of pieces that wait for workers at a time, or one piece: they are copies in memory."""


def results_of(
    executor: Executor | None,
    work: Callable[..., Result],
    load: Callable[[Key], tuple[Any, ...]],
    n_bytes: dict[Key, int],
) -> Iterator[tuple[Key, Result]]:
    """`work(*load(key))` for each key of `n_bytes`, the largest first, in the order of completion.

    A piece that fails is tried again. When the executor itself breaks, as a pool of processes does
    with any of them, a pool like it takes its place for what is left.

    Raises
    ------
    RuntimeError
        When an executor broke on the same piece each time, or else what the piece raised.
    """
    keys = sorted(n_bytes, key=lambda key: -n_bytes[key])
    if executor is None:
        for key in keys:
            yield key, work(*load(key))
        return
    waiting, tries = deque(keys), Counter[Key]()
    flying: dict[Future[Result], Key] = {}
    with ExitStack() as stack:
        stack.callback(lambda: [future.cancel() for future in flying])
        while waiting or flying:
            is_broken = False
            while waiting and not is_broken and _fit(waiting[0], flying, n_bytes):
                try:
                    flying[executor.submit(work, *load(waiting[0]))] = waiting[0]
                    waiting.popleft()
                except BrokenExecutor:
                    is_broken = True
            done = set(flying)
            if not is_broken:
                done = wait(flying, return_when=FIRST_COMPLETED).done
            for future in done:
                key = flying.pop(future)
                try:
                    result = future.result()
                except Exception as error:
                    is_broken |= isinstance(error, BrokenExecutor)
                    tries[key] += 1
                    if tries[key] == _TRIES:
                        raise _final(error, key) from error
                    waiting.append(key)
                else:
                    yield key, result
            if is_broken:
                executor = stack.enter_context(_pool_like(executor))
                waiting.extend(flying.values())
                flying.clear()


def _fit(key: Key, flying: dict[Future[Result], Key], n_bytes: dict[Key, int]) -> bool:
    return not flying or n_bytes[key] + sum(n_bytes[each] for each in flying.values()) <= _AT_ONCE


def _final(error: Exception, key: Hashable) -> Exception:
    if not isinstance(error, BrokenExecutor):
        return error
    return RuntimeError(
        f"workers were lost {_TRIES} times while they had tile {key}: they may have run out of "
        f"memory, of which smaller tiles need less ({error})"
    )


def _pool_like(executor: Executor) -> Executor:
    from concurrent.futures import ProcessPoolExecutor
    from multiprocessing import get_context

    return ProcessPoolExecutor(
        getattr(executor, "_max_workers", None),
        getattr(executor, "_mp_context", None) or get_context("spawn"),
    )
