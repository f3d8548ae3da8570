"""The exceptions of isobrick."""

from __future__ import annotations


class Error(Exception):
    """A call that failed, with one line that says what went wrong, where, and what to do.

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


class Cancelled(Error):
    """A call that ended because ``Cancel.request()`` was called. Nothing was left behind."""
