"""Meshes are those of the command, and others can use them."""

from __future__ import annotations

import gc
import random
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import isobrick
from isobrick._query import IN_SPACE
from conftest import ball

NAMES = ["head", "gyroid", "sphere", "torus", "marschner-lobb", "plane"]


def read_ply(path: Path) -> tuple[Any, Any, Any, Any]:
    """Points, normals, faces and levels of a file of the command."""
    header, _, body = path.read_bytes().partition(b"end_header\n")
    lines = [line.split() for line in header.decode().splitlines()]
    vertices, faces = (int(line[2]) for line in lines if line[0] == "element")
    real = "<f8" if ["property", "double", "x"] in lines else "<f4"
    vertex = np.dtype([("p", real, 3), ("n", "<f4", 3)])
    face = np.dtype([("three", "u1"), ("v", "<u4", 3), ("level", "u1")])
    v = np.frombuffer(body, vertex, vertices)
    f = np.frombuffer(body, face, faces, vertices * vertex.itemsize)
    assert len(body) == vertices * vertex.itemsize + faces * face.itemsize
    return v["p"], v["n"], f["v"], f["level"]


def volumes(folder: Path) -> list[Path]:
    """Ten of all types; some oblique, some flipped, one so far from the origin that floats do not do."""
    made = []
    for name in NAMES:
        made.append(folder / f"{name}.isb")
        isobrick.build(f"phantom:{name}:{random.Random(name).randint(30, 90)}", made[-1])
    a = 0.3
    turn = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, -1.0]])
    for i, (dtype, origin) in enumerate([("uint8", 0), ("int8", 50), ("int16", -3), ("float32", 9e6)]):
        made.append(folder / f"turned{i}.isb")
        isobrick.build(
            ball(44 + 9 * i, dtype), made[-1], direction=turn, origin=(origin, 2, 3), spacing=(0.5, 0.7, 1.1),
            brick_cells=16,
        )  # fmt: skip
    return made


def random_query(draw: random.Random, pyramid: isobrick.Pyramid) -> tuple[dict[str, Any], list[Any]]:
    """The same for Python and for the command."""
    low, high = pyramid.value_range
    choice: dict[str, Any] = {"isovalue": round(draw.uniform(low, high), 3)}
    words: list[Any] = ["--iso", choice["isovalue"]]
    world = draw.random() < 0.5
    nz, ny, nx = pyramid.shape

    def place() -> tuple[float, float, float]:
        index = [draw.uniform(-0.2, 1.2) * n for n in (nx, ny, nz)]
        at = (pyramid.affine @ [*index, 1])[:3] if world else index
        return float(at[0]), float(at[1]), float(at[2])

    kind = draw.choice(["plain", "focus", "level", "view", "curvature", "box", "simplify"])
    if kind == "focus" or (kind == "curvature" and draw.random() < 0.5):
        choice.update(focus=place(), radius=draw.uniform(0, nx / 2))
        words += ["--focus", ",".join(map(repr, choice["focus"])), "--radius", repr(choice["radius"])]
    if kind == "level":
        choice.update(level=draw.randrange(3))
        words += ["--level", choice["level"]]
    if kind == "view":
        eye = (pyramid.affine @ [-2 * nx, ny, nz, 1])[:3].tolist()
        choice.update(view=isobrick.View(eye, pixels=8))
        words += ["--eye", ",".join(map(repr, eye)), "--pixels", 8]
    if kind == "curvature":
        choice.update(curvature=draw.uniform(0, 0.1))
        words += ["--curvature", repr(choice["curvature"])]
    if kind == "box":
        middle = [n / 2 for n in (nx, ny, nz)]
        choice.update(box_voxels=((0, 0, 0), tuple(middle)))
        return choice, [*words, "--box", f"0,0,0,{','.join(map(repr, middle))}"]
    if kind == "simplify":
        distance = draw.uniform(0.05, 1)
        choice.update(simplify=distance)
        world = world and pyramid.unit == "millimetres"
        words += ["--simplify", f"{distance!r}{'mm' if world else ''}"]
    if not world:
        choice = {f"{name}_voxels" if name in IN_SPACE else name: value for name, value in choice.items()}
    return choice, [*words, *(["--world"] if world else [])]


def test_hundred_random_queries_on_ten_volumes_are_those_of_the_command(tmp_path: Path, command: Any) -> None:
    draw = random.Random(26)
    triangles = 0
    for path in volumes(tmp_path):
        with isobrick.open(path) as pyramid:
            session = pyramid.session()
            for number in range(10):
                choice, words = random_query(draw, pyramid)
                wanted = tmp_path / "wanted.ply"
                command("extract", path, *words, "-o", wanted, "--force")
                points, normals, faces, levels = read_ply(wanted)
                mesh = (session if number % 2 else pyramid).extract(**choice)
                assert mesh.points.dtype == points.dtype
                for ours, theirs in [
                    (mesh.points, points), (mesh.normals, normals), (mesh.faces, faces), (mesh.levels, levels),
                ]:  # fmt: skip
                    assert ours.tobytes() == theirs.tobytes(), f"{path.name}: {choice}"
                mesh.save(tmp_path / "saved.ply")
                assert (tmp_path / "saved.ply").read_bytes() == wanted.read_bytes()
                triangles += len(faces)
    assert triangles > 100_000, "most queries have a surface"


@pytest.mark.parametrize("ending", ["ply", "stl", "obj", "glb", "vtp"])
@pytest.mark.parametrize("choice", [{}, {"focus": (60, 40, 60), "radius": 12}, {"simplify": 0.4}])
def test_saved_files_are_those_that_are_streamed(head: Path, tmp_path: Path, ending: str, choice: Any) -> None:
    with isobrick.open(head) as pyramid:
        mesh = pyramid.extract(1324, **choice)
        mesh.save(tmp_path / f"a.{ending}")
        report = pyramid.extract_to(tmp_path / f"b.{ending}", 1324, **choice)
        assert report.triangles == len(mesh.faces)
    assert (tmp_path / f"a.{ending}").read_bytes() == (tmp_path / f"b.{ending}").read_bytes()


def test_arrays_share_memory_that_outlives_everything_else(head: Path) -> None:
    with isobrick.open(head) as pyramid:
        mesh = pyramid.extract(1324, focus=(64, 40, 64), radius=10)
        arrays = [mesh.points, mesh.faces, mesh.normals, mesh.levels]
        assert all(np.shares_memory(a, b) for a, b in zip(arrays, [mesh.points, mesh.faces, mesh.normals, mesh.levels]))
        assert not any(a.flags.writeable or a.flags.owndata for a in arrays)
    copies = [a.copy() for a in arrays]
    del mesh, pyramid
    gc.collect()
    assert all(np.array_equal(a, b) for a, b in zip(arrays, copies))


def test_a_session_writes_over_what_nobody_holds(head: Path) -> None:
    with isobrick.open(head) as pyramid:
        session = pyramid.session()
        kept = session.extract(1324)
        points = kept.points
        before = points.copy()
        addresses = set()
        for isovalue in (500, 600, 700, 800):
            mesh = session.extract(isovalue)
            addresses.add(mesh.faces.__array_interface__["data"][0])
            del mesh
        assert len(addresses) == 1, "the memory of a dropped mesh is used again"
        del kept
        session.extract(900)
        assert np.array_equal(points, before), "one array is enough to hold a mesh"


def test_progressive_meshes_end_with_the_whole_surface(head: Path) -> None:
    with isobrick.open(head) as pyramid:
        meshes = list(pyramid.session().progressive(1324, focus=(64, 40, 64), radius=30))
        assert meshes[-1].is_complete and not any(m.is_complete for m in meshes[:-1])
        whole = pyramid.extract(1324, focus=(64, 40, 64), radius=30)
        assert np.array_equal(meshes[-1].points, whole.points)
        assert np.array_equal(meshes[-1].faces, whole.faces)


def test_values_of_another_pyramid(tmp_path: Path) -> None:
    array = ball(40)
    z, y, x = np.mgrid[0:20, 0:20, 0:20].astype(np.float32)
    isobrick.build(array, tmp_path / "a.isb")
    isobrick.build(x + 100 * y, tmp_path / "b.isb", spacing=(2, 2, 2))
    with isobrick.open(tmp_path / "a.isb") as a, isobrick.open(tmp_path / "b.isb") as b:
        mesh = a.extract(0, values=b)
        assert a.extract(0).values is None
    assert mesh.values is not None
    wanted = mesh.points[:, 0] / 2 + 100 * mesh.points[:, 1] / 2
    assert np.allclose(mesh.values, wanted, atol=1e-2)
    mesh.save(tmp_path / "v.vtp")
    import pyvista

    assert np.allclose(pyvista.read(tmp_path / "v.vtp")["value"], mesh.values)


def test_voxels_and_world_are_the_same_place(tmp_path: Path) -> None:
    isobrick.build(ball(40), tmp_path / "w.isb", spacing=(0.5, 0.5, 0.5), origin=(10, 20, 30))
    with isobrick.open(tmp_path / "w.isb") as pyramid:
        world = {
            "box": ((10, 20, 30), (20, 30, 49)), "clip": (0, 1, 0, 28), "sphere": (19, 30, 39, 9), "simplify": 0.1,
        }  # fmt: skip
        voxels = {
            "box_voxels": ((0, 0, 0), (20, 20, 38)), "clip_voxels": ((0, 16, 0), (0, 2, 0)),
            "sphere_voxels": (18, 20, 18, 18), "simplify_voxels": 0.2,
        }  # fmt: skip
        cut = pyramid.extract(0, **world)
        for name in voxels:  # one by one, beside the others in the world
            mixed = {**world, name: voxels[name]}
            del mixed[name.removesuffix("_voxels")]
            assert np.array_equal(pyramid.extract(0, **mixed).points, cut.points)
        query = isobrick.Query(0, **world)
        assert np.array_equal(pyramid.extract(query, box_voxels=voxels["box_voxels"]).points, cut.points)
        with pytest.raises(ValueError, match="give one of them"):
            isobrick.Query(0, box=world["box"], box_voxels=voxels["box_voxels"])
        with pytest.warns(FutureWarning, match="0.4"):
            old = pyramid.extract(
                0, focus=(10, 20, 30), radius=4, indices=True, or_finer=[isobrick.Detail((2, 2, 2), 3)]
            )
        now = pyramid.extract(
            0, focus_voxels=(10, 20, 30), radius_voxels=4,
            or_finer=[isobrick.Detail(focus_voxels=(2, 2, 2), radius_voxels=3)],
        )  # fmt: skip
        assert np.array_equal(old.points, now.points)
        by_index = pyramid.extract(0, focus_voxels=(10, 20, 30), radius_voxels=4)
        by_world = pyramid.extract(0, focus=(15, 30, 45), radius=2)
        assert np.array_equal(by_index.points, by_world.points)
        assert np.allclose(by_index.index_points * 0.5 + [10, 20, 30], by_index.points, atol=1e-5)


def test_area_and_volume_of_a_ball(tmp_path: Path) -> None:
    isobrick.build(ball(60), tmp_path / "b.isb", spacing=(2, 2, 2))
    with isobrick.open(tmp_path / "b.isb") as pyramid:
        mesh = pyramid.extract(0)
    assert mesh.volume() == pytest.approx(4 / 3 * np.pi * 40**3, rel=5e-3)
    assert mesh.area() == pytest.approx(4 * np.pi * 40**2, rel=5e-3)


@pytest.mark.parametrize("choice", [{}, {"focus": (30, 30, 10), "radius": 5}])
def test_vtk_pyvista_trimesh_and_meshio(tmp_path: Path, choice: Any) -> None:
    import meshio

    isobrick.build(ball(60), tmp_path / "b.isb")
    with isobrick.open(tmp_path / "b.isb") as pyramid:
        mesh = pyramid.extract(0, **choice)
    drawn = mesh.to_pyvista()
    assert np.shares_memory(drawn.points, mesh.points)
    assert np.array_equal(drawn.regular_faces, mesh.faces) and np.array_equal(drawn.cell_data["level"], mesh.levels)
    assert drawn.n_open_edges == 0 and drawn.area == pytest.approx(mesh.area(), rel=1e-4)
    solid = mesh.to_trimesh()
    assert solid.is_watertight and solid.is_winding_consistent
    assert solid.volume == pytest.approx(mesh.volume(), rel=1e-6)
    mesh.to_meshio().write(tmp_path / "m.vtu")
    again = meshio.read(tmp_path / "m.vtu")
    assert np.array_equal(again.points, mesh.points) and np.array_equal(again.cells[0].data, mesh.faces)


def test_the_vtk_source_and_image(head: Path) -> None:
    from vtkmodules.vtkImagingCore import vtkImageReslice  # noqa: F401  a real VTK, with filters

    from isobrick.vtk import ImageSource, Source

    source = Source()
    source.SetFileName(str(head))
    source.SetIsovalues(500, 1324)
    source.SetLevel(1)
    source.Update()
    with isobrick.open(head) as pyramid:
        parts = [pyramid.extract(v, level=1) for v in (500, 1324)]
        output = source.GetOutputDataObject(0)
        assert output.GetNumberOfPolys() == sum(len(m.faces) for m in parts)
        source.SetIsovalue(1324)
        source.SetFocus(64, 40, 64)
        source.SetRadius(10)
        source.Update()
        wanted = pyramid.extract(1324, focus=(64, 40, 64), radius=10)
        assert source.GetOutputDataObject(0).GetNumberOfPolys() == len(wanted.faces)
        image = ImageSource()
        image.SetFileName(str(head))
        image.SetLevel(2)
        image.Update()
        output = image.GetOutputDataObject(0)
        level = pyramid.level(2)
        assert output.GetDimensions() == level.shape[::-1] and output.GetSpacing() == (4, 4, 4)
        assert output.GetScalarComponentAsDouble(5, 6, 7, 0) == level[7, 6, 5]


def test_specks_go_if_that_is_asked(tmp_path: Path) -> None:
    array = ball(40)
    array[2, 3, 4] = 5.0  # one voxel, whose surface has a box with a diagonal below the root of 3
    isobrick.build(array, tmp_path / "s.isb")
    with isobrick.open(tmp_path / "s.isb") as pyramid:
        whole = pyramid.extract(0, simplify_voxels=1.8)
        dropped = pyramid.extract(0, simplify_voxels=1.8, drop_small=True)
        kept = pyramid.extract(0, simplify_voxels=0.5, drop_small=True)
        assert whole.points.min() < 3 < dropped.points.min() and kept.points.min() < 3
        with pytest.raises(isobrick.Error, match="drop_small goes with simplify"):
            pyramid.extract(0, drop_small=True)


def test_an_empty_surface(head: Path) -> None:
    with isobrick.open(head) as pyramid:
        mesh = pyramid.extract(60000)
        assert mesh.points.shape == (0, 3) and mesh.faces.shape == (0, 3) and mesh.levels.shape == (0,)
        assert mesh.to_pyvista().n_cells == 0 and mesh.area() == 0


@pytest.mark.parametrize(
    ("choice", "message"),
    [
        ({"focus": (1, 2, 3)}, "focus and radius belong together"),
        ({"level": 99}, "level"),
        ({"focus": (1, 2, 3), "radius": -1}, "radius"),
        ({"isovalue": float("nan")}, "isovalue"),
        ({"focus": (1, 2, 3), "radius": 1, "level": 1}, "level"),
    ],
)
def test_queries_that_make_no_sense(head: Path, choice: Any, message: str) -> None:
    with isobrick.open(head) as pyramid, pytest.raises(isobrick.Error, match=message):
        pyramid.extract(**{"isovalue": 1324, **choice})


def test_caps_make_a_solid(tmp_path: Path) -> None:
    """A slab that leaves the volume on four sides; half of it in a box."""
    z, y, x = np.meshgrid(*(np.arange(n, dtype=np.float32) for n in (21, 30, 24)), indexing="ij")
    slab = 4.25 - np.abs(x - 11.5)
    isobrick.build(slab, tmp_path / "slab.isb", spacing=(0.5, 1, 2))
    with isobrick.open(tmp_path / "slab.isb") as pyramid:
        mesh = pyramid.extract(0, cap=True)
        assert mesh.volume() == pytest.approx(8.5 * 0.5 * 29 * 40, rel=1e-5)
        assert mesh.caps.dtype == bool and len(mesh.caps) == len(mesh.faces)
        a, b, c = (mesh.points[mesh.faces[mesh.caps][:, i]].astype(float) for i in range(3))
        caps = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2
        assert caps == pytest.approx(2 * 8.5 * 0.5 * (29 + 40), rel=1e-5)
        assert sum(level.cap_triangles for level in mesh.report.levels) == mesh.caps.sum()
        half = pyramid.extract(0, box_voxels=((0, 0, 0), (24, 10, 21)), cap=True)
        assert half.volume() == pytest.approx(8.5 * 0.5 * 10 * 40, rel=1e-5)
        mesh.save(tmp_path / "saved.ply")
        pyramid.extract_to(tmp_path / "written.ply", 0, cap=True)
        assert (tmp_path / "saved.ply").read_bytes() == (tmp_path / "written.ply").read_bytes()
        open_mesh = pyramid.extract(0)
        assert not open_mesh.caps.any() and len(open_mesh.faces) == len(mesh.faces) - mesh.caps.sum()
    in_memory = isobrick.isosurface(slab, 0, spacing=(0.5, 1, 2), cap=True)
    assert in_memory.volume() == pytest.approx(mesh.volume(), rel=1e-6)
