"""3MF, read by a plain reader and by the programs of others."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import isobrick

CORE = "{http://schemas.microsoft.com/3dmanufacturing/core/2015/02}"
RADIUS, SPACING = 9.3, 0.5


@pytest.fixture(scope="module")
def ball(tmp_path_factory: pytest.TempPathFactory) -> isobrick.Pyramid:
    z, y, x = np.mgrid[0:30, 0:31, 0:32].astype(np.float32)
    field = RADIUS - np.sqrt((x - 15.2) ** 2 + (y - 14.8) ** 2 + (z - 14.1) ** 2)
    path = tmp_path_factory.mktemp("3mf") / "ball.isb"
    isobrick.build(field, path, spacing=(SPACING,) * 3, origin=(3, -7, 11))
    return isobrick.open(path)


def read_plain(path: Path) -> tuple[ElementTree.Element, NDArray[Any], NDArray[Any]]:
    with zipfile.ZipFile(path) as archive:
        assert archive.testzip() is None
        assert archive.namelist() == ["[Content_Types].xml", "_rels/.rels", "3D/3dmodel.model"]
        for name in archive.namelist()[:2]:
            ElementTree.fromstring(archive.read(name))
        model = ElementTree.fromstring(archive.read("3D/3dmodel.model"))
    points = [[float(v.get(axis, "")) for axis in "xyz"] for v in model.iter(CORE + "vertex")]
    faces = [[int(t.get(v, "")) for v in ("v1", "v2", "v3")] for t in model.iter(CORE + "triangle")]
    return model, np.array(points), np.array(faces)


def volume_of(points: NDArray[Any], faces: NDArray[Any]) -> float:
    a, b, c = (points[faces[:, i]].astype(np.float64) for i in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6)


def test_it_holds_the_mesh(ball: isobrick.Pyramid, tmp_path: Path) -> None:
    path = tmp_path / "ball.3mf"
    report = ball.extract_to(path, 0.0)
    model, points, faces = read_plain(path)
    mesh = ball.extract(0.0)
    assert report.triangles == len(faces) and report.vertices == len(points)
    assert model.get("unit") == "millimeter"
    # Vertices are numbered in another order.
    np.testing.assert_array_equal(np.sort(points.astype(np.float32), axis=0), np.sort(mesh.points, axis=0))
    assert volume_of(points, faces) == pytest.approx(mesh.volume(), rel=1e-5)
    assert volume_of(points, faces) == pytest.approx(4 / 3 * np.pi * (RADIUS * SPACING) ** 3, rel=0.01)
    saved = tmp_path / "saved.3mf"
    mesh.save(saved)
    assert saved.read_bytes() == path.read_bytes()


def test_threads_change_no_byte(ball: isobrick.Pyramid, tmp_path: Path) -> None:
    for threads in (1, 2, 5):
        ball.extract_to(tmp_path / f"{threads}.3mf", 0.0, threads=threads)
    assert len({(tmp_path / f"{threads}.3mf").read_bytes() for threads in (1, 2, 5)}) == 1


def test_an_empty_mesh_is_a_model_without_objects(ball: isobrick.Pyramid, tmp_path: Path) -> None:
    ball.extract_to(tmp_path / "empty.3mf", 1000.0)
    model, points, faces = read_plain(tmp_path / "empty.3mf")
    assert len(points) == len(faces) == 0 and not list(model.iter(CORE + "item"))


def test_trimesh_reads_it(ball: isobrick.Pyramid, tmp_path: Path) -> None:
    trimesh = pytest.importorskip("trimesh")
    path = tmp_path / "ball.3mf"
    ball.extract_to(path, 0.0, inside="below")
    mesh = trimesh.load(path, force="mesh")
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(-4 / 3 * np.pi * (RADIUS * SPACING) ** 3, rel=0.01)


def test_the_library_of_the_format_reads_it(ball: isobrick.Pyramid, tmp_path: Path) -> None:
    lib3mf = pytest.importorskip("lib3mf")
    path = tmp_path / "ball.3mf"
    ball.extract_to(path, 0.0)
    _, points, faces = read_plain(path)
    model = lib3mf.get_wrapper().CreateModel()
    reader = model.QueryReader("3mf")
    reader.SetStrictModeActive(True)
    reader.ReadFromFile(str(path))
    assert reader.GetWarningCount() == 0
    meshes = model.GetMeshObjects()
    assert meshes.MoveNext()
    mesh = meshes.GetCurrentMeshObject()
    assert mesh.IsManifoldAndOriented()
    assert (mesh.GetVertexCount(), mesh.GetTriangleCount()) == (len(points), len(faces))


def test_several_in_one_file(ball: isobrick.Pyramid, tmp_path: Path) -> None:
    """As `extract --together` does."""
    meshes = {"outer": ball.extract(0), "inner": ball.extract(4.5)}
    isobrick.save_together(tmp_path / "all.3mf", meshes, mesh_colors={"inner": (1, 0.5, 0)})
    model, points, faces = read_plain(tmp_path / "all.3mf")
    assert [o.get("name") for o in model.iter(CORE + "object")] == ["outer", "inner"]
    assert len(points) == sum(len(mesh.points) for mesh in meshes.values())
    assert len(faces) == sum(len(mesh.faces) for mesh in meshes.values())
    assert [b.get("displaycolor") for b in model.iter(CORE + "base")] == ["#FF8000"]
    with pytest.raises(isobrick.Error, match=r"write \.glb or \.3mf"):
        isobrick.save_together(tmp_path / "all.ply", meshes)
    isobrick.save_together(tmp_path / "all.glb", meshes)
    trimesh = pytest.importorskip("trimesh")
    assert set(trimesh.load(tmp_path / "all.glb").geometry) == {"outer", "inner"}


def test_labels_of_one_mesh(tmp_path: Path) -> None:
    """Their ids are exact, whatever the format."""
    ids = np.zeros((20, 21, 22), np.uint32)
    ids[3:9, 4:12, 5:15] = 3
    ids[9:17, 4:12, 5:15] = 2**32 - 1
    meshes = {int(i): isobrick.isosurface(ids, label=int(i)) for i in (3, 2**32 - 1)}
    isobrick.save_together(tmp_path / "all.ply", meshes)
    header, _, body = (tmp_path / "all.ply").read_bytes().partition(b"end_header\n")
    assert b"property uint label\n" in header
    vertex = np.dtype([("p", "<f4", 3), ("n", "<f4", 3), ("label", "<u4")])
    face = np.dtype([("three", "u1"), ("v", "<u4", 3), ("level", "u1")])
    sizes = [len(mesh.points) for mesh in meshes.values()]
    vertices = np.frombuffer(body, vertex, sum(sizes))
    expected = np.repeat(np.array(list(meshes), np.uint32), sizes)
    np.testing.assert_array_equal(vertices["label"], expected)
    np.testing.assert_array_equal(vertices["p"], np.concatenate([mesh.points for mesh in meshes.values()]))
    of_faces = expected[np.frombuffer(body, face, offset=vertices.nbytes)["v"]]
    assert (of_faces == of_faces[:, :1]).all()
    isobrick.save_together(tmp_path / "all.obj", meshes)
    groups = [line for line in (tmp_path / "all.obj").read_text().splitlines() if line.startswith("g ")]
    assert list(dict.fromkeys(groups)) == ["g label_3", "g label_4294967295"]
