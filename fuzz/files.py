"""Damaged files for all readers, in child processes with limits: python fuzz/files.py --seconds 60.

Each input is told by the seed of the run and its number: --only NUMBER reads it again, and --keep
FOLDER writes what was at fault. Faults are: the end of the process, an error that is none of
ValueError, OSError and MemoryError, more than 2 CPU seconds, and more memory than 200 MB and 50
times the file.
"""

from __future__ import annotations

import argparse
import collections
import contextlib
import faulthandler
import json
import os
import subprocess
import sys
import tempfile
import time
import warnings
from pathlib import Path

import numpy as np
from mutations import mutated
from seeds import Seed, all_seeds

import primfit

CPU_SECONDS = 2.0
MOST_BYTES, BYTES_A_BYTE = 200 << 20, 50
ADDRESS_SPACE = 3 << 30
"""Bytes that a child may reserve beyond what it has at the start."""
BATCH = 2000
"""Inputs of a child."""
HANGS = 20
"""Seconds after which a child is stopped."""

READERS = {".scan": primfit.Scan.load, ".world": primfit.World.load, ".wbt": primfit.World.load}


def input_of(seeds: list[Seed], run: int, number: int) -> tuple[str, bytes]:
    """Suffix and content of an input."""
    rng = np.random.default_rng([run, number])
    suffix, content = seeds[int(rng.integers(len(seeds)))]
    others = [other for kind, other in seeds if kind == suffix]
    return suffix, mutated(suffix, content, others[int(rng.integers(len(others)))], rng)


def peak_of_memory(*, reset: bool = False) -> int:
    """Most bytes that the process had at once, since it was reset; 0 where nothing tells."""
    with contextlib.suppress(OSError):
        if reset:
            Path("/proc/self/clear_refs").write_text("5")
        for line in Path("/proc/self/status").read_text().splitlines():
            if line.startswith("VmHWM"):
                return int(line.split()[1]) << 10
    return 0


def limit_memory() -> None:
    """Let the process reserve a little more than it has."""
    with contextlib.suppress(ImportError, OSError):
        import resource

        now = int(Path("/proc/self/statm").read_text().split()[0]) * os.sysconf("SC_PAGE_SIZE")
        resource.setrlimit(resource.RLIMIT_AS, (now + ADDRESS_SPACE,) * 2)
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def read_all(run: int, first: int, last: int, folder: Path, deadline: float) -> None:
    """Read inputs, and print a line of JSON before and after each."""
    seeds = all_seeds(folder)
    warnings.simplefilter("ignore")
    limit_memory()
    for number in range(first, last):
        if time.time() > deadline:
            break
        suffix, content = input_of(seeds, run, number)
        file = folder / f"input{suffix.replace('.scan', '.npz').replace('.world', '.json')}"
        file.write_bytes(content)
        print(json.dumps({"begins": number, "suffix": suffix}), flush=True)
        before = peak_of_memory(reset=True)
        start, outcome, fault = time.process_time(), "read", ""
        faulthandler.dump_traceback_later(HANGS, exit=True)
        try:
            READERS.get(suffix, primfit.read_cloud)(file)
        except (ValueError, OSError, MemoryError) as error:
            outcome = type(error).__name__
            if str(file) not in str(error):
                fault = f"names no file: {outcome}: {error}"
        except BaseException as error:
            outcome, fault = type(error).__name__, f"{type(error).__name__}: {error}"
        faulthandler.cancel_dump_traceback_later()
        seconds, memory = time.process_time() - start, peak_of_memory() - before
        if seconds > CPU_SECONDS:
            fault = f"{seconds:.1f} CPU s"
        if memory > MOST_BYTES + BYTES_A_BYTE * len(content):
            fault = f"{memory >> 20} MB for {len(content)} bytes"
        line = {"outcome": outcome, "fault": fault, "seconds": seconds, "memory": memory}
        print(json.dumps(line), flush=True)


def main() -> int:
    """Run children until the time or the inputs end; tell what they found."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--inputs", type=int, default=10**9)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", type=int)
    parser.add_argument("--keep", type=Path)
    parser.add_argument("--child", type=float, nargs=3, help=argparse.SUPPRESS)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        if options.child:
            first, last, deadline = options.child
            read_all(options.seed, int(first), int(last), Path(name), deadline)
            return 0
        if options.only is not None:
            read_all(options.seed, options.only, options.only + 1, Path(name), np.inf)
            return 0
        return supervise(options, Path(name))


def supervise(options: argparse.Namespace, folder: Path) -> int:
    """The parent's part."""
    deadline, number = time.time() + options.seconds, 0
    outcomes: collections.Counter[tuple[str, str]] = collections.Counter()
    faults: list[tuple[int, str, str]] = []
    slowest = largest = 0.0
    while number < options.inputs and time.time() < deadline:
        last = min(number + BATCH, options.inputs)
        command = [sys.executable, __file__, "--seed", str(options.seed)]
        command += ["--child", str(number), str(last), str(deadline)]
        child = subprocess.run(command, capture_output=True, text=True, check=False)
        lines = [json.loads(line) for line in child.stdout.splitlines() if line.startswith("{")]
        for before, after in zip(lines[::2], lines[1::2], strict=False):
            number = before["begins"] + 1
            outcomes[before["suffix"], after["outcome"]] += 1
            slowest = max(slowest, after["seconds"])
            largest = max(largest, after["memory"])
            if after["fault"]:
                faults.append((before["begins"], before["suffix"], after["fault"]))
        if len(lines) % 2:
            why = f"the process ended with {child.returncode}: {child.stderr.strip()[-300:]}"
            faults.append((lines[-1]["begins"], lines[-1]["suffix"], why))
            number = lines[-1]["begins"] + 1
        elif child.returncode:
            print(child.stderr, file=sys.stderr)
            return 2
    for suffix in sorted({suffix for suffix, _ in outcomes}):
        counts = {what: n for (kind, what), n in sorted(outcomes.items()) if kind == suffix}
        print(f"{suffix:8} {counts}")
    print(f"{number} inputs, slowest {slowest:.2f} CPU s, most memory {largest / 2**20:.0f} MB")
    seeds = all_seeds(folder) if options.keep and faults else []
    for which, suffix, fault in faults:
        print(f"FAULT {which} {suffix} {fault}")
        if options.keep:
            options.keep.mkdir(parents=True, exist_ok=True)
            content = input_of(seeds, options.seed, which)[1]
            (options.keep / f"{options.seed}_{which}{suffix}").write_bytes(content)
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
