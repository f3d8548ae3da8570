#!/usr/bin/python3
"""Meshes that isobrick wrote, read by others: each format must hold what the PLY of its query holds.

    mesh_formats.py ISOBRICK numpy|vtk|assimp|meshio

$CHECK_MESH is the mesh checker's program.

numpy: those of mesh_readers.py, written from the formats' specifications. vtk, assimp, meshio: those programs' own.
"""
import itertools
import os
import signal
import subprocess
import sys
import tempfile
import time

import numpy as np

sys.dont_write_bytecode = True  # beside the sources
from common import ISOBRICK, rotation, run, write_nrrd
from mesh_readers import Mesh, read_glb, read_meshopt, read_obj, read_ply, read_vtp


def grid(shape):
    z, y, x = np.meshgrid(*(np.arange(n, dtype=float) for n in shape), indexing="ij")
    return x, y, z


def build_surface(name, direction, spacing, origin):
    """A bumpy ball of several bricks; in each direction of its own spacing."""
    x, y, z = grid((80, 90, 100))
    values = 30 - np.sqrt((x - 51) ** 2 + (y - 44) ** 2 + (z - 39) ** 2)
    values += 3 * np.sin(0.5 * x) * np.cos(0.4 * y + 1) + 2 * np.sin(0.6 * z)
    write_nrrd("volume.nrrd", values.astype("<f4"), direction, spacing, origin)
    run("build", "volume.nrrd", "-o", name, "--force")


def write_plain_ply(path, positions, triangles):
    vertices = np.ascontiguousarray(positions, "<f8")
    faces = np.empty(len(triangles), [("count", "u1"), ("corners", "<u4", 3)])
    faces["count"], faces["corners"] = 3, triangles
    lines = ["ply", "format binary_little_endian 1.0", f"element vertex {len(vertices)}"]
    lines += [f"property double {axis}" for axis in "xyz"]
    lines += [f"element face {len(faces)}", "property list uchar uint vertex_indices", "end_header"]
    with open(path, "wb") as file:
        file.write("\n".join(lines).encode() + b"\n" + vertices.tobytes() + faces.tobytes())


def check_packed():
    """--meshopt against the PLY of its query: every vertex, every triangle, nothing open."""
    direction, spacing, origin = FAR  # where the PLY takes doubles
    shape = np.array([64, 90, 130])
    z, y, x = (0.55 * np.arange(n, dtype=float).reshape(-1, *[1] * (2 - a)) for a, n in enumerate(shape))
    values = np.sin(x) * np.cos(y) + np.sin(y) * np.cos(z) + np.sin(z) * np.cos(x)
    write_nrrd("waves.nrrd", values.astype("<f4"), *FAR)
    run("build", "waves.nrrd", "-o", "waves.isb")
    parts = []
    for query in (("--iso", "0.1"), ("--iso", "0.1", "--focus", "60,40,30", "--radius", "20"),
                  ("--iso", "0", "--level", "1", "--attribute", "waves.isb"),
                  ("--iso", "1.2", "--attribute", "component")):
        run("extract", "--force", "waves.isb", *query, "-o", "p.ply")
        run("extract", "--force", "waves.isb", *query, "-o", "p.glb", "--meshopt", "--threads", "1")
        before = open("p.glb", "rb").read()
        run("extract", "--force", "waves.isb", *query, "-o", "p.glb", "--meshopt")
        assert open("p.glb", "rb").read() == before, "depends on the number of threads"
        ply, (packed, move, count) = read_ply("p.ply"), read_meshopt("p.glb")
        parts.append(count)
        assert 3 * len(before) < os.path.getsize("p.ply")
        # Copies of a vertex in several primitives are the same point, and no two vertices are.
        places, first, of_place = np.unique(packed.positions, axis=0, return_index=True,
                                            return_inverse=True)
        step = 2.0 ** np.floor(np.log2(spacing.min() / 8192))
        on_lattice = lambda points: np.round((points - move) / step).astype("i8")
        rank = {tuple(at): number for number, at in enumerate(on_lattice(ply.positions).tolist())}
        assert len(rank) == len(ply.positions) == len(places)
        # Halfway between two points the last bit of a double decides.
        near = list(itertools.product((0, -1, 1), repeat=3))
        number = np.array([next(rank[at] for d in near if (at := (x + d[0], y + d[1], z + d[2])) in rank)
                           for x, y, z in on_lattice(places).tolist()])
        assert np.abs(places - ply.positions[number]).max() <= 0.5001 * step
        sine = np.linalg.norm(np.cross(packed.normals[first], ply.normals[number]), axis=1)
        assert sine.max() < np.sin(np.radians(0.25)), np.degrees(sine.max())
        np.testing.assert_allclose(np.linalg.norm(packed.normals, axis=1), 1, atol=1e-3)
        assert (packed.normals[first] * ply.normals[number]).sum(1).min() > 0
        if ply.values is not None:
            np.testing.assert_array_equal(packed.values[first], ply.values[number])
        def in_order(triangles):
            turned = np.take_along_axis(
                triangles, (triangles.argmin(1)[:, None] + np.arange(3)) % 3, 1)
            return turned[np.lexsort(turned.T)]
        corners = of_place[packed.triangles]
        np.testing.assert_array_equal(in_order(number[corners]), in_order(ply.triangles.astype("i8")))
        # The checker welds nothing, so it gets each place once.
        write_plain_ply("welded.ply", (places - origin) @ direction / spacing, corners)
        box = [str(n) for n in (0, 0, 0, *(shape[::-1] - 1))]
        subprocess.run([os.environ["CHECK_MESH"], "welded.ply", "--tolerance", "1e-3", "--box", *box],
                       check=True, stdout=subprocess.DEVNULL)
    assert parts[0] > 2 and parts[1] == 1, parts
    run("extract", "--force", "waves.isb", "--iso", "1e9", "-o", "p.glb", "--meshopt")
    assert len(read_meshopt("p.glb")[0].positions) == 0
    run("extract", "--force", "waves.isb", "--iso", "0", "-o", "a.ply", "--meshopt", fails_with="write .glb")


def expect_same(found, ply, positions=True):
    np.testing.assert_array_equal(found.triangles, ply.triangles)
    np.testing.assert_array_equal(found.normals, ply.normals)
    if positions:
        np.testing.assert_array_equal(found.positions, ply.positions)
        assert found.positions.dtype == ply.positions.dtype
    if found.levels is not None:
        np.testing.assert_array_equal(found.levels, ply.levels)


OBLIQUE = (rotation(), np.array([0.7, 0.4, 1.5]), np.array([-101.3, 17.77, 1000 / 7]))
FAR = (rotation() * [1, 1, -1], np.array([0.7, 0.4, 1.5]), np.array([1e6, -2e6, 3e5]))
# Values in float and double where PLY has them; one level, and several.
QUERIES = [("--iso", "0"), ("--iso", "1.5", "--focus", "30,40,30", "--radius", "12")]
ALL = ("m.ply", "m.obj", "m.glb", "m.vtp", "z.vtp")


def extract_all(pyramid, *query):
    for name in ALL:
        zlib_word = ("--zlib",) if name == "z.vtp" else ()
        run("extract", "--force", pyramid, *query, *zlib_word, "-o", name, "--threads", "1")
        before = open(name, "rb").read()
        run("extract", "--force", pyramid, *query, *zlib_word, "-o", name)
        assert open(name, "rb").read() == before, (name, "depends on the number of threads")


def test_numpy():
    for place in (OBLIQUE, FAR):
        build_surface("volume.isb", *place)
        for query in QUERIES:
            extract_all("volume.isb", *query)
            ply = read_ply("m.ply")
            assert len(ply.triangles) > 1000
            assert (ply.positions.dtype == "f8") == (place is FAR)
            expect_same(read_obj("m.obj", ply.positions.dtype), ply)
            expect_same(read_vtp("m.vtp"), ply)
            expect_same(read_vtp("z.vtp"), ply)
            assert os.path.getsize("z.vtp") < 0.8 * os.path.getsize("m.vtp")
            glb = read_glb("m.glb")
            expect_same(glb, ply, positions=place is OBLIQUE)
            # Single precision about the middle of the volume, some 100 units across.
            np.testing.assert_allclose(glb.positions, ply.positions, rtol=0, atol=2e-5)
    extract_all("volume.isb", "--iso", "1e9")
    for mesh in (read_obj("m.obj", "f8"), read_vtp("m.vtp"), read_vtp("z.vtp"), read_glb("m.glb")):
        assert len(mesh.positions) == len(mesh.normals) == len(mesh.triangles) == 0
    check_packed()
    check_attributes()
    check_components()
    check_interrupts()


def check_interrupts():
    """Ctrl-C at any moment: the whole file, or nothing at all."""
    build_surface("volume.isb", *OBLIQUE)
    before = set(os.listdir("."))
    outcomes = []
    for number in range(30):
        name = "new." + ("ply", "stl", "obj", "glb", "vtp")[number % 5]
        words = [ISOBRICK, "extract", "volume.isb", "--iso", "0", "-o", name, "--attribute",
                 "volume.isb"]
        words += ["--meshopt"] if number % 10 == 3 else []
        process = subprocess.Popen(words[:-2] if name[4:] in ("stl", "obj") else words,
                                   stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        time.sleep(0.001 + 0.0015 * number)
        process.send_signal(signal.SIGINT)
        process.communicate()
        left = set(os.listdir(".")) - before
        assert left == ({name} if process.returncode == 0 else set()), (left, process.returncode)
        outcomes.append(process.returncode)
        if process.returncode == 0:
            os.remove(name)
    assert any(outcomes)


def check_components():
    """The same numbers in all formats: one for each connected part, by its area."""
    x, y, z = grid((60, 70, 80))
    values = np.sin(0.4 * x) * np.cos(0.3 * y) + np.sin(0.5 * z) + 0.01 * x
    write_nrrd("blobs.nrrd", values.astype("<f4"), *OBLIQUE)
    run("build", "blobs.nrrd", "-o", "blobs.isb", "--force")
    query = ("extract", "--force", "blobs.isb", "--iso", "1.3", "--attribute", "component", "-o")
    for name in ("c.ply", "c.vtp", "c.glb"):
        run(*query, name)
    run(*query, "p.vtp", "--zlib")
    ply = read_ply("c.ply")
    assert ply.values.dtype == np.dtype("<u4")
    for other in (read_vtp("c.vtp"), read_vtp("p.vtp"), read_glb("c.glb")):
        np.testing.assert_array_equal(other.values, ply.values)
    assert read_vtp("c.vtp").values.dtype == np.dtype("<u4")
    # The least vertex that each one is connected to.
    least = np.arange(len(ply.positions))
    while True:
        before = least.copy()
        np.minimum.at(least, ply.triangles, least[ply.triangles].min(1)[:, None])
        least = least[least]
        if (least == before).all():
            break
    roots, of_root = np.unique(least, return_inverse=True)
    pairs = np.unique(np.stack([of_root, ply.values], 1), axis=0)
    assert len(pairs) == len(roots) > 10 and sorted(pairs[:, 1]) == list(range(len(roots)))
    a, b, c = (np.asarray(ply.positions, "f8")[ply.triangles[:, i]] for i in range(3))
    areas = np.bincount(ply.values[ply.triangles[:, 0]],
                        np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2)
    assert (areas[1:] <= areas[:-1] * (1 + 1e-5)).all()


def check_attributes():
    """A linear field of another place and size in the world is interpolated exactly."""
    build_surface("volume.isb", *OBLIQUE)
    direction = rotation() @ rotation()
    spacing, slope = np.array([1.1, 0.9, 2.3]), np.array([0.3, -0.2, 0.25])
    for origin_index, is_inside in (((-10, -10, -10), True), ((40, 30, 20), False)):
        middle = OBLIQUE[2] + OBLIQUE[0] @ (OBLIQUE[1] * np.array([51, 44, 39]))
        shape = (71, 75, 83)  # z, y, x
        half = spacing * (np.array(shape[::-1]) - 1) / 2
        origin = middle - direction @ half
        if not is_inside:
            origin = origin + direction @ (0.8 * half)
        x, y, z = grid(shape)
        index = np.stack([x, y, z], -1) * spacing
        world = index @ direction.T + origin
        write_nrrd("other.nrrd", ((world - middle) @ slope).astype("<f4"), direction, spacing, origin)
        run("build", "other.nrrd", "-o", "other.isb", "--force", "--no-curvature")
        for name, reader in (("a.ply", read_ply), ("a.vtp", read_vtp), ("a.glb", read_glb)):
            result = run("extract", "--force", "volume.isb", "--iso", "0", "-o", name, "--attribute",
                         "other.isb")
            mesh = reader(name)
            plain = "p" + name[1:]
            run("extract", "--force", "volume.isb", "--iso", "0", "-o", plain)
            expect_same(mesh, reader(plain))
            at = (mesh.positions - origin) @ direction / spacing
            away = np.maximum(-at, at - (np.array(shape[::-1]) - 1)).max(1)
            expected = (np.asarray(mesh.positions, "f8") - middle) @ slope
            within = away < -1e-3
            np.testing.assert_allclose(mesh.values[within], expected[within], atol=2e-4)
            outside = away > 0.5 + 1e-3
            if is_inside:
                assert within.all() and result.stderr == "", result.stderr
            else:
                assert outside.sum() > 100 and within.sum() > 100
                assert f" lie outside of 'other.isb' and have no value" in result.stderr
                assert ((mesh.values[outside] == 0) if name == "a.glb"
                        else np.isnan(mesh.values[outside])).all()
                rim = (away > 1e-3) & (away < 0.5 - 1e-3)
                assert not np.isnan(mesh.values[rim]).any()
    for name in ("a.obj", "a.stl"):
        run("extract", "--force", "volume.isb", "--iso", "0", "-o", name, "--attribute", "other.isb",
            fails_with="write .ply, .glb or .vtp")
    run("extract", "--force", "volume.isb", "--iso", "0", "-o", "a.ply", "--zlib", fails_with="write .vtp")
    run("extract", "--force", "volume.isb", "--iso", "0", "-o", "other.isb", "--attribute", "other.isb",
        fails_with="is the input")
    assert not os.path.exists("a.obj") and not os.path.exists("a.stl")


def test_vtk():
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkIOGeometry import vtkGLTFReader, vtkOBJReader
    from vtkmodules.vtkIOXML import vtkXMLPolyDataReader

    def mesh_of(output):
        points = output.GetPointData()
        levels, values = output.GetCellData().GetArray("level"), points.GetArray("value")
        triangles = vtk_to_numpy(output.GetPolys().GetConnectivityArray()).reshape(-1, 3)
        assert len(triangles) == output.GetNumberOfPolys()
        return Mesh(vtk_to_numpy(output.GetPoints().GetData()), vtk_to_numpy(points.GetNormals()),
                    triangles, values and vtk_to_numpy(values), levels and vtk_to_numpy(levels))

    def read(reader, name):
        reader.SetFileName(name)
        reader.Update()
        return reader.GetOutput()

    for place in (OBLIQUE, FAR):
        build_surface("volume.isb", *place)
        extract_all("volume.isb", *QUERIES[1])
        ply = read_ply("m.ply")
        for name in ("m.vtp", "z.vtp"):
            mesh = mesh_of(read(vtkXMLPolyDataReader(), name))
            assert mesh.levels is not None
            expect_same(mesh, ply)
        if place is OBLIQUE:  # its OBJ reader knows floats only, or, since VTK 9.2, makes doubles of their digits
            obj = mesh_of(read(vtkOBJReader(), "m.obj"))
            obj.positions = obj.positions.astype(np.float32)
            expect_same(obj, ply)
        blocks = read(vtkGLTFReader(), "m.glb")
        while not blocks.IsA("vtkPolyData"):
            assert blocks.GetNumberOfBlocks() == 1
            blocks = blocks.GetBlock(0)
        glb = mesh_of(blocks)
        np.testing.assert_array_equal(glb.triangles, ply.triangles)
        np.testing.assert_allclose(glb.positions, ply.positions, atol=0.5 if place is FAR else 1e-6)
    run("extract", "--force", "volume.isb", "--iso", "0", "--attribute", "volume.isb", "-o", "a.vtp")
    values = mesh_of(read(vtkXMLPolyDataReader(), "a.vtp")).values
    assert len(values) > 1000 and np.abs(values).max() < 0.2  # its own field is the isovalue there


def test_assimp():
    build_surface("volume.isb", *OBLIQUE)
    for query in QUERIES:
        extract_all("volume.isb", *query)
        ply = read_ply("m.ply")
        for name in ("m.obj", "m.glb"):
            subprocess.run(["assimp", "export", name, "read.ply", "-fplyb"], check=True,
                           stdout=subprocess.DEVNULL)
            found = read_ply("read.ply")
            if name == "m.glb":
                expect_same(found, ply)
                continue
            # Its OBJ reader gives every corner of a face a vertex of its own.
            assert len(found.triangles) == len(ply.triangles)
            for of in (lambda mesh: mesh.positions, lambda mesh: mesh.normals):
                np.testing.assert_allclose(of(found)[found.triangles], of(ply)[ply.triangles],
                                           rtol=3e-7, atol=1e-30)  # it rounds once too often


def test_meshio():
    """OBJ and STL; it has no VTP and glTF, and of binary PLY only faces without values such as level."""
    import meshio

    for place in (OBLIQUE, FAR):
        build_surface("volume.isb", *place)
        for query in QUERIES:
            for name in ("m.ply", "m.stl", "m.obj"):
                run("extract", "--force", "volume.isb", *query, "-o", name)
            ply = read_ply("m.ply")
            found = meshio.read("m.obj")
            expect_same(Mesh(found.points.astype(ply.positions.dtype),
                             found.point_data["obj:vn"].astype("f4"), found.cells_dict["triangle"]),
                        ply)
            found = meshio.read("m.stl")
            np.testing.assert_array_equal(found.points[found.cells_dict["triangle"]],
                                          ply.positions[ply.triangles].astype("f4"))


with tempfile.TemporaryDirectory(prefix="isobrick-meshes-") as folder:
    os.chdir(folder)
    globals()["test_" + sys.argv[2]]()
print("all meshes are the same")
