"""Files that are written whole or not at all."""

from __future__ import annotations

import os
import secrets
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from os import PathLike
from pathlib import Path

_LONGEST = 200
"""Most bytes of the name that the name of a temporary file takes over; file systems allow 255."""


@contextmanager
def replacing(file: str | PathLike[str]) -> Iterator[Path]:
    """A temporary file in the same folder, which takes the place of `file` when all went well.

    An error, a full disk or a kill leaves what was there before. The temporary file has the suffix
    of the file, which libraries look at.

    Parameters
    ----------
    file : path
        What is no plain file, such as a pipe, is written to as it is.

    Raises
    ------
    OSError
        When the folder does not exist, or cannot be written to.
    TypeError
        When `file` is no path.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from primfit._files import replacing
    >>> file = Path(tempfile.mkdtemp()) / "text.txt"
    >>> with replacing(file) as part:
    ...     _ = part.write_text("all of it")
    >>> file.read_text()
    'all of it'
    """
    path = as_path(file)
    check_folder(path)
    target = Path(os.path.realpath(path))
    if target.is_dir():
        raise IsADirectoryError(f"{target} is a folder, not a file to write to")
    if target.exists() and not target.is_file():
        yield target
        return
    name = os.fsdecode(os.fsencode(target.name)[-_LONGEST:])
    part = target.with_name(f".{secrets.token_hex(8)}.{name}")
    try:
        os.close(os.open(part, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
        yield part
        with suppress(OSError):
            os.chmod(part, stat.S_IMODE(target.stat().st_mode))
        os.replace(part, target)
    finally:
        with suppress(OSError):
            part.unlink()


def as_path(file: str | PathLike[str]) -> Path:
    """The argument `file` as a path.

    Raises
    ------
    TypeError, ValueError
        When it is none, such as the number of an open file.
    """
    if not isinstance(file, str | PathLike):
        raise TypeError(f"file must be a path, not {type(file).__name__}")
    path = Path(file)
    if "\0" in str(path):
        raise ValueError(f"file must be a path, which has no zero character, not {file!r}")
    return path


def check_folder(path: Path) -> None:
    """Refuse a file whose folder does not exist, before the work that fills it."""
    if not path.parent.is_dir():
        raise FileNotFoundError(f"there is no folder {path.parent} to write {path.name} to")
