"""What can be looked at in space; the scene is made when someone asks for it."""

from __future__ import annotations

import sys
import tempfile
import webbrowser
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from primfit._files import as_path, replacing

if TYPE_CHECKING:
    from trimesh import Scene


class Shown:
    """What can be looked at in space: `to_scene` and `show`."""

    def to_scene(self, **options: Any) -> Scene:
        """The scene in space, for `trimesh`, which also writes it (.glb, .obj ...).

        Parameters
        ----------
        **options
            Of a detection `world`, the truth; of planes `points`, of which they are.

        Returns
        -------
        trimesh.Scene
            In metres, its camera looking at it at a slant. Each part has a name, such as "plane-3"
            or "solid-0"; what is far from the origin is moved there, by `metadata["offset"]`.

        Raises
        ------
        ModuleNotFoundError
            When the extra ``files`` is not installed.
        """
        from primfit.viewing.layers import layers_of
        from primfit.viewing.page import scene_of

        return scene_of(list(layers_of(self, **options)))

    def show(self, file: str | PathLike[str] | None = None, **options: Any) -> Any:
        """Show it in space: inline in a notebook, else in the browser.

        The mouse turns, shifts and zooms; points, planes, noise, solids, truth and beams can be
        switched; where the mouse is, what is there is told. Of many points, 200,000 are shown, and
        of many beams 2000.

        Parameters
        ----------
        file : path or None
            A page to write instead (.html), which needs no network.
        **options
            As of `to_scene`.

        Returns
        -------
        IPython.display.HTML, pathlib.Path or None
            What a notebook shows; the page, where one was asked for.
        """
        from primfit.viewing.layers import layers_of
        from primfit.viewing.page import page_of

        page = page_of(list(layers_of(self, **options)), repr(self))
        if file is not None:
            path = as_path(file)
            if path.suffix.lower() not in (".html", ".htm"):
                raise ValueError(f"file must end in .html, not {path.name!r}")
            with replacing(path) as part:
                part.write_text(page, encoding="utf-8")
            return path
        if _in_notebook():
            from IPython.display import HTML

            inner = page.replace("&", "&amp;").replace('"', "&quot;")
            return HTML(
                f'<div><iframe srcdoc="{inner}" width="100%" height="520" '
                f'style="border: none"></iframe></div>'
            )
        folder = Path(tempfile.mkdtemp(prefix="primfit-"))
        (folder / "view.html").write_text(page, encoding="utf-8")
        webbrowser.open((folder / "view.html").as_uri())
        return None


def _in_notebook() -> bool:
    """Whether a kernel of Jupyter runs the code; nothing is imported to find out."""
    ipython = sys.modules.get("IPython")
    shell = ipython.get_ipython() if ipython else None
    return shell is not None and hasattr(shell, "kernel")
