"""The exceptions of isobrick."""

from __future__ import annotations

import errno
import os
from typing import Any


class Error(Exception):
    """A call that failed, with one line that says what went wrong, where, and what to do. Those that Python has a
    class for are of that class, too: ``FileNotFoundError``, ``FileExistsError``, ``IndexError``, ``ValueError``.

    ``path``, ``offset`` (a byte of the file), ``level`` and ``brick`` say the same to a program; each is
    None where it is not known. ``brick`` is (x, y, z) among the bricks of its level.
    """

    def __init__(
        self,
        message: str,
        path: str | None = None,
        offset: int | None = None,
        level: int | None = None,
        brick: tuple[int, int, int] | None = None,
    ) -> None:
        super().__init__(message)
        self.path = path
        self.offset = offset
        self.level = level
        self.brick = brick

    def __reduce__(self) -> tuple[type[Error], tuple[object, ...]]:
        return type(self), (str(self), self.path, self.offset, self.level, self.brick)


class NotFoundError(Error, FileNotFoundError):
    """A file or folder that is not there."""


class ExistsError(Error, FileExistsError):
    """A file of that name is there, and ``force`` was not given."""


class RangeError(Error, IndexError):
    """A number beyond those that there are, such as a level."""


class ArgumentError(Error, ValueError):
    """An argument that cannot be used, or does not go with another one."""


def error_of(message: str, path: str | None = None, *place: Any) -> Error:
    """Of what the library or the command says, the class that fits."""
    kind = Error
    if os.strerror(errno.ENOENT) in message:
        kind = NotFoundError
    elif "' exists; " in message or "' exists already; " in message:
        kind = ExistsError
    return kind(message, path, *place)


class Cancelled(Error):
    """A call that ended because ``Cancel.request()`` was called. Nothing was left behind."""
