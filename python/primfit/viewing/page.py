"""Layers as a scene of trimesh, and as a page that shows it; trimesh is in the extra ``files``."""

from __future__ import annotations

import json
from importlib.resources import files
from typing import TYPE_CHECKING, Any

import numpy as np

from primfit.viewing.layers import Layer

if TYPE_CHECKING:
    from trimesh import Scene

_PITCH, _YAW = np.radians(55.0), np.radians(25.0)
"""The first look: from above at a slant, and not along the walls."""


_MARGIN = 1.15
"""How much farther the camera is than where all just fits in."""


def scene_of(layers: list[Layer]) -> Scene:
    """The scene of trimesh that the layers make."""
    try:
        import trimesh
    except ModuleNotFoundError:
        raise ModuleNotFoundError(
            "scenes in space need trimesh: install it with pip install 'primfit[files]'"
        ) from None
    corners = [layer.corners.reshape(-1, 3) for layer in layers if layer.group != "beams"]
    everything = np.concatenate(corners) if corners else np.zeros((0, 3))
    if not len(everything):
        everything = np.zeros((1, 3))
    # A few points far from all others should not make all others small.
    low, high = np.quantile(everything, [0.01, 0.99], axis=0)
    middle = (low + high) / 2
    # Pages hold single precision: seven digits.
    is_far = np.abs(middle).max() > 100.0 * max((high - low).max(), 1e-9)
    offset = np.round(middle) if is_far else np.zeros(3)
    scene = trimesh.Scene(metadata={"offset": offset.tolist()})
    for layer in layers:
        geometry = _geometry(trimesh, layer, offset)
        scene.add_geometry(geometry, node_name=layer.name, geom_name=layer.name)
    turn = trimesh.transformations.euler_matrix(_PITCH, 0.0, _YAW, "sxyz")
    box = np.array([low, high]) - offset
    around = np.array([[x, y, z] for x in box[:, 0] for y in box[:, 1] for z in box[:, 2]])
    if not np.ptp(around, axis=0).any():
        around = around + 0.5 * np.sign(np.arange(8)[:, None] - 3.5)
    camera = trimesh.scene.Camera(resolution=(1200, 800), fov=(60.0, 42.0), z_near=1e-3)
    camera.z_far = 1e3 * float(np.linalg.norm(np.ptp(around, axis=0)))
    camera.z_near = 1e-6 * camera.z_far
    scene.camera = camera
    scene.camera_transform = camera.look_at(
        around, rotation=turn, center=around.mean(axis=0), pad=_MARGIN
    )
    return scene


def _geometry(trimesh: Any, layer: Layer, offset: Any) -> Any:
    n = len(layer.corners)
    corners = layer.corners - offset
    colors = np.broadcast_to(np.append(np.zeros(3, np.uint8), np.uint8(255)), (n, 4)).copy()
    colors[:, :3] = layer.color
    if layer.shape == "points":
        return trimesh.PointCloud(corners, colors=colors)
    if layer.shape == "lines":
        path = trimesh.load_path(corners)
        path.colors = np.broadcast_to(colors[0], (len(path.entities), 4))
        return path
    mesh = trimesh.Trimesh(corners.reshape(-1, 3), np.arange(3 * n).reshape(-1, 3), process=False)
    mesh.visual.face_colors = colors
    return mesh


def page_of(layers: list[Layer], title: str) -> str:
    """A page (HTML) that shows the layers, by the viewer of trimesh and `switches.js`."""
    scene = scene_of(layers)
    from trimesh.viewer.notebook import scene_to_html

    told = {
        layer.name: {"group": layer.group, "text": layer.text, "label": layer.label}
        for layer in layers
    }
    script = (files("primfit.viewing") / "switches.js").read_text(encoding="utf-8")
    content = json.dumps({"title": title, "parts": told}).replace("</", "<\\/")
    page: str = scene_to_html(scene)
    addition = f"<script>const VIEW = {content};\n{script}</script>"
    before, end, after = page.rpartition("</body>")
    return before + addition + end + after
