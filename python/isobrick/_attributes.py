"""Numbers for the vertices of a mesh, and their colours."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, Protocol

from . import _core


class HasValues(Protocol):
    """A ``Pyramid``, as far as a query knows it."""

    @property
    def _handle(self) -> _core.PyramidHandle: ...


@dataclass(frozen=True)
class Nearest:
    """The voxel of another pyramid that is nearest to each vertex: labels, whole numbers as they are. A vertex
    outside of it has 0, or NaN where the pyramid's numbers are not whole."""

    pyramid: HasValues


@dataclass(frozen=True)
class Thickness:
    """The length of a ray inward from each vertex until it leaves the inside of the surface, in world units.

    Parameters
    ----------
    most
        rays end after so many world units: thicker walls have that thickness
    """

    most: float | None = None


@dataclass(frozen=True)
class Distance:
    """The distance of each vertex from another surface, in world units; below 0 inside of a closed one.

    Parameters
    ----------
    of
        a mesh file, ``.ply`` or ``.stl``, or an isovalue of the same pyramid
    """

    of: str | os.PathLike[str] | float


#: A pyramid stands for its values, interpolated trilinearly.
Attribute = HasValues | Nearest | Thickness | Distance


@dataclass(frozen=True)
class Colors:
    """Colours for the vertices of ``.ply``, ``.glb`` and ``.obj`` by one of the attributes.

    Parameters
    ----------
    attribute
        its name
    map
        for values from ``low`` to ``high``; None: each whole number has a colour of its own
    low, high
        the values of the map's first and last colours
    """

    attribute: str
    map: Literal["viridis", "cividis", "inferno", "cool_warm", "grey"] | None = None
    low: float = 0.0
    high: float = 1.0


@dataclass(frozen=True)
class FieldWish:
    """What the library reads of an attribute."""

    name: str
    kind: str
    handle: Any = None
    number: float | None = None
    path: str = ""


def wishes_of(values: HasValues | None, attributes: Mapping[str, Attribute]) -> list[FieldWish]:
    """``values`` is the attribute of that name."""
    wishes = [] if values is None else [FieldWish("value", "value", values._handle)]
    for name, attribute in attributes.items():
        match attribute:
            case Nearest(pyramid):
                wishes.append(FieldWish(name, "nearest", pyramid._handle))
            case Thickness(most):
                wishes.append(FieldWish(name, "thickness", number=most))
            case Distance(of):
                if isinstance(of, str | os.PathLike):
                    wishes.append(FieldWish(name, "distance", path=os.fspath(of)))
                else:
                    wishes.append(FieldWish(name, "distance", number=float(of)))
            case _:
                wishes.append(FieldWish(name, "value", attribute._handle))
    return wishes
