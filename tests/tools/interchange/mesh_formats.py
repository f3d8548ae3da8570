#!/usr/bin/python3
"""Meshes that isobrick wrote, read by others: each format must hold what the PLY of its query holds.

    mesh_formats.py ISOBRICK numpy|vtk|assimp|meshio

$CHECK_MESH is the mesh checker's program.

numpy: readers below, written from the formats' specifications. vtk, assimp, meshio: those programs' own.
"""
import ctypes
import itertools
import json
import os
import signal
import struct
import subprocess
import sys
import tempfile
import time
import xml.etree.ElementTree as xml
import zlib

import numpy as np

sys.dont_write_bytecode = True  # beside the sources
from common import ISOBRICK, rotation, run, write_nrrd


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


class Mesh:
    def __init__(self, positions, normals, triangles, values=None, levels=None):
        self.positions, self.normals, self.triangles = positions, normals, triangles
        self.values, self.levels = values, levels


def read_ply(path):
    data = open(path, "rb").read()
    end = data.index(b"end_header\n") + 11
    elements = []
    names = {"float": "<f4", "double": "<f8", "uchar": "u1", "int": "<i4", "uint": "<u4"}
    for line in data[:end].decode().splitlines():
        words = line.split()
        if words[0] == "element":
            elements.append((int(words[2]), []))
        elif words[:2] == ["property", "list"]:
            elements[-1][1].extend([("count", names[words[2]]), ("corners", names[words[3]], 3)])
        elif words[0] == "property":
            elements[-1][1].append((words[2], names[words[1]]))
    (vertices, vertex), (faces, face) = elements
    v = np.frombuffer(data, np.dtype(vertex), vertices, end)
    f = np.frombuffer(data, np.dtype(face), faces, end + v.nbytes)
    assert end + v.nbytes + f.nbytes == len(data) and (f["count"] == 3).all()
    stack = lambda *keys: np.stack([v[key] for key in keys], 1)
    return Mesh(stack("x", "y", "z"), stack("nx", "ny", "nz"), f["corners"],
                v["value"] if "value" in v.dtype.names else None,
                f["level"] if "level" in f.dtype.names else None)


def read_obj(path, kind):
    found = {"v": [], "vn": [], "f": []}
    with open(path) as file:
        lines = file.read().split("\n")
    assert lines[0] == "# isobrick" and lines.pop() == ""
    comments = [line for line in lines if line.startswith("#")]
    assert "# units: millimetres" in comments and "# space: LPS" in comments
    for line in lines[len(comments):]:
        key, *words = line.split()
        found[key].append(words)
    corners = [[word.split("//") for word in face] for face in found["f"]]
    numbers = np.array(corners, dtype=np.int64).reshape(-1, 3, 2)
    assert (numbers[:, :, 0] == numbers[:, :, 1]).all()
    # A reader that goes through once knows every vertex before the first face that has it.
    known = 0
    for line in lines:
        known += line.startswith("v ")
        if line.startswith("f "):
            assert max(int(word.split("//")[0]) for word in line.split()[1:]) <= known
    as_numbers = lambda rows, type: np.array(rows, dtype=type).reshape(-1, 3)
    return Mesh(as_numbers(found["v"], kind), as_numbers(found["vn"], "f4"), numbers[:, :, 0] - 1)


def glb_parts(path):
    """The JSON and the chunk of data."""
    data = open(path, "rb").read()
    magic, version, length, json_bytes, json_type = struct.unpack_from("<5I", data)
    assert (magic, version, length, json_type) == (0x46546C67, 2, len(data), 0x4E4F534A)
    scene = json.loads(data[20 : 20 + json_bytes])
    if 20 + json_bytes == length:
        return scene, b""
    bin_bytes, bin_type = struct.unpack_from("<2I", data, 20 + json_bytes)
    assert bin_type == 0x004E4942 and 28 + json_bytes + bin_bytes == length
    assert json_bytes % 4 == 0 and bin_bytes % 4 == 0
    assert scene["buffers"][0] == {"byteLength": bin_bytes}
    return scene, data[28 + json_bytes :]


def read_glb(path):
    scene, data = glb_parts(path)
    assert scene["asset"]["extras"] == {"units": "millimetres", "space": "LPS"}
    if "meshes" not in scene:
        assert not data and "nodes" not in scene
        return Mesh(np.zeros((0, 3), "f4"), np.zeros((0, 3), "f4"), np.zeros((0, 3), "u4"))
    assert len(scene["buffers"]) == 1

    def accessor(number):
        about = scene["accessors"][number]
        view = scene["bufferViews"][about["bufferView"]]
        kind, size = {5126: ("<f4", 4), 5125: ("<u4", 4)}[about["componentType"]]
        width = {"SCALAR": 1, "VEC3": 3}[about["type"]]
        stride = view.get("byteStride", size * width)
        offset = about.get("byteOffset", 0)
        assert offset + stride * (about["count"] - 1) + size * width <= view["byteLength"]
        assert view["byteOffset"] + view["byteLength"] <= len(data)
        found = np.ndarray((about["count"], width), kind, data, view["byteOffset"] + offset,
                           (stride, size))
        if "min" in about:
            assert found.min(0).tolist() == about["min"] and found.max(0).tolist() == about["max"]
        return found

    (mesh,), (node,) = scene["meshes"], scene["nodes"]
    (primitive,) = mesh["primitives"]
    assert primitive["mode"] == 4 and "min" in scene["accessors"][0]
    names = primitive["attributes"]
    positions = accessor(names["POSITION"])
    if "translation" in node:
        move = np.array(node["translation"])
        assert (move == move.astype("f4")).all()  # exact for readers of single precision too
        positions = positions + move
    values = accessor(names["_VALUE"])[:, 0] if "_VALUE" in names else None
    return Mesh(positions, accessor(names["NORMAL"]), accessor(primitive["indices"]).reshape(-1, 3),
                values)


def read_meshopt(path):
    """Unpacked by meshoptimizer: for each primitive its vertices and triangles, as one mesh."""
    library = ctypes.CDLL("libmeshoptimizer.so.2d")
    extension = "EXT_meshopt_compression"
    scene, data = glb_parts(path)
    assert scene["asset"]["extras"] == {"units": "millimetres", "space": "LPS"}
    if "meshes" not in scene:
        assert not data and "extensionsRequired" not in scene
        return Mesh(np.zeros((0, 3), "f4"), np.zeros((0, 3), "f4"), np.zeros((0, 3), "u4")), None, 0
    assert scene["extensionsRequired"] == scene["extensionsUsed"] == [
        extension, "KHR_mesh_quantization"]
    ends = [0] * len(scene["buffers"])  # views lie one behind the other
    for buffer in scene["buffers"][1:]:
        assert buffer["extensions"] == {extension: {"fallback": True}}

    def unpack(number):
        view = scene["bufferViews"][number]
        packed = view["extensions"][extension]
        count, stride, offset = packed["count"], packed["byteStride"], packed["byteOffset"]
        size = packed["byteLength"]
        assert view["byteLength"] == count * stride
        for buffer, begin, length in ((view["buffer"], view["byteOffset"], view["byteLength"]),
                                      (packed["buffer"], offset, (size + 3) // 4 * 4)):
            assert begin == ends[buffer] and begin % 4 == 0
            ends[buffer] += length
            assert ends[buffer] <= scene["buffers"][buffer]["byteLength"]
        out = ctypes.create_string_buffer(count * stride)
        size_t = ctypes.c_size_t
        arguments = (out, size_t(count), size_t(stride), data[offset : offset + size], size_t(size))
        if packed["mode"] == "TRIANGLES":
            assert data[offset] == 0xE1 and "byteStride" not in view and view["target"] == 34963
            assert library.meshopt_decodeIndexBuffer(*arguments) == 0
            return out.raw
        assert packed["mode"] == "ATTRIBUTES" and view["byteStride"] == stride
        assert data[offset] == 0xA0 and view["target"] == 34962
        assert library.meshopt_decodeVertexBuffer(*arguments) == 0
        filters = {"EXPONENTIAL": library.meshopt_decodeFilterExp,
                   "OCTAHEDRAL": library.meshopt_decodeFilterOct}
        if "filter" in packed:
            filters[packed["filter"]](out, size_t(count), size_t(stride))
        return out.raw

    def attribute(number, kind, width, stored):
        about = scene["accessors"][number]
        assert about["componentType"] == {"<f4": 5126, "<i2": 5122, "<u4": 5125}[kind]
        values = np.frombuffer(unpack(about["bufferView"]), kind).reshape(-1, stored)[:, :width]
        assert len(values) == about["count"] and about.get("normalized", False) == (kind == "<i2")
        if "min" in about:
            assert values.min(0).tolist() == about["min"]
            assert values.max(0).tolist() == about["max"]
        return values

    (mesh,), (node,) = scene["meshes"], scene["nodes"]
    move = np.array(node.get("translation", [0, 0, 0]))
    assert (move == move.astype("f4")).all()
    parts, first = [], 0
    for primitive in mesh["primitives"]:
        names = primitive["attributes"]
        positions = attribute(names["POSITION"], "<f4", 3, 3)
        normals = attribute(names["NORMAL"], "<i2", 3, 4) / 32767
        values = attribute(names["_VALUE"], "<f4", 1, 1) if "_VALUE" in names else None
        corners = attribute(primitive["indices"], "<u4", 1, 1).reshape(-1, 3)
        assert np.bincount(corners.ravel(), minlength=len(positions)).min() > 0
        parts.append((positions, normals, corners + first, values))
        first += len(positions)
    assert ends[1:] == [buffer["byteLength"] for buffer in scene["buffers"][1:]]
    assert ends[0] == len(data)
    positions, normals, triangles = (np.concatenate([part[i] for part in parts]) for i in range(3))
    values = None if parts[0][3] is None else np.concatenate([part[3] for part in parts])[:, 0]
    return Mesh(positions.astype("f8") + move, normals, triangles, values), move, len(parts)


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
                  ("--iso", "0", "--level", "1", "--attribute", "waves.isb")):
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


def read_vtp(path):
    data = open(path, "rb").read()
    begin = data.index(b'<AppendedData encoding="raw">')
    begin = data.index(b"_", begin) + 1
    end = data.rindex(b"\n</AppendedData>")
    head = data[: data.index(b"<AppendedData")]
    assert b"LPS, their unit is millimetres" in head
    root = xml.fromstring(head + b"</VTKFile>")
    assert root.get("header_type") == "UInt64" and root.get("byte_order") == "LittleEndian"
    piece = root.find("PolyData/Piece")
    kinds = {"Float32": "<f4", "Float64": "<f8", "UInt8": "u1", "Int32": "<i4", "Int64": "<i8"}
    last = 0

    def array(group, name):
        nonlocal last
        (about,) = [a for a in piece.find(group) if a.get("Name") == name]
        at = begin + int(about.get("offset"))
        if root.get("compressor") is None:
            (size,) = struct.unpack_from("<Q", data, at)
            plain, at = data[at + 8 : at + 8 + size], at + 8 + size
            assert len(plain) == size
        else:
            assert root.get("compressor") == "vtkZLibDataCompressor"
            blocks, block_bytes, rest = struct.unpack_from("<3Q", data, at)
            sizes = struct.unpack_from(f"<{blocks}Q", data, at + 24)
            at += 24 + 8 * blocks
            parts = []
            for number, size in enumerate(sizes):
                parts.append(zlib.decompress(data[at : at + size]))
                is_last = number + 1 == blocks and rest != 0
                assert len(parts[-1]) == (rest if is_last else block_bytes)
                at += size
            plain = b"".join(parts)
        last = max(last, at)
        return np.frombuffer(plain, kinds[about.get("type")])

    triangles = array("Polys", "connectivity").reshape(-1, 3)
    ends = array("Polys", "offsets")
    assert ends.dtype == triangles.dtype
    np.testing.assert_array_equal(ends, 3 * np.arange(1, len(triangles) + 1))
    positions = array("Points", "Points").reshape(-1, 3)
    normals = array("PointData", "Normals").reshape(-1, 3)
    levels = array("CellData", "level")
    has_values = piece.find("PointData").get("Scalars") == "value"
    values = array("PointData", "value") if has_values else None
    assert last == end, "bytes that belong to no array"
    assert int(piece.get("NumberOfPoints")) == len(positions)
    assert int(piece.get("NumberOfPolys")) == len(triangles)
    return Mesh(positions, normals, triangles, values, levels)


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
        if place is OBLIQUE:  # its OBJ reader knows floats only
            expect_same(mesh_of(read(vtkOBJReader(), "m.obj")), ply)
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
