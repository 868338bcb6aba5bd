"""LiDAR scans to solid geometry."""

from typing import Any
from warnings import warn

import lazy_loader

# What is public, and where it is, stands in __init__.pyi; it is imported when it is first used.
_public, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


_RENAMED = {"FoundPolyhedron": "FoundSolid"}


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version("primfit")
    if name in _RENAMED:
        warn(
            f"primfit.{name} is now primfit.{_RENAMED[name]}, and goes with the next release",
            DeprecationWarning,
            stacklevel=2,
        )
        return _public(_RENAMED[name])
    if name not in __all__ and not name.startswith("__"):
        from importlib import import_module
        from importlib.util import find_spec

        if find_spec(f"{__name__}.{name}"):
            return import_module(f"{__name__}.{name}")
    return _public(name)
