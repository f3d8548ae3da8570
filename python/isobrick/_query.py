"""The choices of a query, and its report."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from ._errors import Error

Triple = tuple[float, float, float]


@dataclass(frozen=True)
class View:
    """From where the surface is seen, (x, y, z) in world units: cells are refined while an edge covers more
    than ``pixels`` of a picture taken from ``eye``.

    Parameters
    ----------
    pixels_per_radian
        of a perspective picture: its height in pixels over its field of view in radians
    pixels_per_unit
        of a parallel projection, in its place: pixels per world unit
    look_at
        a point in the middle of the picture; the surface is coarser outside of the field
    field_of_view
        from corner to corner, in degrees
    field_radius
        half of that for a parallel projection, in world units
    """

    eye: Sequence[float]
    look_at: Sequence[float] | None = None
    pixels: float = 1.0
    pixels_per_radian: float = 1000.0
    pixels_per_unit: float | None = None
    field_of_view: float = 90.0
    field_radius: float | None = None


@dataclass(frozen=True)
class Detail:
    """How fine the surface is where; what is given leaves cells coarse together. (x, y, z) in world units, or
    voxel indices if the query says ``indices=True``.

    Parameters
    ----------
    focus, radius
        the finest level within the sphere, coarser with the distance from it
    level
        the whole surface from this level; not with a focus
    view
        as fine as a picture from there can show
    curvature
        level 1 where the total curvature is at most this, in 1/voxel^2
    """

    focus: Sequence[float] | None = None
    radius: float | None = None
    level: int | None = None
    view: View | None = None
    curvature: float | None = None

    def __post_init__(self) -> None:
        if (self.focus is None) != (self.radius is None):
            raise Error("focus and radius belong together; give both, or neither")
        if self.focus is not None and len(self.focus) != 3:
            raise Error(f"the focus {self.focus} is not three numbers, (x, y, z)")


@dataclass
class _QuerySettings:
    isovalue: float
    detail: Detail
    indices: bool = False
    or_finer: Sequence[Detail] = ()
    box: tuple[Triple, Triple] | None = None
    simplify: float | None = None
    drop_small: bool = False
    values: Any = None
    threads: int = 0
    progress: Any = None
    cancel: Any = None
    part: tuple[int, int] | None = None


def corners_of(box: Sequence[Sequence[float]] | None) -> tuple[Triple, Triple] | None:
    """The corners of a box, as a query has them."""
    if box is None:
        return None
    (ax, ay, az), (bx, by, bz) = box
    return (float(ax), float(ay), float(az)), (float(bx), float(by), float(bz))


def check_simplify(simplify: float | None, drop_small: bool) -> None:
    """Raises Error for what goes only together."""
    if drop_small and simplify is None:
        raise Error("drop_small goes with simplify, the distance below which a piece is small; give both")


@dataclass(frozen=True)
class LevelCounts:
    """The result of an extraction for one level."""

    level: int
    cells: int
    triangles: int
    transition_cells: int


@dataclass(frozen=True)
class ExtractReport:
    """The result of an extraction."""

    #: False: coarser than asked for, since the query took what was in memory.
    is_complete: bool
    triangles: int
    levels: list[LevelCounts]
    bricks_active: int
    bricks_read: int
    bytes_active: int
    bytes_read: int
    #: For a mesh that was written to a file.
    vertices: int | None = field(default=None)


def make_report(facts: dict[str, Any]) -> ExtractReport:
    """The report of what the library says."""
    levels = [LevelCounts(*counts) for counts in facts.pop("levels")]
    return ExtractReport(levels=levels, **facts)
