"""The choices of a query, and its report."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import InitVar, dataclass, field, replace
from typing import Any, Literal, TypedDict

import numpy as np
from numpy.typing import ArrayLike

from ._attributes import Attribute, FieldWish, HasValues, wishes_of
from ._errors import ArgumentError

Triple = tuple[float, float, float]
Isovalue = float | Literal["auto"]
Inside = Literal["above", "below", "auto"]
Space = Literal["LPS", "RAS", "index"]

#: What a query has in world units, and with ``_voxels`` behind the name in voxel indices and voxels.
IN_SPACE = ("focus", "radius", "box", "clip", "sphere", "simplify")


def _refuse_both(given: Any, names: Sequence[str]) -> None:
    for name in names:
        if getattr(given, name) is not None and getattr(given, f"{name}_voxels") is not None:
            raise ArgumentError(f"{name} is in world units and {name}_voxels in voxels; give one of them")


@dataclass(frozen=True)
class View:
    """From where the surface is seen, (x, y, z) in world units: cells are refined while an edge covers more
    than ``pixels`` of a picture taken from ``eye``.

    Parameters
    ----------
    eye
        where the picture is taken from
    pixels
        that an edge of a cell may cover
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
    """How fine the surface is where; what is given leaves cells coarse together.

    Parameters
    ----------
    focus, radius
        the finest level within the sphere, coarser with the distance from it; (x, y, z) in world units
    level
        the whole surface from this level; not with a focus
    view
        as fine as a picture from there can show
    curvature
        level 1 where the total curvature is at most this, in 1/voxel^2
    focus_voxels, radius_voxels
        focus and radius in voxel indices and voxels of the least spacing, in their place
    """

    focus: Sequence[float] | None = None
    radius: float | None = None
    level: int | None = None
    view: View | None = None
    curvature: float | None = None
    focus_voxels: Sequence[float] | None = None
    radius_voxels: float | None = None

    def __post_init__(self) -> None:
        _refuse_both(self, ("focus", "radius"))
        focus = self.focus if self.focus_voxels is None else self.focus_voxels
        if (focus is None) != (self.radius is None and self.radius_voxels is None):
            raise ArgumentError("focus and radius belong together; give both, or neither")
        if focus is not None and len(focus) != 3:
            raise ArgumentError(f"the focus {focus} is not three numbers, (x, y, z)")


class FinestChoice(TypedDict, total=False):
    """The keywords of ``Query`` that level 0 alone has: what ``isosurface`` takes beside its own."""

    box: Sequence[Sequence[float]] | None
    mask: Any
    clip: ArrayLike | None
    sphere: ArrayLike | None
    cap: bool
    simplify: float | None
    drop_small: bool
    keep_largest: int | None
    drop_below: float | None
    values: HasValues | None
    attributes: Mapping[str, Attribute]
    indices: bool
    inside: Inside
    box_voxels: Sequence[Sequence[float]] | None
    clip_voxels: ArrayLike | None
    sphere_voxels: ArrayLike | None
    simplify_voxels: float | None


class Choice(FinestChoice, total=False):
    """The keywords of ``Query``, which the calls that extract take beside their own."""

    focus: Sequence[float] | None
    radius: float | None
    level: int | None
    view: View | None
    curvature: float | None
    or_finer: Sequence[Detail]
    triangles: int | None
    focus_voxels: Sequence[float] | None
    radius_voxels: float | None


@dataclass(frozen=True)
class Query:
    """Which surface, and how fine. Every call that extracts takes one, or an isovalue with these keywords:
    ``extract(1324, level=1)`` is ``extract(Query(1324, level=1))``, and ``extract(query, level=2)`` changes one.

    Places and lengths are (x, y, z) in world units; those whose names end with ``_voxels`` are in voxel indices,
    (x, y, z) too, and voxels.

    >>> from dataclasses import replace
    >>> bone = Query(1324, focus=(75, 30, 75), radius=20)
    >>> replace(bone, radius=40).radius
    40
    >>> Query(1324, focus=(75, 30, 75))
    Traceback (most recent call last):
    isobrick._errors.ArgumentError: focus and radius belong together; give both, or neither

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
    mask
        only where this is not 0: a pyramid of any grid in the same world, whose nearest voxel counts, or an array
        [z, y, x] of the volume's shape; with a value, ``(mask, 7)``, where it has that; or a list of several
    clip
        only the side of a plane to which its normal points: (nx, ny, nz, d), where n.p >= d, or a point and the
        normal, ((x, y, z), (nx, ny, nz)); or several
    sphere
        only within this sphere, (x, y, z, radius); or several
    cap
        closes the surface where it leaves the volume, mask, clip and sphere (of level 0), or the box, which grows until it cuts no cell: the mesh is
        that of a solid, and ``Mesh.caps`` says which triangles do so. Beside voxels without data it stays open
    simplify
        fewer triangles, within this distance
    triangles
        at most so many, in place of the distance, which is looked for: the surface is extracted some ten times
    drop_small
        leaves out pieces within one brick whose box has a diagonal below that distance
    keep_largest
        only so many connected pieces, those that enclose the most, with their cavities; with a box or another cut those
        of the largest area
    drop_below
        only connected pieces of at least this area, in squares of the world's unit
    values
        another pyramid: its values at the points become ``Mesh.values``
    attributes
        more numbers for the points, by name, for ``Mesh.attributes`` and files: another pyramid, ``Nearest``,
        ``Thickness`` or ``Distance``
    indices
        the old name of ``focus_voxels`` and so on, for all of them at once; it ends with version 0.4
    inside
        where the object is, from which normals look away: values of at least the isovalue ('above'), or those
        below it ('below': dark things, level sets); 'auto': below for a level set of OpenVDB, else above
    focus_voxels, radius_voxels, box_voxels, clip_voxels, sphere_voxels, simplify_voxels
        those without ``_voxels`` in voxel indices and voxels, in their place; lengths are in voxels of the least
        spacing
    """

    isovalue: Isovalue = "auto"
    focus: Sequence[float] | None = None
    radius: float | None = None
    level: int | None = None
    view: View | None = None
    curvature: float | None = None
    or_finer: Sequence[Detail] = ()
    box: Sequence[Sequence[float]] | None = None
    mask: Any = None
    clip: ArrayLike | None = None
    sphere: ArrayLike | None = None
    cap: bool = False
    simplify: float | None = None
    triangles: int | None = None
    drop_small: bool = False
    keep_largest: int | None = None
    drop_below: float | None = None
    values: HasValues | None = None
    attributes: Mapping[str, Attribute] = field(default_factory=dict, hash=False)
    indices: InitVar[bool] = False
    inside: Inside = "above"
    focus_voxels: Sequence[float] | None = None
    radius_voxels: float | None = None
    box_voxels: Sequence[Sequence[float]] | None = None
    clip_voxels: ArrayLike | None = None
    sphere_voxels: ArrayLike | None = None
    simplify_voxels: float | None = None

    def __post_init__(self, indices: bool) -> None:
        if indices:
            self._take_for_voxels()
        _refuse_both(self, IN_SPACE)
        self._detail()
        if self.inside not in ("above", "below", "auto"):
            raise ArgumentError(f"inside is {self.inside!r}; give 'above', 'below' or 'auto'")
        has_distance = self.simplify is not None or self.simplify_voxels is not None
        if has_distance and self.triangles is not None:
            raise ArgumentError("simplify is a distance, and triangles looks for one; give one of them")
        if self.drop_small and not has_distance and self.triangles is None:
            raise ArgumentError("drop_small goes with simplify, the distance below which a piece is small; give both")
        for name in ("triangles", "keep_largest"):
            number = getattr(self, name)
            if number is not None and number < 1:
                raise ArgumentError(f"{name}={number} is not above 0")

    def _detail(self) -> Detail:
        return Detail(
            self.focus, self.radius, self.level, self.view, self.curvature, self.focus_voxels, self.radius_voxels
        )

    def _take_for_voxels(self) -> None:
        warnings.warn(
            "indices=True is focus_voxels=, radius_voxels=, box_voxels=, clip_voxels=, sphere_voxels= and "
            "simplify_voxels= now; the old name ends with version 0.4", FutureWarning, stacklevel=5,
        )  # fmt: skip
        for name in IN_SPACE:
            if getattr(self, name) is not None:
                object.__setattr__(self, f"{name}_voxels", getattr(self, name))
                object.__setattr__(self, name, None)
        finer = [
            one
            if one.focus is None
            else replace(one, focus=None, radius=None, focus_voxels=one.focus, radius_voxels=one.radius)
            for one in self.or_finer
        ]
        object.__setattr__(self, "or_finer", tuple(finer))


def query_of(isovalue: Isovalue | Query, choice: Choice) -> Query:
    """What a call was given, as one: a place in voxels takes that of the world's place, and the other way round."""
    if not isinstance(isovalue, Query):
        return Query(isovalue, **choice)
    changes: dict[str, Any] = dict(choice)
    for name in IN_SPACE:
        for given, other in ((name, f"{name}_voxels"), (f"{name}_voxels", name)):
            if given in choice:
                changes.setdefault(other, None)
    return replace(isovalue, **changes)


@dataclass
class _Region:
    """What the library reads: masks are pyramids, or arrays of bytes that are not 0 inside."""

    masks: list[tuple[Any, float | None]]
    planes: list[list[float]]
    planes_voxels: list[list[float]]
    spheres: list[list[float]]
    spheres_voxels: list[list[float]]


def _mask_of(given: Any) -> tuple[Any, float | None]:
    mask, value = given if isinstance(given, tuple) else (given, None)
    if hasattr(mask, "_handle"):
        return mask._handle, None if value is None else float(value)
    array = np.asarray(mask)
    if array.ndim != 3:
        raise ArgumentError("a mask is a pyramid or an array [z, y, x], or (mask, value)")
    inside = array != 0 if value is None else array == value  # exact for numbers of any type
    return np.ascontiguousarray(inside).view(np.uint8), None


def _rows_of(what: str, given: ArrayLike | None, counts: tuple[int, ...]) -> list[list[float]]:
    """One row of so many numbers, or several."""
    if given is None:
        return []
    rows = np.asarray(given, dtype=np.float64)
    if rows.ndim > 1 and rows.shape[-2:] == (2, 3):
        rows = rows.reshape(*rows.shape[:-2], 6)
    rows = np.atleast_2d(rows)
    if rows.ndim != 2 or rows.shape[1] not in counts:
        raise ArgumentError(f"{what}={given!r} is not {' or '.join(map(str, counts))} numbers, or several of these")
    listed: list[list[float]] = rows.tolist()
    return listed


def _planes_of(what: str, given: ArrayLike | None) -> list[list[float]]:
    def plane_of(row: list[float]) -> list[float]:
        if len(row) == 4:
            return row
        normal = row[3:]
        return [*normal, sum(p * n for p, n in zip(row[:3], normal, strict=True))]

    return [plane_of(row) for row in _rows_of(what, given, (4, 6))]


def _region_of(query: Query) -> _Region:
    masks = [] if query.mask is None else query.mask if isinstance(query.mask, list) else [query.mask]
    return _Region(
        [_mask_of(mask) for mask in masks],
        _planes_of("clip", query.clip),
        _planes_of("clip_voxels", query.clip_voxels),
        _rows_of("sphere", query.sphere, (4,)),
        _rows_of("sphere_voxels", query.sphere_voxels, (4,)),
    )


def _box_of(given: Sequence[Sequence[float]] | None) -> tuple[Triple, Triple] | None:
    if given is None:
        return None
    (ax, ay, az), (bx, by, bz) = given
    return (float(ax), float(ay), float(az)), (float(bx), float(by), float(bz))


@dataclass
class _QuerySettings:
    """What the library reads."""

    isovalue: float
    detail: Detail
    or_finer: Sequence[Detail]
    box: tuple[Triple, Triple] | None
    box_voxels: tuple[Triple, Triple] | None
    region: _Region
    cap: bool
    simplify: float | None
    simplify_voxels: float | None
    triangles: int | None
    drop_small: bool
    keep_largest: int | None
    drop_below: float | None
    attributes: list[FieldWish]
    threads: int
    progress: Any
    cancel: Any
    part: tuple[int, int] | None
    is_below: bool


def settings_of(
    query: Query, isovalue: float, threads: int, progress: Any, cancel: Any, part: tuple[int, int] | None = None
) -> _QuerySettings:
    """Of a query and what is not its own; ``isovalue`` in place of its own, which may be 'auto'."""
    return _QuerySettings(
        isovalue, query._detail(), query.or_finer, _box_of(query.box), _box_of(query.box_voxels), _region_of(query),
        query.cap, query.simplify, query.simplify_voxels, query.triangles, query.drop_small, query.keep_largest, query.drop_below,
        wishes_of(query.values, query.attributes), threads, progress, cancel, part,
        query.inside == "below",
    )  # fmt: skip


def placement_of(space: Space, unit: str | None, shift: Sequence[float]) -> tuple[str, str, Triple]:
    """Where a mesh lies, as the library takes it."""
    if space not in ("LPS", "RAS", "index"):
        raise ArgumentError(f"the space is {space!r}; give 'LPS', 'RAS' or 'index'")
    x, y, z = shift
    return space, unit or "", (float(x), float(y), float(z))


@dataclass(frozen=True)
class LevelCounts:
    """The result of an extraction for one level."""

    level: int
    cells: int
    triangles: int
    transition_cells: int
    #: Those of its triangles that are caps (``Query.cap``).
    cap_triangles: int = 0


@dataclass(frozen=True)
class ExtractReport:
    """The result of an extraction."""

    #: False: coarser than asked for, since the query took what was in memory.
    is_complete: bool
    triangles: int
    #: None if only some pieces were kept: cells are not counted for each.
    levels: list[LevelCounts] | None
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


@dataclass(frozen=True)
class Component:
    """A connected piece of a surface, in world units."""

    triangles: int
    area: float
    #: Enclosed, below 0 for the wall of a hollow; None if the piece has a border.
    volume: float | None
    #: The same with the border of the volume as a wall; None if a box or another cut leaves it open.
    enclosed: float | None
    #: Corners of the least box around it, (x, y, z).
    lower: Triple
    upper: Triple
    #: Centre of gravity of the surface.
    center: Triple


def make_report(facts: dict[str, Any]) -> ExtractReport:
    """The report of what the library says."""
    levels = facts.pop("levels")
    return ExtractReport(levels=levels and [LevelCounts(*counts) for counts in levels], **facts)
