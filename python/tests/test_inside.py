"""The side of the object, and where meshes lie."""

from __future__ import annotations

import filecmp
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import isobrick
from conftest import ball


def test_below_is_above_turned_round(tmp_path: Path) -> None:
    volume = ball(40)
    for inside, sign in (("above", 1), ("below", -1), ("auto", 1)):
        mesh = isobrick.isosurface(volume, 0.0, inside=inside)
        assert sign * mesh.volume() == pytest.approx(4 / 3 * np.pi * (40 / 3) ** 3, rel=0.01)
    isobrick.build(volume, tmp_path / "ball.isb", brick_cells=16)
    with isobrick.open(tmp_path / "ball.isb") as pyramid:
        above, below = pyramid.extract(0), pyramid.extract(isobrick.Query(0, inside="below"))
        np.testing.assert_array_equal(below.points, above.points)
        np.testing.assert_array_equal(below.normals, -above.normals)
        np.testing.assert_array_equal(below.faces[:, [0, 2, 1]], above.faces)
        below.save(tmp_path / "saved.obj")
        pyramid.extract_to(tmp_path / "streamed.obj", 0, inside="below")
        assert filecmp.cmp(tmp_path / "saved.obj", tmp_path / "streamed.obj", shallow=False)
        with pytest.raises(isobrick.Error, match="'above', 'below' or 'auto'"):
            pyramid.extract(0, inside="left")  # type: ignore[arg-type]


def test_a_dark_hole_encloses_its_volume() -> None:
    dark = 100 - ball(40)
    mesh = isobrick.isosurface(dark, 100.0, inside="below", spacing=(0.5, 0.5, 0.5))
    assert mesh.volume() == pytest.approx(4 / 3 * np.pi * (20 / 3) ** 3, rel=0.01)
    outward = mesh.points - mesh.points.mean(axis=0)
    assert np.einsum("ij,ij->i", outward, mesh.normals).min() > 0


def test_a_mesh_lies_where_it_is_wanted(tmp_path: Path, command: Callable[..., str]) -> None:
    turn = np.array([[0, -1, 0], [1, 0, 0], [0, 0, -1.0]])
    path = tmp_path / "ball.isb"
    isobrick.build(ball(30), path, direction=turn, spacing=(0.5, 0.7, 1.1), origin=(3, -4, 50))
    with isobrick.open(path) as pyramid:
        mesh = pyramid.extract(0)
        cases: list[tuple[str, list[str], dict[str, Any]]] = [
            ("ras", ["--space", "RAS", "--shift", "1,2,3"], {"space": "RAS", "shift": (1, 2, 3)}),
            ("index", ["--space", "index"], {"space": "index"}),
        ]
        for name, words, choice in cases:
            for ending in ("ply", "stl", "obj", "glb", "vtp", "3mf"):
                files = [tmp_path / f"{name}-{way}.{ending}" for way in ("saved", "streamed", "command")]
                mesh.save(files[0], **choice)
                pyramid.extract_to(files[1], 0, **choice)
                command("extract", path, "--iso", 0, *words, "-o", files[2])
                assert len({file.read_bytes() for file in files}) == 1, ending
        for number in (1, 2):
            pyramid.extract_to(tmp_path / f"{number}.isbm", 0, part=(number, 2))
        shares = [tmp_path / "2.isbm", tmp_path / "1.isbm"]
        isobrick.merge(shares, tmp_path / "merged.ply", space="RAS", shift=(1, 2, 3))
        assert (tmp_path / "merged.ply").read_bytes() == (tmp_path / "ras-saved.ply").read_bytes()
        with pytest.raises(isobrick.Error, match="unit of the volume is unknown"):
            mesh.save(tmp_path / "mm.ply", unit="mm")
        with pytest.raises(isobrick.Error, match="the space is"):
            mesh.save(tmp_path / "mm.ply", space="left")  # type: ignore[arg-type]
        with pytest.raises(isobrick.Error, match="is a share"):
            pyramid.extract_to(tmp_path / "3.isbm", 0, part=(1, 2), space="RAS")
