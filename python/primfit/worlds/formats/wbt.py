"""Worlds of Webots (.wbt), of R2023b when written, of any release when read.

Written worlds were not opened in Webots itself.
"""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from primfit._check import Floats, Ints
from primfit.geometry.extrusions import prism_faces, prism_vertices
from primfit.solids.frusta import Cone, Cylinder
from primfit.solids.polyhedron import Polyhedron
from primfit.solids.prism import Prism
from primfit.solids.round import Round
from primfit.solids.solid import Solid
from primfit.solids.sphere import Sphere
from primfit.worlds.arena import Arena
from primfit.worlds.formats.vrml import Node, nodes_of
from primfit.worlds.meshes import each_once
from primfit.worlds.world import COLORS, OTHER_COLOR, World

_PROTOS = "https://raw.githubusercontent.com/cyberbotics/webots/R2023b/projects/objects"

_ARENA = "PRIMFIT_ARENA"
"""Name of the inner walls of an arena that is no rectangle, which Webots has no node for."""

_LEVEL = 1e-9
"""How far from one height, as a share of the size, the corners of a level face may be: ten
thousand times the rounding of float64, and less than Webots' own single precision tells."""

_GROUPS = ("Group", "Transform", "Pose", "Solid")

_BOXES = {
    "SolidBox": [2.0, 2.0, 2.0],
    "CardboardBox": [0.6, 0.6, 0.6],
    "WoodenBox": [0.6, 0.6, 0.6],
    "LegoWall": [0.016, 0.05, 0.096],
}
"""Protos that are a box around their origin, with the default of their field `size`; a LegoWall has
none, but also a base without thickness, which lies on the floor."""

_STANDING = {"CardboardBox": 0.3, "WoodenBox": 0.3, "LegoWall": 0.025}
"""Height of protos that are not told where they are."""

_SPHERE_FACES = 5
"""The finest subdivision that Webots draws a sphere with."""

_NO_GEOMETRY = {
    "WorldInfo",
    "Viewpoint",
    "Background",
    "TexturedBackground",
    "TexturedBackgroundLight",
    "DirectionalLight",
    "PointLight",
    "SpotLight",
    "Fog",
    "Floor",
}
"""What beams do not meet, and the floor, which every world has."""


def write(path: Path, world: World) -> None:
    """Arena, floor and solids, these as static meshes with a bounding object each."""
    path.write_text(text_of(world))


def text_of(world: World) -> str:
    """The world in the language of Webots."""
    lines = ["#VRML_SIM R2023b utf8", ""]
    if world.arena is not None and _is_upright_rectangle(world.arena.outline):
        lines.append(f'EXTERNPROTO "{_PROTOS}/floors/protos/RectangleArena.proto"')
    low, high = world.bounds
    x, y = ((low + high) / 2).tolist()
    far = float(np.max(high - low, initial=1.0))
    lines += [
        'WorldInfo { title "primfit world" coordinateSystem "ENU" }',
        f"Viewpoint {{ orientation -0.58 0.58 0.58 2.09 position {x!r} {y!r} {2.5 * far!r} }}",
        "Background { skyColor [ 0.7 0.8 0.9 ] }",
        "DirectionalLight { direction 0.3 0.4 -1 }",
    ]
    if world.arena is not None:
        lines += _arena_lines(world.arena)
    for i, solid in enumerate(world.solids):
        color = COLORS.get(solid.kind, OTHER_COLOR)
        geometry, place = _round_node(solid) or (_mesh_node(solid.vertices, solid.faces), "")
        lines += _solid_lines(f"DEF SOLID_{i}", f"{solid.kind} {i}", geometry, color, place)
    return "\n".join(lines) + "\n"


def _is_upright_rectangle(outline: Floats) -> bool:
    low, high = outline.min(axis=0), outline.max(axis=0)
    return len(outline) == 4 and bool(np.isin(outline, [low, high]).all())


def _arena_lines(arena: Arena) -> list[str]:
    if not _is_upright_rectangle(arena.outline):
        m = len(arena.outline)
        vertices = prism_vertices(arena.outline, 0.0, arena.height)
        inner = [face[::-1] for face in prism_faces(m)[:m]]
        return _solid_lines(f"DEF {_ARENA}", "arena", _mesh_node(vertices, inner), OTHER_COLOR)
    low, high = arena.bounds
    (x, y), (width, depth) = ((low + high) / 2).tolist(), (high - low).tolist()
    return [
        f"RectangleArena {{ translation {x!r} {y!r} 0 floorSize {width!r} {depth!r} "
        f"wallHeight {arena.height!r} }}"
    ]


def _round_node(solid: Solid) -> tuple[str, str] | None:
    """Geometry and place of what Webots has a node for that bodies can meet, else None."""
    if isinstance(solid, Cylinder):
        node = f"Cylinder {{ radius {solid.radius!r} height {solid.height!r} subdivision 64 }}"
    elif isinstance(solid, Sphere):
        node = f"Sphere {{ radius {solid.radius!r} subdivision {_SPHERE_FACES} }}"
    else:
        return None
    x, y, z = solid.axis.tolist()
    across = float(np.hypot(x, y))
    # About a level axis, from the vertical to the axis of the solid.
    about = (-y / across, x / across) if across else (1.0, 0.0)
    turn = float(np.arctan2(across, z))
    place = "  translation {!r} {!r} {!r} rotation {!r} {!r} 0 {!r}"
    return node, place.format(*solid.center.tolist(), *about, turn)


def _mesh_node(vertices: Floats, faces: Any) -> str:
    points = ", ".join(" ".join(map(repr, row)) for row in vertices.tolist())
    indices = " -1 ".join(" ".join(map(str, face.tolist())) for face in faces)
    coord = f"coord Coordinate {{ point [ {points} ] }}"
    return f"IndexedFaceSet {{ {coord} coordIndex [ {indices} -1 ] }}"


def _solid_lines(
    define: str, name: str, geometry: str, color: tuple[int, int, int], place: str = ""
) -> list[str]:
    shade = " ".join(f"{value / 255:.3f}" for value in color)
    return [
        f"{define} Solid {{",
        *([place] if place else []),
        "  children [ Shape {",
        f"    appearance PBRAppearance {{ baseColor {shade} roughness 1 metalness 0 }}",
        f"    geometry DEF MESH_{define.split()[1]} {geometry}",
        "  } ]",
        f'  name "{name}"',
        f"  boundingObject USE MESH_{define.split()[1]}",
        "}",
    ]


def read(path: Path) -> World:
    """What beams meet of a world; the rest is counted in `World.left_out`."""
    text = path.read_text(encoding="utf-8", errors="replace")
    head = re.match(r"#VRML_SIM V?(R?)(\d+)([a-z]?)", text)
    if head is None:
        raise ValueError("its first line does not begin with #VRML_SIM")
    nodes = nodes_of(text)
    info = next((node for node in nodes if node.kind == "WorldInfo"), Node("WorldInfo"))
    since_2022 = head[1] == "R" and int(head[2]) >= 2022
    system = info.fields.get("coordinateSystem", "ENU" if since_2022 else "NUE")
    if system not in ("ENU", "NUE"):
        raise ValueError(f"its coordinateSystem is {system!r}, not ENU or NUE")
    scene = _Scene(system == "NUE")
    for node in nodes:
        scene.add(node, scene.upright)
    return scene.world()


class _Scene:
    """Solids as they are found in nodes, with z up."""

    def __init__(self, is_y_up: bool) -> None:
        self._is_y_up = is_y_up
        # East, north and up are z, x and y of north, up and east.
        self.upright = np.eye(4)[[2, 0, 1, 3]] if is_y_up else np.eye(4)
        self._solids: list[tuple[Floats, list[Ints]] | Round] = []
        self._arena: tuple[Floats, float] | None = None
        self._left_out: Counter[str] = Counter()

    def add(self, node: Node, parent: Floats) -> None:
        """What a node holds, in the frame of its parent."""
        if node.kind in _NO_GEOMETRY:
            return
        frame = parent @ placement(node, is_y_up=self._is_y_up)
        try:
            if node.name == _ARENA:
                self._add_outline(node, frame)
            elif node.kind == "RectangleArena" and self._arena is None:
                self._add_rectangle(node, frame)
            elif node.kind in _GROUPS:
                for child in children_of(node):
                    self.add(child, frame)
            elif node.kind == "Shape":
                self._add_geometry(node.fields.get("geometry"), parent)
            elif node.kind in _BOXES:
                self._add_box(_vector(node, "size", _BOXES[node.kind]), np.zeros(3), frame)
            elif node.kind == "Wall":
                default = [1.0, 2.4, 0.2] if self._is_y_up else [0.2, 1.0, 2.4]
                size = _vector(node, "size", default)
                up = np.array([0.0, 1.0, 0.0] if self._is_y_up else [0.0, 0.0, 1.0])
                self._add_box(size, up * size / 2, frame)
            else:
                self._left_out[node.kind] += 1
        except ValueError:
            # A surface that is not closed, or has no volume, is no solid.
            self._left_out[node.kind] += 1

    def _add_geometry(self, geometry: Node | None, frame: Floats) -> None:
        if geometry is None:
            return
        if geometry.kind == "Box":
            default = [2.0, 2.0, 2.0] if self._is_y_up else [0.1, 0.1, 0.1]
            self._add_box(_vector(geometry, "size", default), np.zeros(3), frame)
        elif geometry.kind in ("Cylinder", "Cone", "Sphere"):
            self._add_round(geometry, frame)
        elif geometry.kind == "IndexedFaceSet":
            vertices, faces = _mesh(geometry)
            self._add(vertices, faces, frame)
        else:
            self._left_out[geometry.kind] += 1

    def _add_round(self, node: Node, frame: Floats) -> None:
        """A cylinder, cone or sphere; a cylinder that its frame stretches is a polyhedron."""
        turn, center = frame[:3, :3], frame[:3, 3]
        scale = float(np.sqrt((turn * turn).sum() / 3.0))
        off = np.einsum("ki,kj->ij", turn, turn) - scale**2 * np.eye(3)
        is_stretched = np.abs(off).max() > _LEVEL * scale**2
        # Rounding of a turn is no scale.
        scale = 1.0 if abs(scale - 1.0) < _LEVEL else scale
        axis = turn[:, 1 if self._is_y_up else 2]
        if node.kind == "Cylinder":
            radius = _scalar(node, "radius", 1.0 if self._is_y_up else 0.05)
            height = _scalar(node, "height", 2.0 if self._is_y_up else 0.1)
            if is_stretched:
                footprint = Prism.circle(radius).footprint
                vertices = prism_vertices(footprint, -height / 2, height / 2)
                upright = vertices[:, [1, 2, 0]] if self._is_y_up else vertices
                self._add(upright, _prism(footprint), frame)
            else:
                self._solids.append(Cylinder(scale * radius, scale * height, center, axis))
            return
        if is_stretched:
            raise ValueError(f"{node.kind} must not be stretched")
        if node.kind == "Sphere":
            self._solids.append(Sphere(scale * _told(node, "radius"), center))
        else:
            sizes = _told(node, "bottomRadius"), _told(node, "height")
            self._solids.append(Cone(scale * sizes[0], scale * sizes[1], center, axis))

    def _add_box(self, size: Floats, center: Floats, frame: Floats) -> None:
        width, depth, height = size
        footprint = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * [width / 2, depth / 2]
        vertices = prism_vertices(footprint, -height / 2, height / 2)
        self._add(vertices + center, _prism(footprint), frame)

    def _add(self, vertices: Floats, faces: list[Ints], frame: Floats) -> None:
        _solid(_placed(vertices, frame), faces)
        self._solids.append((_placed(vertices, frame), faces))

    def _add_rectangle(self, node: Node, frame: Floats) -> None:
        width, depth = _vector(node, "floorSize", [1.0, 1.0])
        corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * [width / 2, depth / 2]
        at = 1 if self._is_y_up else 2
        outline = _placed(np.insert(corners, at, 0.0, axis=1), frame)
        self._arena = _counted_from_corner(outline), _scalar(node, "wallHeight", 0.1)

    def _add_outline(self, node: Node, frame: Floats) -> None:
        vertices, _ = _mesh(children_of(node)[0].fields["geometry"])
        corners = _placed(vertices, frame)
        m = len(corners) // 2
        self._arena = corners[:m], float(corners[m, 2] - corners[0, 2])

    def world(self) -> World:
        """All solids, on the floor of the arena where there is one."""
        floor = 0.0 if self._arena is None else float(self._arena[0][:, 2].mean())
        down = np.array([0.0, 0.0, -floor])
        solids = [
            each.moved(down) if isinstance(each, Round) else _solid(each[0] + down, each[1])
            for each in self._solids
        ]
        arena = None
        if self._arena is not None:
            arena = Arena(outline=self._arena[0][:, :2], height=self._arena[1])
        return World(solids, arena, left_out=dict(self._left_out))


def _prism(footprint: Floats) -> list[Ints]:
    return list(prism_faces(len(footprint)))


def _counted_from_corner(outline: Floats) -> Floats:
    """Corners counter-clockwise, as seen from above, from that with the least x, then y."""
    a, b, c = outline[:3, :2]
    if (b[0] - a[0]) * (c[1] - a[1]) < (b[1] - a[1]) * (c[0] - a[0]):
        outline = outline[::-1]
    first = np.lexsort((outline[:, 1], outline[:, 0]))[0]
    return np.roll(outline, -first, axis=0)


def _placed(vertices: Floats, frame: Floats) -> Floats:
    return np.einsum("ij,nj->ni", frame[:3, :3], vertices) + frame[:3, 3]


def children_of(node: Node, name: str = "children") -> list[Node]:
    """The nodes in a field of a node."""
    children = node.fields.get(name, [])
    # One child needs no brackets.
    several = children if isinstance(children, list) else [children]
    return [child for child in several if isinstance(child, Node)]


def placement(node: Node, *, is_y_up: bool) -> Floats:
    """Transform of a node's own frame: translation, rotation about an axis, and scale."""
    frame = np.eye(4)
    # The second side of a LegoWall is its height, also in worlds whose z is up.
    is_lying = node.kind == "LegoWall" and not is_y_up
    turn = [1.0, 1.0, 1.0, 2 * np.pi / 3] if is_lying else [0.0, 0.0, 1.0, 0.0]
    x, y, z, angle = _vector(node, "rotation", turn)
    length = np.sqrt(x * x + y * y + z * z)
    if angle != 0.0 and length > 0.0:
        cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]) / length
        frame[:3, :3] += np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross
    if node.kind == "Transform":
        frame[:3, :3] *= _vector(node, "scale", [1.0, 1.0, 1.0])
    place = [0.0, 0.0, 0.0]
    if node.kind in _STANDING:
        place[1 if is_y_up else 2] = _STANDING[node.kind]
    frame[:3, 3] = _vector(node, "translation", place)
    return frame


def _vector(node: Node, name: str, default: list[float]) -> Floats:
    values = node.fields.get(name, default)
    if not isinstance(values, list) or len(values) != len(default):
        raise ValueError(f"{name} of {node.kind} must be {len(default)} numbers")
    return np.array(values, dtype=np.float64)


def _scalar(node: Node, name: str, default: float) -> float:
    return float(_vector(node, name, [default])[0])


def _told(node: Node, name: str) -> float:
    """A field whose default is not the same in all releases, so that it must be there."""
    if name not in node.fields:
        raise ValueError(f"{node.kind} must have its {name}")
    return _scalar(node, name, 0.0)


def _mesh(node: Node) -> tuple[Floats, list[Ints]]:
    """Vertices, each once, and faces of an IndexedFaceSet."""
    coord = node.fields.get("coord")
    points = np.array(coord.fields.get("point", []) if coord else [], dtype=np.float64)
    if not points.size or points.size % 3:
        raise ValueError("point must be three numbers each")
    points = points.reshape(-1, 3)
    faces: list[list[int]] = [[]]
    for index in node.fields.get("coordIndex", []):
        if index < 0:
            faces.append([])
        elif index < len(points):
            faces[-1].append(int(index))
        else:
            raise ValueError(f"coordIndex must be below {len(points)}, not {index:g}")
    turn = -1 if node.fields.get("ccw") is False else 1
    vertices, rows = each_once(points, tuple(np.array(face) for face in faces if face))
    return vertices, [face[::turn] for face in rows]


def _solid(vertices: Floats, faces: list[Ints]) -> Solid:
    """The prism, if it is an upright one, or else the polyhedron."""
    low, high = vertices[:, 2].min(), vertices[:, 2].max()
    near = _LEVEL * float(np.ptp(vertices, axis=0).max())
    is_low, is_high = vertices[:, 2] - low <= near, high - vertices[:, 2] <= near
    tops = [face for face in faces if is_high[face].all()]
    if len(tops) == 1 and (is_low ^ is_high).all() and 2 * len(tops[0]) == len(vertices):
        ring = vertices[tops[0], :2]
        below = vertices[is_low, :2]
        distance = np.abs(ring[:, None] - below).max(axis=2).min(axis=1)
        if (distance <= near).all():
            return Prism(ring, float(high - low), base=float(low))
    return Polyhedron(vertices, tuple(faces))
