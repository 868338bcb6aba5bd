"""Bounded planes to polyhedra: sampled solids, seen whole, standing on a floor, or open."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
import shapely
from polyhedra import HIP, SHAPES, turned
from scipy.spatial import ConvexHull

import primfit
from primfit.planes.plane import Plane
from primfit.worlds.random_polyhedra import POLYHEDRA, random_polyhedron


def sampled(solid, n, sigma, rng):
    """Points on a surface, alike dense, with the face of each."""
    vertices, triangles = solid.to_mesh()
    a, b, c = np.moveaxis(vertices[triangles], 1, 0)
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    k = rng.choice(len(triangles), n, p=areas / areas.sum())
    u, v = rng.random((2, n, 1))
    points = a[k] + np.sqrt(u) * ((1 - v) * (b[k] - a[k]) + v * (c[k] - a[k]))
    offsets = [
        normal @ solid.vertices[face[0]]
        for normal, face in zip(solid.normals, solid.faces, strict=True)
    ]
    # Of a triangle's own plane: the face that all three corners lie in and look along with.
    normal = np.cross(b - a, c - a) / areas[:, None]
    off = np.abs(normal @ solid.normals.T - 1) + np.abs(a @ solid.normals.T - offsets)
    return points + rng.normal(size=(n, 3)) * sigma, off.argmin(axis=1)[k]


def planes_of(points, labels, rng, convex=True):
    """Planes fitted to labelled points, each with its normal on either side."""
    planes = []
    for label in np.unique(labels[labels >= 0]):
        rows = np.flatnonzero(labels == label)
        center = points[rows].mean(axis=0)
        axes = np.linalg.svd(points[rows] - center, full_matrices=False)[2]
        if rng.random() < 0.5:
            axes = axes[[1, 0, 2]] * [[1], [1], [-np.linalg.det(axes[[1, 0, 2]])]]
        axes[2] = np.cross(axes[0], axes[1])
        flat = (points[rows] - center) @ axes[:2].T
        if convex:
            hull = ConvexHull(flat)
            outline, area = flat[hull.vertices], hull.volume
        else:
            shape = shapely.concave_hull(shapely.MultiPoint(flat), ratio=0.1)
            outline = shapely.get_coordinates(shapely.orient_polygons(shape).exterior)[:-1]
            area = shape.area
        equation = np.append(axes[2], -axes[2] @ center)
        rms = float(np.sqrt(((points[rows] @ axes[2] + equation[3]) ** 2).mean()))
        boundary = center + outline @ axes[:2]
        planes.append(Plane(equation, rows, boundary, area, rms, np.full((4, 4), np.nan)))
    return planes


def compared(solid, polyhedra, found):
    """Kind right, centre error over size, angle error in degrees."""
    size = np.ptp(solid.vertices, axis=0).max()
    report = primfit.evaluate(
        replace(found, solids=polyhedra.solids), primfit.World([solid]), max_distance=size
    )
    (row,) = report.rows
    return row.found == row.truth, 1e-3 * row.center_error_mm / size, row.angle_error_deg


class TestWholeSolids:
    def test_random_solids_in_noise(self, found):
        results = []
        for seed in range(2000, 2030):
            rng = np.random.default_rng(seed)
            kind = list(POLYHEDRA)[seed % len(POLYHEDRA)]
            solid = random_polyhedron(kind, POLYHEDRA[kind], (0, 6.28), rng, tilted=True)
            sigma = 0.01 * np.ptp(solid.vertices, axis=0).max()
            points, labels = sampled(solid, 10_000, sigma, rng)
            polyhedra = primfit.find_polyhedra(planes_of(points, labels, rng), points)
            results.append(compared(solid, polyhedra, found))
        right, center, angle = np.array(results).T
        assert right.mean() >= 0.96
        assert np.median(center) < 0.002
        assert np.median(angle) < 0.2

    @pytest.mark.parametrize("name", ["ell", "stairs", "star", "hip", "leaning"])
    @pytest.mark.parametrize("noise", [0.0, 0.005])
    def test_any_shape_far_away(self, name, noise, found):
        rng = np.random.default_rng(5)
        solid = turned(SHAPES[name][0], 5, 1e5)[0]
        size = np.ptp(solid.vertices, axis=0).max()
        points, labels = sampled(solid, 40_000, noise * size, rng)
        polyhedra = primfit.find_polyhedra(planes_of(points, labels, rng, convex=False), points)
        right, center, angle = compared(solid, polyhedra, found)
        assert right
        assert center < (1e-3 if noise else 1e-6)
        assert angle < (0.2 if noise else 1e-3)
        (one,) = polyhedra.solids
        assert all(one.observed)
        assert sorted(one.planes) == list(range(len(solid.faces)))
        assert one.volume == pytest.approx(solid.volume, rel=0.01)
        np.testing.assert_allclose(one.centroid, solid.centroid, atol=0.002 * size)
        assert len(polyhedra.edges) == len(solid.edges)
        assert json.loads(json.dumps(one.to_dict()))["kind"] == solid.kind

    def test_faces_are_flat_where_more_than_three_meet(self):
        rng = np.random.default_rng(3)
        solid = turned(SHAPES["pyramid"][0], 3)[0]
        points, labels = sampled(solid, 10_000, 0.03, rng)
        (one,) = primfit.find_polyhedra(planes_of(points, labels, rng), points).solids
        assert one.vertices.shape == (5, 3)
        again = primfit.Polyhedron(one.vertices, one.faces)
        assert (again.volume, len(again.faces)) == (pytest.approx(one.volume), 5)


class TestUnseenFaces:
    def scene(self, floor):
        """Three solids that stand on the floor, whose bases nobody sees."""
        rng = np.random.default_rng(7)
        solids = [
            primfit.Polyhedron.wedge(0.4, 0.3, 0.2, center=(0, 0, 0.2 / 3)),
            primfit.Polyhedron.frustum(4, 0.3, 0.2, 0.2, center=(1, 0, 0.1)),
            primfit.Polyhedron.box(0.3, 0.2, 0.2, center=(0, 1, 0.1)),
        ]
        points, labels = [], []
        for i, solid in enumerate(solids):
            some, face = sampled(solid, 10_000, 0.001, rng)
            seen = solid.normals[face, 2] > -0.9
            points.append(some[seen])
            labels.append(10 * i + face[seen])
        if floor:
            xy = rng.uniform(-0.5, 1.5, (20_000, 2))
            free = ~shapely.contains_xy(shapely.union_all([each.shadow for each in solids]), *xy.T)
            points.append(np.column_stack([xy, 0.001 * rng.normal(size=len(xy))])[free])
            labels.append(np.full(free.sum(), 100))
        return solids, np.concatenate(points), np.concatenate(labels), rng

    @pytest.mark.parametrize("floor", [True, False])
    def test_the_seen_ones_force_the_base(self, floor, found):
        solids, points, labels, rng = self.scene(floor)
        planes = planes_of(points, labels, rng)
        polyhedra = primfit.find_polyhedra(planes, points)
        report = primfit.evaluate(replace(found, solids=polyhedra.solids), primfit.World(solids))
        assert report.all_right
        assert max(row.center_error_mm for row in report.rows) < (0.5 if floor else 5.0)
        assert max(row.angle_error_deg for row in report.rows) < 1.0
        assert not polyhedra.shells
        box = next(solid for solid in polyhedra.solids if solid.kind == "rectangle")
        assert box.size == pytest.approx((0.3, 0.2), abs=0.002)
        np.testing.assert_allclose(box.footprint.mean(axis=0), [0, 1], atol=0.001)
        for solid in polyhedra.solids:
            assert solid.observed.count(False) == 1
            base = solid.observed.index(False)
            assert solid.planes[base] == (len(planes) - 1 if floor else -1)

    @pytest.mark.parametrize("hidden", [(0, 2), (0, 1)])
    def test_two_faces_that_nobody_saw(self, hidden):
        solid, planes, points = self.box_without(hidden)
        (one,) = primfit.find_polyhedra(planes, points).solids
        assert one.kind == "box"
        assert sum(one.observed) == 4
        assert one.size == pytest.approx(solid.size, rel=0.01)
        np.testing.assert_allclose(one.center, solid.center, atol=0.02)

    def test_a_corner_of_three_faces_is_half_a_solid_if_seen_from_outside(self):
        solid, planes, points = self.box_without((0, 1, 5))
        assert primfit.find_polyhedra(planes, points).shells == ((0, 1, 2),)

        def facing(sign):
            out = [sign * (plane.boundary.mean(axis=0) - solid.center) for plane in planes]
            return [
                replace(plane, equation=plane.equation * np.sign(plane.equation[:3] @ way))
                for plane, way in zip(planes, out, strict=True)
            ]

        (one,) = primfit.find_polyhedra(facing(1.0), points, facing=True).solids
        assert one.kind == "box"
        assert one.size == pytest.approx(solid.size, rel=0.01)
        np.testing.assert_allclose(one.center, solid.center, atol=0.02)
        assert not primfit.find_polyhedra(facing(-1.0), points, facing=True).solids

    def test_two_faces_that_meet_do_not_close(self):
        _, planes, points = self.box_without((0, 1, 4, 5))
        polyhedra = primfit.find_polyhedra(planes, points)
        assert not polyhedra.solids
        assert polyhedra.shells == ((0, 1),)

    def box_without(self, hidden):
        solid = primfit.Polyhedron.box(3, 2, 1, quat_xyzw=(0.3, 0.2, 0.1, 1))
        rng = np.random.default_rng(1)
        points, labels = sampled(solid, 10_000, 0.0, rng)
        seen = ~np.isin(labels, hidden)
        return solid, planes_of(points[seen], labels[seen], rng), points[seen]


class TestInput:
    def test_nothing_and_single_planes(self):
        empty = primfit.find_polyhedra([], np.empty((0, 3)))
        assert repr(empty) == "Polyhedra(0 solids: none; 0 open shells; 0 edges)"
        assert empty.edges.shape == (0, 2)
        points = np.random.default_rng(1).random((100, 3)) * [1, 1, 0]
        flat = planes_of(points, np.zeros(100, dtype=int), np.random.default_rng(1))
        assert not primfit.find_polyhedra(flat, points).solids
        line = replace(flat[0], boundary=flat[0].boundary[:2], area=0.0)
        assert not primfit.find_polyhedra([flat[0], line], points).shells

    def test_points_without_return_may_be_there(self):
        rng = np.random.default_rng(2)
        points, labels = sampled(HIP, 10_000, 0.0, rng)
        points = np.vstack([points, np.full((5, 3), np.nan)])
        labels = np.append(labels, np.full(5, -1))
        (one,) = primfit.find_polyhedra(planes_of(points, labels, rng), points).solids
        assert one.kind == "polyhedron"
        assert "6 of" not in repr(one)

    def test_bad_points(self):
        with pytest.raises(ValueError, match=r"points must be an array \(n, 3 or more\)"):
            primfit.find_polyhedra([], np.zeros((2, 2)))
