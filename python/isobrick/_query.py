"""The choices of a query, and its report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal, TypedDict

from ._attributes import Attribute, FieldWish, HasValues, wishes_of
from ._errors import Error

Triple = tuple[float, float, float]
Isovalue = float | Literal["auto"]


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


class Choice(TypedDict, total=False):
    """The keywords of ``Query``, which the calls that extract take beside their own."""

    focus: Sequence[float] | None
    radius: float | None
    level: int | None
    view: View | None
    curvature: float | None
    or_finer: Sequence[Detail]
    box: Sequence[Sequence[float]] | None
    simplify: float | None
    drop_small: bool
    values: HasValues | None
    attributes: Mapping[str, Attribute]
    indices: bool


@dataclass(frozen=True)
class Query:
    """Which surface, and how fine. Every call that extracts takes one, or an isovalue with these keywords:
    ``extract(1324, level=1)`` is ``extract(Query(1324, level=1))``, and ``extract(query, level=2)`` changes one.

    focus, radius and box are (x, y, z) in world units, or voxel indices (x, y, z) with ``indices=True``; so is the
    distance of ``simplify``.

    Parameters
    ----------
    isovalue
        values of at least this are inside; 'auto': the first of ``Pyramid.isovalues()``
    focus, radius
        the finest level within the sphere, coarser with the distance from it
    level
        the whole surface from this level; not with a focus
    view
        as fine as a picture from there can show
    curvature
        level 1 where the total curvature is at most this, in 1/voxel^2
    or_finer
        more of these, each a ``Detail``: a cell is refined if any one of them wants it
    box
        ((x, y, z), (x, y, z)): only cells that overlap it
    simplify
        fewer triangles, within this distance
    drop_small
        leaves out pieces within one brick whose box has a diagonal below that distance
    values
        another pyramid: its values at the points become ``Mesh.values``
    attributes
        more numbers for the points, by name, for ``Mesh.attributes`` and files: another pyramid, ``Nearest``,
        ``Thickness`` or ``Distance``
    indices
        focus, radius, box and simplify are in voxel indices and voxels
    """

    isovalue: Isovalue = "auto"
    focus: Sequence[float] | None = None
    radius: float | None = None
    level: int | None = None
    view: View | None = None
    curvature: float | None = None
    or_finer: Sequence[Detail] = ()
    box: Sequence[Sequence[float]] | None = None
    simplify: float | None = None
    drop_small: bool = False
    values: HasValues | None = None
    attributes: Mapping[str, Attribute] = field(default_factory=dict, hash=False)
    indices: bool = False

    def __post_init__(self) -> None:
        self._detail()
        if self.drop_small and self.simplify is None:
            raise Error("drop_small goes with simplify, the distance below which a piece is small; give both")

    def _detail(self) -> Detail:
        return Detail(self.focus, self.radius, self.level, self.view, self.curvature)


def query_of(isovalue: Isovalue | Query, choice: Choice) -> Query:
    """What a call was given, as one."""
    return replace(isovalue, **choice) if isinstance(isovalue, Query) else Query(isovalue, **choice)


@dataclass
class _QuerySettings:
    """What the library reads."""

    isovalue: float
    detail: Detail
    indices: bool
    or_finer: Sequence[Detail]
    box: tuple[Triple, Triple] | None
    simplify: float | None
    drop_small: bool
    attributes: list[FieldWish]
    threads: int
    progress: Any
    cancel: Any
    part: tuple[int, int] | None


def settings_of(
    query: Query, isovalue: float, threads: int, progress: Any, cancel: Any, part: tuple[int, int] | None = None
) -> _QuerySettings:
    """Of a query and what is not its own; ``isovalue`` in place of its own, which may be 'auto'."""
    box = None
    if query.box is not None:
        (ax, ay, az), (bx, by, bz) = query.box
        box = (float(ax), float(ay), float(az)), (float(bx), float(by), float(bz))
    return _QuerySettings(
        isovalue, query._detail(), query.indices, query.or_finer, box, query.simplify, query.drop_small,
        wishes_of(query.values, query.attributes), threads, progress, cancel, part,
    )  # fmt: skip


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


@dataclass(frozen=True)
class MeshQuality:
    """What a mesh is like, for a printer or a simulation. Areas and volumes in world units."""

    #: Closed, manifold, oriented, no triangle without area and none that crosses another one of its brick.
    is_solid: bool
    vertices: int
    edges: int
    triangles: int
    #: In one triangle.
    open_edges: int
    #: Connected pieces of the open edges.
    boundary_loops: int
    #: In more than two triangles.
    nonmanifold_edges: int
    #: In two triangles, the same way round in both.
    misoriented_edges: int
    zero_area_triangles: int
    crossing_triangles: int
    #: vertices - edges + triangles
    euler_number: int
    area: float
    #: Enclosed; None if the mesh is open.
    volume: float | None
    #: In degrees.
    least_angle: float
    #: Longest side times perimeter over 4 sqrt(3) areas: 1 for equal sides.
    mean_aspect: float
    worst_aspect: float


def make_report(facts: dict[str, Any]) -> ExtractReport:
    """The report of what the library says."""
    levels = [LevelCounts(*counts) for counts in facts.pop("levels")]
    return ExtractReport(levels=levels, **facts)
