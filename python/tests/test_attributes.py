"""Numbers and colours of vertices: exact from the volume to the file, as other readers have them."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import vtk
from vtkmodules.util.numpy_support import vtk_to_numpy

import isobrick
from conftest import ball


def labels(n: int) -> Any:
    """Ids of 16 bits that no float rounding would leave as they are if they were mixed."""
    z, y, x = np.mgrid[:n, :n, :n]
    return (1000 + 13 * (x // 5) + 1009 * (y // 5) + 7 * (z // 5)).astype(np.uint16)


@pytest.fixture
def volumes(tmp_path: Path) -> tuple[isobrick.Pyramid, isobrick.Pyramid, Any]:
    """A ball, labels on the same grid, and these as an array."""
    spacing = (0.5, 0.75, 1.25)
    isobrick.build(ball(40), tmp_path / "ball.isb", spacing=spacing, brick_cells=16)
    isobrick.build(labels(40), tmp_path / "labels.isb", spacing=spacing, brick_cells=16)
    return isobrick.Pyramid(tmp_path / "ball.isb"), isobrick.Pyramid(tmp_path / "labels.isb"), labels(40)


def nearest(array: Any, mesh: isobrick.Mesh) -> Any:
    x, y, z = np.floor(mesh.index_points + 0.5).astype(int).T
    return array[z, y, x]


def vtk_points(path: Path) -> Any:
    reader = vtk.vtkXMLPolyDataReader() if path.suffix == ".vtp" else vtk.vtkPLYReader()
    reader.SetFileName(str(path))
    reader.Update()
    return reader.GetOutput().GetPointData()


def ply_vertices(path: Path) -> Any:
    """All properties of the vertices, of any reader's own."""
    header, _, body = path.read_bytes().partition(b"end_header\n")
    kinds = {"float": "<f4", "double": "<f8", "int": "<i4", "uint": "<u4", "uchar": "u1"}
    fields, count = [], 0
    for line in header.decode().splitlines():
        words = line.split()
        if words[:2] == ["element", "vertex"]:
            count = int(words[2])
        elif words[0] == "element":
            break
        elif words[0] == "property":
            fields.append((words[2], kinds[words[1]]))
    return np.frombuffer(body, np.dtype(fields), count)


def glb_attributes(path: Path) -> dict[str, Any]:
    data = path.read_bytes()
    length = struct.unpack_from("<I", data, 12)[0]
    document, body = json.loads(data[20 : 20 + length]), data[28 + length :]
    result = {}
    for name, number in document["meshes"][0]["primitives"][0]["attributes"].items():
        accessor = document["accessors"][number]
        kind = np.dtype({5126: "<f4", 5123: "<u2"}[accessor["componentType"]])
        width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[accessor["type"]]
        view = document["bufferViews"][accessor["bufferView"]]
        rows = np.ndarray(
            (accessor["count"], width), kind, body, view["byteOffset"] + accessor["byteOffset"],
            (view["byteStride"], kind.itemsize),
        )  # fmt: skip
        result[name] = rows.squeeze()
    return result


def test_labels_are_those_of_the_nearest_voxel(volumes: Any, tmp_path: Path) -> None:
    pyramid, other, array = volumes
    mesh = pyramid.extract(0, attributes={"label": isobrick.Nearest(other), "mixed": other})
    wanted = nearest(array, mesh)
    assert len(np.unique(wanted)) > 50
    assert mesh.attributes["label"].dtype == np.uint32
    np.testing.assert_array_equal(mesh.attributes["label"], wanted)
    assert not np.array_equal(mesh.attributes["mixed"], wanted)
    for name in ("a.vtp", "a.ply", "a.glb"):
        mesh.save(tmp_path / name)
    packed = vtk_points(tmp_path / "a.vtp")
    assert packed.GetArray("label").GetDataTypeAsString() == "unsigned int"
    np.testing.assert_array_equal(vtk_to_numpy(packed.GetArray("label")), wanted)
    np.testing.assert_array_equal(vtk_to_numpy(packed.GetArray("mixed")), mesh.attributes["mixed"])
    vertices = ply_vertices(tmp_path / "a.ply")
    assert vertices["label"].dtype == "<u4"
    np.testing.assert_array_equal(vertices["label"], wanted)
    np.testing.assert_array_equal(vertices["mixed"], mesh.attributes["mixed"])
    packed = glb_attributes(tmp_path / "a.glb")
    np.testing.assert_array_equal(packed["_LABEL"], wanted.astype(np.float32))
    np.testing.assert_array_equal(packed["_MIXED"], mesh.attributes["mixed"])
    points = mesh.to_pyvista().point_data
    np.testing.assert_array_equal(points["label"], wanted)


def test_outside_there_is_no_label(tmp_path: Path) -> None:
    isobrick.build(ball(40), tmp_path / "ball.isb")
    isobrick.build(labels(20), tmp_path / "corner.isb")
    with isobrick.Pyramid(tmp_path / "ball.isb") as pyramid, isobrick.Pyramid(tmp_path / "corner.isb") as corner:
        mesh = pyramid.extract(0, attributes={"label": isobrick.Nearest(corner)})
    outside = (mesh.points > 19.5).any(axis=1)
    assert outside.any() and not outside.all()
    assert (mesh.attributes["label"][outside] == 0).all()
    assert (mesh.attributes["label"][~outside] >= 1000).all()


def test_signed_labels_keep_their_sign(tmp_path: Path) -> None:
    isobrick.build(ball(30), tmp_path / "ball.isb")
    array = (labels(30).astype(np.int32) - 2000).astype(np.int16)
    isobrick.build(array, tmp_path / "signed.isb")
    with isobrick.Pyramid(tmp_path / "ball.isb") as pyramid, isobrick.Pyramid(tmp_path / "signed.isb") as signed:
        mesh = pyramid.extract(0, attributes={"label": isobrick.Nearest(signed)})
        mesh.save(tmp_path / "a.ply")
    assert mesh.attributes["label"].dtype == np.int32
    np.testing.assert_array_equal(ply_vertices(tmp_path / "a.ply")["label"], nearest(array, mesh))


def test_thickness_and_distance_of_a_shell(tmp_path: Path) -> None:
    n, middle = 50, np.array([24.3, 23.6, 24.9])
    z, y, x = np.mgrid[:n, :n, :n]
    radius = np.sqrt((x - middle[0]) ** 2 + (y - middle[1]) ** 2 + (z - middle[2]) ** 2)
    isobrick.build((3 - np.abs(radius - 17)).astype(np.float32), tmp_path / "shell.isb", spacing=(2, 2, 2))
    with isobrick.Pyramid(tmp_path / "shell.isb") as pyramid:
        core = pyramid.extract(1.5)
        core.save(tmp_path / "core.ply")
        mesh = pyramid.extract(
            0,
            attributes={
                "wall": isobrick.Thickness(),
                "capped": isobrick.Thickness(5),
                "from_core": isobrick.Distance(1.5),
                "from_file": isobrick.Distance(tmp_path / "core.ply"),
            },
        )
    np.testing.assert_allclose(mesh.attributes["wall"], 12, atol=0.15)
    assert (mesh.attributes["capped"] == 5).all()
    np.testing.assert_allclose(mesh.attributes["from_core"], 3, atol=0.1)
    np.testing.assert_allclose(mesh.attributes["from_file"], mesh.attributes["from_core"], atol=1e-4)


def test_colours_are_those_of_the_map(tmp_path: Path) -> None:
    isobrick.build(ball(30), tmp_path / "ball.isb")
    x = np.broadcast_to(np.arange(30, dtype=np.float32), (30, 30, 30))
    isobrick.build(np.ascontiguousarray(x), tmp_path / "x.isb")
    with isobrick.Pyramid(tmp_path / "ball.isb") as pyramid, isobrick.Pyramid(tmp_path / "x.isb") as other:
        mesh = pyramid.extract(0, values=other)
    colors = isobrick.Colors("value", "grey", 5, 25)
    for name in ("a.ply", "a.obj", "a.glb"):
        mesh.save(tmp_path / name, colors=colors)
    assert mesh.values is not None
    share = np.clip((mesh.values.astype(float) - 5) / 20, 0, 1)
    vertices = ply_vertices(tmp_path / "a.ply")
    for channel in ("red", "green", "blue"):
        np.testing.assert_allclose(vertices[channel] / 255, share, atol=0.012)
    rows = [line.split() for line in (tmp_path / "a.obj").read_text().splitlines() if line.startswith("v ")]
    assert {len(row) for row in rows} == {7}
    np.testing.assert_allclose([float(row[4]) for row in rows], vertices["red"] / 255, atol=0.0021)
    linear = glb_attributes(tmp_path / "a.glb")["COLOR_0"]
    assert linear.dtype == np.uint16 and (linear[:, 3] == 65535).all()
    light = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    np.testing.assert_allclose(linear[:, 1] / 65535, light, atol=0.012)
    with pytest.raises(isobrick.Error, match="no colours"):
        mesh.save(tmp_path / "a.vtp", colors=colors)
    with pytest.raises(isobrick.Error, match="no attribute 'other'"):
        mesh.save(tmp_path / "a.ply", colors=isobrick.Colors("other"))


def test_the_command_writes_the_same(volumes: Any, command: Callable[..., str], tmp_path: Path) -> None:
    pyramid, other, _ = volumes
    ending_words = {"ply": (), "vtp": (), "glb": ("--meshopt",)}
    for ending, packing in ending_words.items():
        mine, theirs = tmp_path / f"mine.{ending}", tmp_path / f"theirs.{ending}"
        colors = None if ending == "vtp" else isobrick.Colors("wall", "inferno", 0, 6)
        coloring = () if colors is None else ("--color-by", "wall", "--colormap", "inferno:0:6")
        pyramid.extract_to(
            mine, 0, attributes={"id": isobrick.Nearest(other), "wall": isobrick.Thickness(6)}, colors=colors,
            meshopt=bool(packing),
        )  # fmt: skip
        command(
            "extract", tmp_path / "ball.isb", "--iso", 0, "--attribute", f"id=nearest:{tmp_path / 'labels.isb'}",
            "--attribute", "wall=thickness:6", *coloring, *packing, "-o", theirs,
        )  # fmt: skip
        assert mine.read_bytes() == theirs.read_bytes()


def test_names_and_needs_are_checked(volumes: Any, tmp_path: Path) -> None:
    pyramid, other, _ = volumes
    for name in ("", "2nd", "a b", "x", "NX", "red", "a" * 25):
        with pytest.raises(isobrick.Error, match="name"):
            pyramid.extract_to(tmp_path / "a.ply", 0, attributes={name: other})
    with pytest.raises(isobrick.Error, match="pyramid"):
        isobrick.isosurface(ball(20), 0, attributes={"wall": isobrick.Thickness()})
    distances = isobrick.isosurface(ball(20), 0, attributes={"value": other}).attributes
    assert set(distances) == {"value"}


def test_a_check_says_what_others_say(tmp_path: Path) -> None:
    isobrick.build(ball(40), tmp_path / "ball.isb", spacing=(1, 2, 0.5), brick_cells=16)
    with isobrick.Pyramid(tmp_path / "ball.isb") as pyramid:
        for mesh in (pyramid.extract(0), pyramid.extract(0, simplify=0.2), pyramid.extract(-9)):
            quality, surface = mesh.check(), mesh.to_pyvista()
            assert quality.is_solid == (surface.n_open_edges == 0)
            assert quality.open_edges == surface.n_open_edges
            assert quality.area == pytest.approx(surface.area, rel=1e-5)
            shape = aspects(surface)
            assert quality.mean_aspect == pytest.approx(shape.mean(), rel=1e-3)
            assert quality.worst_aspect == pytest.approx(shape.max(), rel=1e-3)
            if quality.is_solid:
                assert quality.volume == pytest.approx(surface.volume, rel=1e-4)
                assert quality.euler_number == 2


def aspects(surface: Any) -> Any:
    """Verdict's, by VTK."""
    measure = vtk.vtkMeshQuality()
    measure.SetInputData(surface)
    measure.SetTriangleQualityMeasureToAspectRatio()
    measure.Update()
    return vtk_to_numpy(measure.GetOutput().GetCellData().GetArray("Quality"))
