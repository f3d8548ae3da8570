"""Readers of mesh files, written from the specifications of their formats."""
import ctypes
import json
import struct
import zlib
import xml.etree.ElementTree as xml

import numpy as np


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
                next((v[name] for name in ("value", "component") if name in v.dtype.names), None),
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
    name = next((name for name in ("_VALUE", "_COMPONENT") if name in names), None)
    values = accessor(names[name])[:, 0] if name else None
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
        name = next((name for name in ("_VALUE", "_COMPONENT") if name in names), None)
        values = attribute(names[name], "<f4", 1, 1) if name else None
        corners = attribute(primitive["indices"], "<u4", 1, 1).reshape(-1, 3)
        assert np.bincount(corners.ravel(), minlength=len(positions)).min() > 0
        parts.append((positions, normals, corners + first, values))
        first += len(positions)
    assert ends[1:] == [buffer["byteLength"] for buffer in scene["buffers"][1:]]
    assert ends[0] == len(data)
    positions, normals, triangles = (np.concatenate([part[i] for part in parts]) for i in range(3))
    values = None if parts[0][3] is None else np.concatenate([part[3] for part in parts])[:, 0]
    return Mesh(positions.astype("f8") + move, normals, triangles, values), move, len(parts)


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
    kinds = {"Float32": "<f4", "Float64": "<f8", "UInt8": "u1", "UInt32": "<u4", "Int32": "<i4", "Int64": "<i8"}
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
    scalars = piece.find("PointData").get("Scalars")
    values = array("PointData", scalars) if scalars else None
    assert last == end, "bytes that belong to no array"
    assert int(piece.get("NumberOfPoints")) == len(positions)
    assert int(piece.get("NumberOfPolys")) == len(triangles)
    return Mesh(positions, normals, triangles, values, levels)
