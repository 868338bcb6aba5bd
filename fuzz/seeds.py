"""Small files of all formats that are read, from which mutations start."""

from __future__ import annotations

import gzip
import json
import struct
from pathlib import Path

import numpy as np

import primfit

POINTS = np.random.default_rng(0).uniform(-20, 20, (40, 3))
FIELDS = {
    "intensity": np.arange(40, dtype=np.uint16),
    "color": np.arange(120, dtype=np.uint8).reshape(40, 3),
    "time": np.linspace(0, 1, 40),
}
CLOUD = primfit.Cloud(POINTS, FIELDS)
GRID = primfit.Cloud(POINTS, {"label": np.arange(40)}, (5, 8))

Seed = tuple[str, bytes]
"""Suffix and content; the suffixes ".scan" and ".world" are for the readers of these."""


def all_seeds(folder: Path) -> list[Seed]:
    """At least one file of each format and variant."""
    seeds: list[Seed] = []
    for suffix in (".ply", ".pcd", ".las", ".laz", ".e57", ".xyz", ".pts", ".csv", ".npy", ".npz"):
        for cloud in (CLOUD, GRID):
            file = folder / f"seed{suffix}"
            primfit.write_cloud(file, cloud)
            seeds.append((suffix, file.read_bytes()))
    seeds += [*_plys(), *_pcds(), *_texts(), *_las_files(folder), *_e57_files(folder)]
    scan = primfit.Scan.from_points(POINTS, origins=(30, 0, 0), sigma=0.01, max_range=99.0)
    scan.save(folder / "seed.npz")
    seeds += [(".scan", (folder / "seed.npz").read_bytes())]
    cube = primfit.Polyhedron.box(0.1, 0.2, 0.3, center=(1, 1, 1))
    world = primfit.World([primfit.Prism.regular(4, 0.3, center=(1, 1)), cube], primfit.Arena())
    seeds += [(".world", json.dumps({"primfit": "world", **world.to_dict()}).encode())]
    world.save(folder / "world.wbt")
    seeds += [(".wbt", (folder / "world.wbt").read_bytes())]
    return seeds


def _plys() -> list[Seed]:
    head = "ply\nformat {} 1.0\nelement face 2\nproperty list uchar int vertex_indices\n"
    head += "element vertex 3\nproperty float x\nproperty double y\nproperty short z\n"
    head += "property list ushort float feature\nproperty uchar red\nend_header\n"
    text = "3 0 1 2\n4 0 1 2 0\n" + "1.5 2 3 2 0.5 0.5 7\n" * 3
    seeds = [(".ply", head.format("ascii").encode() + text.encode())]
    for name, mark in (("binary_little_endian", "<"), ("binary_big_endian", ">")):
        faces = struct.pack(f"{mark}B3iB4i", 3, 0, 1, 2, 4, 0, 1, 2, 0)
        rows = struct.pack(f"{mark}fdhH2fB", 1.5, 2, 3, 2, 0.5, 0.5, 7) * 3
        seeds.append((".ply", head.format(name).encode() + faces + rows))
    return seeds


def _pcds() -> list[Seed]:
    head = "VERSION .7\nFIELDS x y z rgb fpfh\nSIZE 4 4 4 4 4\nTYPE F F F F F\nCOUNT 1 1 1 1 3\n"
    head += "WIDTH 4\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 4\nDATA "
    rows = np.arange(28, dtype="<f4").reshape(4, 7)
    text = "\n".join(" ".join(map(str, row)) for row in rows)
    columns = rows.T[:4].tobytes() + rows[:, 4:].tobytes()
    seeds = [(".pcd", f"{head}ascii\n{text}\n".encode())]
    seeds += [(".pcd", f"{head}binary\n".encode() + rows.tobytes())]
    # Runs of at most 32 bytes as they are: what LZF makes of what it cannot pack.
    runs = [columns[i : i + 32] for i in range(0, len(columns), 32)]
    packed = b"".join(bytes([len(run) - 1]) + run for run in runs)
    sizes = struct.pack("<II", len(packed), len(columns))
    return [*seeds, (".pcd", f"{head}binary_compressed\n".encode() + sizes + packed)]


def _texts() -> list[Seed]:
    rows = "1.5,2,3,tree,7\n4,5,6,wall,8\n"
    ptx = "4\n2\n" + "0 0 0\n1 0 0\n0 1 0\n0 0 1\n"
    ptx += "1 0 0 0\n0 1 0 0\n0 0 1 0\n5 6 7 1\n" + "1 2 3 0.5 9 8 7\n0 0 0 0.5 0 0 0\n" * 4
    return [
        (".csv", f'"Point Id","X [m]",Y,Z,"a, b"\n{rows}'.encode()),
        (".txt", b"\xef\xbb\xbf# a remark\n//X Y Z R G B\n" + b"1 2 3 4 5 6\n" * 5),
        (".asc", b"1;2;3\n4;5;6\n"),
        (".xyz.gz", gzip.compress(b"1 2 3 9007199254740993\n" * 9)),
        (".ptx", ptx.encode()),
        (".ptx", (ptx * 2).encode()),
        (".bin", np.arange(40, dtype="<f4").tobytes()),
    ]


def _las_files(folder: Path) -> list[Seed]:
    """Other versions and formats of points; several chunks, and records before and after points."""
    import laspy

    seeds: list[Seed] = []
    for point_format, version in ((0, "1.2"), (3, "1.2"), (1, "1.1"), (6, "1.4"), (8, "1.4")):
        header = laspy.LasHeader(point_format=point_format, version=version)
        header.add_extra_dims(
            [laspy.ExtraBytesParams("pair", "2f8"), laspy.ExtraBytesParams("e", "u1")]
        )
        header.vlrs.append(laspy.VLR("someone", 7, "note", b"content" * 3))
        las = laspy.LasData(header)
        las.x, las.y, las.z = POINTS.T
        if version == "1.4":
            las.evlrs = laspy.vlrs.vlrlist.VLRList(
                [laspy.VLR("someone", 8, "more", b"content" * 9)]
            )
        for suffix in (".las", ".laz"):
            las.write(folder / f"seed{suffix}")
            seeds.append((suffix, (folder / f"seed{suffix}").read_bytes()))
    return seeds


def _e57_files(folder: Path) -> list[Seed]:
    """Two scans with poses."""
    import pye57

    file = folder / "posed.e57"
    with pye57.E57(str(file), "w") as e57:
        for place in ([0, 0, 1], [5, 6, 2]):
            columns = dict(zip(("cartesianX", "cartesianY", "cartesianZ"), POINTS.T, strict=True))
            columns["intensity"] = np.linspace(0, 1, len(POINTS))
            e57.write_scan_raw(
                columns, rotation=np.array([1.0, 0, 0, 0]), translation=np.array(place)
            )
    return [(".e57", file.read_bytes())]
