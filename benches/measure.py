"""Time of calls beside each other, for the benchmarks of one kernel."""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError, version
from statistics import median
from typing import Any

import primfit


def print_versions(*packages: str) -> None:
    """What runs, and on what."""
    print(
        f"primfit {primfit.__version__}, Python {platform.python_version()}, {os.cpu_count()} CPUs"
    )
    for package in packages:
        try:
            print(f"{package} {version(package)}")
        except PackageNotFoundError:
            print(f"{package} is missing: install the extra `bench`")


def runs(calls: dict[str, Callable[[], Any]], repeat: int) -> dict[str, list[tuple[float, float]]]:
    """Wall and CPU seconds of each run of each call; every round makes each call in turn."""
    seconds: dict[str, list[tuple[float, float]]] = {name: [] for name in calls}
    for _ in range(repeat):
        for name, call in calls.items():
            wall, cpu = time.perf_counter(), time.process_time()
            call()
            seconds[name].append((time.perf_counter() - wall, time.process_time() - cpu))
    return seconds


def rounds(calls: dict[str, Callable[[], Any]], repeat: int) -> dict[str, tuple[float, float]]:
    """Median wall and CPU seconds of each call."""
    return {
        name: (median(wall for wall, _ in times), median(cpu for _, cpu in times))
        for name, times in runs(calls, repeat).items()
    }
