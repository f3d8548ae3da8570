#!/usr/bin/python3
"""Volumes that isobrick wrote, read by other programs' libraries, and the other way round.

    interchange_test.py ISOBRICK nifti|components|zarr|zarr3|hdf5|vdb|dicom|tiff|others|vtk|real|real_whole

Every voxel of every level is compared, and what the libraries make of spacing, origin and direction.
"""
import gzip
import itertools
import json
import os
import shutil
import struct
import subprocess
import sys
import tempfile
import zlib

import numpy as np

sys.dont_write_bytecode = True  # beside the sources
from interchange_common import ISOBRICK, ORIGIN, SPACING, rotation, run, write_nrrd

SHAPE = (13, 70, 67)  # z, y, x: odd, and more than a chunk along two axes
TYPES = {"u8": "u1", "i8": "i1", "u16": "<u2", "i16": "<i2", "f32": "<f4"}


def voxels(kind, shape=SHAPE, seed=1):
    random = np.random.default_rng(seed)
    if kind == "f32":
        return random.normal(0, 1000, shape).astype("<f4")
    info = np.iinfo(TYPES[kind])
    values = random.integers(info.min, info.max, shape, endpoint=True).astype(TYPES[kind])
    values[:, 40:, 40:] = 0  # something for sparse formats to leave out
    return values


def raw_of(path, *words):
    """The voxels that isobrick reads, and what it says of them."""
    about = run("convert", path, "-o", "read.raw", "--force", "--json", *words)
    kind = {"uint8": "u1", "int8": "i1", "uint16": "<u2", "int16": "<i2", "float32": "<f4"}
    shape = about["dimensions"][::-1]
    return np.fromfile("read.raw", kind[about["voxel_type"]]).reshape(shape), about


def expect_same(found, expected):
    assert found.dtype == expected.dtype, (found.dtype, expected.dtype)
    np.testing.assert_array_equal(found, expected)


def expect_placed(about, direction=np.eye(3), spacing=SPACING, origin=ORIGIN, tolerance=1e-9):
    np.testing.assert_allclose(about["spacing"], spacing, rtol=tolerance)
    np.testing.assert_allclose(about["origin"], origin, rtol=tolerance)
    np.testing.assert_allclose(np.array(about["direction"]).T, direction, atol=tolerance)


def pyramid_levels(values):
    """All levels as isobrick builds them, by way of a format that is tested elsewhere."""
    write_nrrd("levels.nrrd", values)
    run("build", "levels.nrrd", "-o", "levels.isb", "--force")
    count = len(run("info", "levels.isb", "--json")["levels"])
    return [raw_of("levels.isb", "--level", str(level))[0] for level in range(count)]


def test_nifti():
    import nibabel

    places = (np.eye(3), rotation(), rotation() * [1, 1, -1], np.diag([-1.0, -1.0, 1.0]))
    for kind, direction in itertools.chain(
        zip(TYPES, itertools.cycle(places)), (("i16", place) for place in places)
    ):
        values = voxels(kind)
        write_nrrd("in.nrrd", values, direction)
        lps_to_ras = np.diag([-1.0, -1.0, 1.0])
        expected = np.eye(4)
        expected[:3, :3] = lps_to_ras @ direction @ np.diag(SPACING)
        expected[:3, 3] = lps_to_ras @ ORIGIN
        for name in ("out.nii", "out.nii.gz"):
            run("convert", "in.nrrd", "-o", name, "--force")
            image = nibabel.load(name)
            expect_same(np.asanyarray(image.dataobj).T, values)
            np.testing.assert_allclose(image.get_sform(), expected, atol=1e-4)
            np.testing.assert_allclose(image.get_qform(), expected, atol=1e-4)
            assert image.header.get_xyzt_units()[0] == "mm"
        # Theirs, read by us, in each of its units.
        for unit, scale in (("micron", 1e3), ("meter", 1), ("mm", 1), ("unknown", 1)):
            places = expected.copy()
            places[:3] *= scale
            image = nibabel.Nifti1Image(values.T, places)
            image.header.set_xyzt_units(unit)
            image.to_filename("theirs.nii.gz")
            found, about = raw_of("theirs.nii.gz")
            expect_same(found, values)
            in_mm = 1e3 if unit == "meter" else 1
            expect_placed(about, direction, SPACING * in_mm, ORIGIN * in_mm, tolerance=1e-5)
            assert about["length_unit"] == ("unknown" if unit == "unknown" else "millimetres"), about
        run("convert", "theirs.nii.gz", "-o", "out.nii.gz", "--force")
        assert nibabel.load("out.nii.gz").header.get_xyzt_units()[0] == "unknown"
    # What can only be read in order, into formats that want boxes.
    for name in ("boxes.ome.zarr", "boxes.h5", "boxes.vdb"):
        run("convert", "theirs.nii.gz", "-o", name)
        found, about = raw_of(name)
        np.testing.assert_array_equal(found, values)
        expect_placed(about, direction, tolerance=1e-5)


def test_zarr():
    import numcodecs
    import zarr

    # Ours, read by them: every level of every type.
    for kind in TYPES:
        values = voxels(kind)
        levels = pyramid_levels(values)
        run("convert", "levels.isb", "-o", "out.ome.zarr", "--levels", "all", "--force")
        image = zarr.open("out.ome.zarr", "r")
        (scales,) = image.attrs["multiscales"]
        assert scales["version"] == "0.4" and len(scales["datasets"]) == len(levels)
        assert [axis["name"] for axis in scales["axes"]] == ["z", "y", "x"]
        assert [axis["unit"] for axis in scales["axes"]] == ["millimeter"] * 3
        for level, (dataset, expected) in enumerate(zip(scales["datasets"], levels)):
            expect_same(image[dataset["path"]][...], expected)
            scale, translation = dataset["coordinateTransformations"]
            np.testing.assert_allclose(scale["scale"], SPACING[::-1] * 2**level)
            np.testing.assert_allclose(translation["translation"], ORIGIN[::-1])
            # Ours, read by us.
            found, about = raw_of(f"out.ome.zarr/{level}")
            expect_same(found, expected)
            expect_placed(about, spacing=SPACING * 2**level)
    # A direction comes back, and is warned of.
    write_nrrd("in.nrrd", values, rotation())
    result = run("convert", "in.nrrd", "-o", "turned.ome.zarr")
    assert "direction" in result.stderr
    found, about = raw_of("turned.ome.zarr")
    expect_same(found, values)
    expect_placed(about, rotation())

    # Theirs, read by us: compressors, orders, separators, byte orders, missing chunks.
    compressors = [
        None,
        numcodecs.Blosc("lz4", shuffle=numcodecs.Blosc.SHUFFLE),
        numcodecs.Blosc("lz4hc", shuffle=numcodecs.Blosc.BITSHUFFLE),
        numcodecs.Blosc("zlib"),
        numcodecs.Blosc("zstd", shuffle=numcodecs.Blosc.NOSHUFFLE),
        numcodecs.Zlib(),
        numcodecs.GZip(),
        numcodecs.Zstd(),
    ]
    for number, (compressor, order, separator) in enumerate(
        itertools.product(compressors, "CF", "./")
    ):
        kind = ["<u2", ">u2", "|i1", ">f4", "<f4"][number % 5]
        values = (voxels("i16") % 127).astype(kind)
        values[:7, :20, :30] = 9
        shutil.rmtree("theirs.zarr", ignore_errors=True)
        array = zarr.open(
            zarr.DirectoryStore("theirs.zarr", dimension_separator=separator),
            mode="w", shape=values.shape, chunks=(7, 20, 30), dtype=kind, order=order,
            compressor=compressor, fill_value=9, write_empty_chunks=False,
        )
        array[...] = values
        assert array.nchunks_initialized < array.nchunks
        found, about = raw_of("theirs.zarr")
        expect_same(found, values.astype(values.dtype.newbyteorder("<")))
        assert "no spacing" in str(about["notes"])
    for kind in ("<u4", "<i8", "<f8", "|b1"):
        values = voxels("u8").astype(kind)
        zarr.save_array("wide.zarr", values)
        found, _ = raw_of("wide.zarr")
        np.testing.assert_array_equal(found, values.astype("f4" if kind != "|b1" else "u1"))

    # Five axes: time steps and channels are chosen.
    values = np.stack([np.stack([voxels("u8", (5, 6, 7), 10 * t + c) for c in range(3)]) for t in range(2)])
    group = zarr.open_group("five.zarr", "w")
    group.create_dataset("s0", data=values, chunks=(1, 2, 3, 4, 5))
    names = ["t", "c", "z", "y", "x"]
    transform = lambda path: {
        "path": path,
        "coordinateTransformations": [
            {"type": "scale", "scale": [1, 1, 3, 2, 1]},
            {"type": "translation", "translation": [0, 0, 30, 20, 10]},
        ],
    }
    def image(path):
        group.attrs["multiscales"] = [{
            "version": "0.4",
            "axes": [{"name": n, "unit": "micrometer"} if n in "zyx" else {"name": n} for n in names],
            "datasets": [transform(path)],
            "coordinateTransformations": [{"type": "scale", "scale": [1, 1, 2, 2, 2]}],
        }]
    image("s0")
    found, about = raw_of("five.zarr")
    expect_same(found, values[0, 0])
    assert "of 3 channels, the first" in str(about["notes"])
    expect_placed(about, spacing=[2e-3, 4e-3, 6e-3], origin=[20e-3, 40e-3, 60e-3])
    assert "micrometer" in str(about["notes"]) and about["length_unit"] == "millimetres"
    found, _ = raw_of("five.zarr", "--time", "1", "--channel", "2")
    expect_same(found, values[1, 2])
    run("convert", "five.zarr", "-o", "x.raw", "--channel", "3", fails_with="0 to 2")

    # Tricks: names that lead out of the store, sizes that are not possible.
    for path in ("../wide.zarr", "/etc", "s0/../../wide.zarr", "", "."):
        image(path)
        run("convert", "five.zarr", "-o", "x.raw", fails_with="leads out of the store")
    def metadata(**changes):
        with open("theirs.zarr/.zarray") as file:
            good = json.load(file)
        os.makedirs("bad.zarr", exist_ok=True)
        with open("bad.zarr/.zarray", "w") as file:
            json.dump({**good, **changes}, file)
    for changes, message in (
        ({"chunks": [1 << 39, 1 << 39, 1 << 39]}, "too large"),
        ({"chunks": [1 << 12, 1 << 12, 1 << 12]}, "1 GiB"),
        ({"chunks": [0, 1, 1]}, "chunks"),
        ({"chunks": [-1, 1, 1]}, "chunks"),
        ({"chunks": [1, 1]}, "different numbers"),
        ({"shape": [1 << 40, 1 << 40, 1 << 40]}, "at most"),
        ({"shape": [1e300, 2, 2]}, "shape"),
        ({"shape": []}, "shape"),
        ({"dtype": "<c8"}, "type"),
        ({"dtype": [["a", "<u2"]]}, "dtype"),
        ({"order": "Q"}, "order"),
        ({"compressor": {"id": "bz2"}}, "bz2"),
        ({"filters": [{"id": "delta"}]}, "filters"),
        ({"dimension_separator": "/../"}, "separator"),
        ({"fill_value": "abc"}, "fill_value"),
        ({"fill_value": 70000}, "fill_value"),
        ({"fill_value": 0.5}, "fill_value"),
        ({"fill_value": "NaN"}, "fill_value"),
        ({"shape": [1 << 20] * 3}, "not enough space"),
        ({"zarr_format": 7}, "zarr_format"),
    ):
        metadata(**changes)
        run("convert", "bad.zarr", "-o", "x.raw", fails_with=message)
    # Chunks that are cut short or damaged; BloscLZ is refused.
    zarr.save_array("cut.zarr", voxels("u8", (4, 4, 4)), compressor=numcodecs.Blosc("lz4"))
    with open("cut.zarr/0.0.0", "rb") as file:
        chunk = file.read()
    for length in range(len(chunk)):
        with open("cut.zarr/0.0.0", "wb") as file:
            file.write(chunk[:length])
        run("convert", "cut.zarr", "-o", "x.raw", fails_with="cut.zarr/0.0.0")
    zarr.save_array("lz.zarr", np.zeros((40, 40, 40), "u2") + 7, compressor=numcodecs.Blosc("blosclz"))
    run("convert", "lz.zarr", "-o", "x.raw", fails_with="BloscLZ")


def crc32c(data):
    crc = 0xFFFFFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0x82F63B78 if crc & 1 else 0)
    return (crc ^ 0xFFFFFFFF).to_bytes(4, "little")


def write_zarr3(folder, values, chunk, shard=None, order=None, endian="little", codec=None,
                checksum=False, index_location="end", separator="/"):
    """Zarr 3 from its specification: Debian has no library that writes it."""
    import numcodecs

    pack = {None: lambda b: b, "gzip": numcodecs.GZip().encode, "zstd": numcodecs.Zstd().encode,
            "blosc": numcodecs.Blosc("lz4").encode}[codec]
    codecs = []
    if order:
        codecs.append({"name": "transpose", "configuration": {"order": order}})
    codecs.append({"name": "bytes", "configuration": {"endian": endian}})
    if codec:
        codecs.append({"name": codec, "configuration": {}})
    if checksum:
        codecs.append({"name": "crc32c"})

    def block(index, size):
        full = np.zeros(size, values.dtype)
        part = values[tuple(slice(i * n, (i + 1) * n) for i, n in zip(index, size))]
        full[tuple(slice(0, n) for n in part.shape)] = part
        return full

    def packed(full):
        if order:
            full = full.transpose(order)
        kind = full.dtype.newbyteorder("<" if endian == "little" else ">")
        data = bytes(pack(np.ascontiguousarray(full.astype(kind)).tobytes()))
        return data + crc32c(data) if checksum else data

    outer = shard or chunk
    counts = [-(-n // size) for n, size in zip(values.shape, outer)]
    for index in itertools.product(*(range(n) for n in counts)):
        full = block(index, outer)
        if not full.any():
            continue  # missing: the fill value
        data = b""
        if shard:
            inner = [n // size for n, size in zip(shard, chunk)]
            index_bytes = int(np.prod(inner)) * 16 + 4
            start = index_bytes if index_location == "start" else 0
            table = b""
            for at in itertools.product(*(range(n) for n in inner)):
                part = full[tuple(slice(i * n, (i + 1) * n) for i, n in zip(at, chunk))]
                if not part.any():
                    table += b"\xff" * 16
                    continue
                one = packed(part)
                table += (start + len(data)).to_bytes(8, "little") + len(one).to_bytes(8, "little")
                data += one
            table += crc32c(table)
            data = table + data if index_location == "start" else data + table
        else:
            data = packed(full)
        path = f"{folder}/c{separator}" + separator.join(str(i) for i in index)
        os.makedirs(os.path.dirname(path), exist_ok=True)
        with open(path, "wb") as file:
            file.write(data)
    if shard:
        codecs = [{"name": "sharding_indexed", "configuration": {
            "chunk_shape": chunk, "codecs": codecs, "index_location": index_location,
            "index_codecs": [{"name": "bytes", "configuration": {"endian": "little"}}, {"name": "crc32c"}],
        }}]
    with open(f"{folder}/zarr.json", "w") as file:
        json.dump({
            "zarr_format": 3, "node_type": "array", "shape": values.shape,
            "data_type": values.dtype.name, "fill_value": 0, "codecs": codecs, "attributes": {},
            "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": outer}},
            "chunk_key_encoding": {"name": "default", "configuration": {"separator": separator}},
        }, file)


def test_zarr3():
    values = voxels("i16", (9, 33, 29))
    values[:4, :16, :16] = 0
    for number, options in enumerate((
        {}, {"codec": "gzip"}, {"codec": "zstd", "checksum": True}, {"codec": "blosc"},
        {"order": [2, 0, 1]}, {"endian": "big", "separator": "."}, {"checksum": True},
        {"shard": [8, 32, 32]}, {"shard": [8, 32, 32], "codec": "zstd", "checksum": True},
        {"shard": [4, 16, 32], "index_location": "start", "order": [1, 2, 0], "codec": "gzip"},
    )):
        store = f"three{number}.zarr"
        os.makedirs(f"{store}/0")
        write_zarr3(f"{store}/0", values, [4, 16, 16], **options)
        with open(f"{store}/zarr.json", "w") as file:
            json.dump({"zarr_format": 3, "node_type": "group", "attributes": {"ome": {
                "version": "0.5", "multiscales": [{
                    "axes": [{"name": n, "type": "space"} for n in "zyx"],
                    "datasets": [{"path": "0", "coordinateTransformations": [
                        {"type": "scale", "scale": [3, 2, 1]}]}]}]}}}, file)
        found, about = raw_of(store)
        expect_same(found, values)
        expect_placed(about, spacing=[1, 2, 3], origin=[0, 0, 0])
    # The last is sharded with its index in front: no byte of it may be trusted.
    files = [f"{folder}/{name}" for folder, _, names in os.walk(f"{store}/0/c") for name in names]
    with open(files[0], "rb") as file:
        whole = file.read()
    for at in range(0, 36):  # two rows and their checksum
        with open(files[0], "wb") as file:
            file.write(whole[:at] + bytes([whole[at] ^ 0x40]) + whole[at + 1 :])
        run("convert", store, "-o", "x.raw", fails_with=files[0])
    for length in range(0, len(whole), max(1, len(whole) // 10)):
        with open(files[0], "wb") as file:
            file.write(whole[:length])
        run("convert", store, "-o", "x.raw", fails_with=files[0])


def test_hdf5():
    import h5py

    for kind in TYPES:
        values = voxels(kind)
        write_nrrd("in.nrrd", values, rotation())
        run("convert", "in.nrrd", "-o", "out.h5:/entry/data", "--force")
        with h5py.File("out.h5") as file:
            data = file["entry/data"]
            expect_same(data[...], values)
            assert data.chunks == (13, 64, 64)
            np.testing.assert_allclose(data.attrs["spacing"], SPACING)
            assert data.attrs["length_unit"] == b"millimetres", data.attrs["length_unit"]
            np.testing.assert_allclose(data.attrs["origin"], ORIGIN)
            np.testing.assert_allclose(data.attrs["direction"].reshape(3, 3).T, rotation())
        for name in ("out.h5:/entry/data", "out.h5"):
            found, about = raw_of(name)
            expect_same(found, values)
            expect_placed(about, rotation())
    # A dataset goes into a file of others', of which all else stays; and takes the place of one.
    theirs = np.arange(24.0).reshape(2, 3, 4)
    with h5py.File("results.h5", "w", libver="latest") as file:
        file.attrs["experiment"] = "seven"
        file["entry/theirs"] = theirs
        file["entry/theirs"].attrs["unit"] = "counts"
        file["entry/soft"] = h5py.SoftLink("/entry/theirs")
        file["entry/elsewhere"] = h5py.ExternalLink("out.h5", "/entry")
    for seed, words in ((1, ()), (2, ("--force",))):
        values = voxels("u16", seed=seed)
        write_nrrd("in.nrrd", values, rotation())
        run("convert", "in.nrrd", "-o", "results.h5:/entry/ours", *words)
        with h5py.File("results.h5") as file:
            expect_same(file["entry/ours"][...], values)
            expect_same(file["entry/theirs"][...], theirs)
            assert sorted(file["entry"]) == ["elsewhere", "ours", "soft", "theirs"]
            assert file.attrs["experiment"] == "seven"
            assert file["entry/soft"].attrs["unit"] == "counts"
    run("convert", "in.nrrd", "-o", "results.h5:/entry/elsewhere/data", "--force",
        fails_with="in another file")
    with h5py.File("results.h5", "a"):
        run("convert", "in.nrrd", "-o", "results.h5:/more", fails_with="open for writing")
    values = voxels("i16")
    for options in (
        {}, {"chunks": (3, 20, 30)}, {"compression": "gzip"}, {"compression": "lzf"},
        {"compression": "gzip", "shuffle": True, "fletcher32": True},
        {"dtype": ">i2"}, {"dtype": "<i4"}, {"dtype": "<f8"}, {"dtype": ">f4"},
    ):
        with h5py.File("theirs.h5", "w") as file:
            stored = file.create_dataset("a/b", data=values, **options)
            stored.attrs["element_size_um"] = [3.0, 2.0, 1.0]
        if options.get("compression") == "lzf":  # only h5py has it
            run("convert", "theirs.h5", "-o", "x.raw", fails_with="lzf")
            continue
        found, about = raw_of("theirs.h5:/a/b")
        np.testing.assert_array_equal(found, values)
        np.testing.assert_allclose(about["spacing"], [0.001, 0.002, 0.003])
        assert about["length_unit"] == "millimetres"
    # Chunks that were never written are counted.
    with h5py.File("sparse.h5", "w") as file:
        sparse = file.create_dataset("a", values.shape, values.dtype, chunks=(13, 20, 30), fillvalue=7)
        sparse[:, :20, :30] = values[:, :20, :30]
        chunks = np.prod([-(-n // size) for n, size in zip(values.shape, (13, 20, 30))])
    found, about = raw_of("sparse.h5")
    assert (found[:, 20:] == 7).all()
    assert f"{chunks - 1} of the {chunks} chunks" in str(about["notes"]), about
    # What a virtual dataset takes from a file that is not there is no fill value.
    layout = h5py.VirtualLayout(values.shape, values.dtype)
    for part, rows in (("low", slice(0, 5)), ("high", slice(5, None))):
        with h5py.File(f"{part}.h5", "w") as file:
            file["a"] = values[rows]
        layout[rows] = h5py.VirtualSource(f"{part}.h5", "a", values[rows].shape)
    with h5py.File("virtual.h5", "w") as file:
        file.create_virtual_dataset("a", layout)
    expect_same(raw_of("virtual.h5")[0], values)
    with h5py.File("high.h5", "w") as file:
        file["b"] = values[5:]
    run("convert", "virtual.h5", "-o", "x.raw", fails_with="high.h5")
    os.remove("high.h5")
    run("convert", "virtual.h5", "-o", "x.raw", fails_with="high.h5")
    os.symlink("../.git/annex/objects/x", "high.h5")
    run("convert", "virtual.h5", "-o", "x.raw", fails_with="git annex get")
    with h5py.File("many.h5", "w") as file:
        file["one"] = values
        file["two"] = values > 0
        file["flat"] = values[0]
        file["four"] = np.stack([values, values + 1])
        file["thin"] = values[None, None]
    run("convert", "many.h5", "-o", "x.raw", fails_with="'/one'")
    run("convert", "many.h5:/three", "-o", "x.raw", fails_with="'/two'")
    run("convert", "many.h5:/flat", "-o", "x.raw", fails_with="three")
    run("convert", "many.h5:/four", "-o", "x.raw", fails_with="--select channel=N")
    expect_same(raw_of("many.h5:/four", "--channel", "1")[0], values + 1)
    expect_same(raw_of("many.h5:/two")[0], (values > 0).astype("u1"))
    expect_same(raw_of("many.h5:/thin")[0], values)
    with h5py.File("small.h5", "w") as file:
        file.create_dataset("a", data=voxels("u8", (4, 4, 4)), chunks=(2, 2, 2), compression="gzip")
    with open("small.h5", "rb") as file:
        whole = file.read()
    for length in range(0, len(whole), 97):
        with open("cut.h5", "wb") as file:
            file.write(whole[:length])
        run("convert", "cut.h5", "-o", "x.raw", fails_with="cut.h5")


def test_vdb():
    import pyopenvdb as vdb

    # Ours, read by them, all levels.
    for kind in TYPES:
        values = voxels(kind)
        levels = pyramid_levels(values)
        run("convert", "levels.isb", "-o", "out.vdb", "--levels", "all", "--force")
        for level, expected in enumerate(levels):
            grid = vdb.read("out.vdb", "density" + (f"_level{level}" if level else ""))
            found = np.full(expected.shape[::-1], np.nan, "f4")
            grid.copyToArray(found)
            np.testing.assert_array_equal(found.T, expected.astype("f4"))
            assert grid.activeVoxelCount() == np.count_nonzero(expected)
            assert grid.background == 0
            said = {key: grid.metadata[f"isobrick:{key}"] for key in ("level", "filter", "source")}
            assert said["level"] == level and said["filter"] == "average", said
            assert grid.metadata["isobrick:length_unit"] == "millimetres"
            assert said["source"].endswith("levels.isb"), said
            at = np.array([grid.transform.indexToWorld(corner) for corner in ((0, 0, 0), (1, 2, 3))])
            np.testing.assert_allclose(at[0], ORIGIN)
            np.testing.assert_allclose(at[1], ORIGIN + SPACING * 2**level * [1, 2, 3])
            # Ours, read by us: with the same dimensions, the inactive rim too.
            found, about = raw_of("out.vdb", *(["--grid", f"density_level{level}"] if level else []))
            np.testing.assert_array_equal(found, expected.astype("f4"))
            expect_placed(about, spacing=SPACING * 2**level)
    write_nrrd("in.nrrd", values, rotation())
    run("convert", "in.nrrd", "-o", "turned.vdb")
    found, about = raw_of("turned.vdb")
    np.testing.assert_array_equal(found, values)
    expect_placed(about, rotation())
    run("convert", "in.nrrd", "-o", "x.vdb", "--memory", "17M", "--threads", "1", fails_with="MiB")

    # vdb -> isb -> vdb: values, active mask, background, class, name, transform.
    fog = vdb.FloatGrid(0.25)
    fog.name, fog.gridClass = "smoke", vdb.GridClass.FOG_VOLUME
    random = np.random.default_rng(3)
    block = random.integers(1, 100, (30, 20, 17)).astype("f4")
    block[block < 30] = 0.25
    fog.copyFromArray(block, ijk=(-21, 5, 1003))
    fog.prune()
    fog.transform = vdb.createLinearTransform(
        [[0.5, 0, 0, 0], [0, 0, 0.7, 0], [0, -0.6, 0, 0], [5, -3, 1, 1]]
    )
    ball = vdb.createLevelSetSphere(7.3, (3, 4, 5), 0.5, 3.0)
    ball.name = "ball"
    mask = vdb.BoolGrid()
    mask.name = "mask"
    mask.fill((1, 2, 3), (9, 9, 9), True)
    vdb.write("theirs.vdb", [ball, fog, mask])
    for grid in (ball, fog):
        run("build", "theirs.vdb", "--grid", grid.name, "-o", "back.isb", "--force")
        run("convert", "back.isb", "-o", "back.vdb", "--force")
        back = vdb.read("back.vdb", grid.name)
        assert back.gridClass == grid.gridClass and back.background == grid.background
        for corner in ((0, 0, 0), (1, 2, 3)):
            np.testing.assert_allclose(
                back.transform.indexToWorld(corner), grid.transform.indexToWorld(corner), atol=1e-12
            )
        low, high = grid.evalActiveVoxelBoundingBox()
        # Where a voxel equals the background nothing says that it was active.
        accessor, other = grid.getConstAccessor(), back.getConstAccessor()
        for ijk in itertools.product(*(range(a - 1, b + 2) for a, b in zip(low, high))):
            value, active = accessor.probeValue(ijk)
            found, is_active = other.probeValue(ijk)
            assert found == value, (grid.name, ijk, found, value)
            assert is_active == (active and abs(value) != grid.background), (grid.name, ijk, value)
    about = run("build", "theirs.vdb", "-o", "first.isb", "--json")
    assert "of 3 grids, 'ball' was taken" in str(about) and "'smoke' (float)" in str(about), about
    found, about = raw_of("theirs.vdb", "--grid", "mask")
    assert about["voxel_type"] == "uint8" and found.sum() == 9 * 8 * 7
    run("convert", "theirs.vdb", "-o", "x.raw", "--grid", "fire", fails_with="'smoke' (float)")

    # A grid larger than memory is read slab by slab, and says the same.
    big = vdb.FloatGrid(0)
    big.name = "big"
    big.copyFromArray(random.normal(0, 1, (280, 250, 240)).astype("f4"), ijk=(-3, 2, 5))
    vdb.write("big.vdb", [big])
    def peak_of(name, memory):
        # By way of a shell: a process begins with the peak of the one that starts it.
        words = ["sh", "-c", '"$@"; exit $?', "sh", ISOBRICK, "convert", "big.vdb", "-o", name]
        words += ["--memory", memory, "--json"]
        return json.loads(subprocess.run(words, capture_output=True, check=True).stdout)[
            "peak_rss_bytes"
        ]
    whole, slabs = peak_of("whole.raw", "512M"), peak_of("slabs.raw", "40M")
    assert slabs < whole - (30 << 20) or "asan" in ISOBRICK, (whole, slabs)
    np.testing.assert_array_equal(np.fromfile("slabs.raw", "<f4"), np.fromfile("whole.raw", "<f4"))


def test_dicom():
    """Series as pydicom writes them, turned, in any order of names; their values rescaled."""
    import pydicom
    from pydicom.dataset import FileDataset, FileMetaDataset
    from pydicom.uid import CTImageStorage, ExplicitVRLittleEndian, RLELossless

    direction, shape = rotation(), (5, 31, 22)
    for number, (kind, slope, intercept) in enumerate(
        (("<i2", 1, 0), ("<u2", 1, -1024), ("u1", 1, 0), ("<i2", 0.25, 3))
    ):
        info = np.iinfo(kind)
        values = np.random.default_rng(number).integers(info.min // 2, info.max // 2, shape)
        values = values.astype(kind)
        os.makedirs(f"series{number}")
        for z in range(shape[0]):
            about = FileMetaDataset()
            about.MediaStorageSOPClassUID = CTImageStorage
            about.MediaStorageSOPInstanceUID = f"1.2.3.{number}.{z + 1}"
            about.TransferSyntaxUID = ExplicitVRLittleEndian
            slice = FileDataset("", {}, file_meta=about, preamble=b"\0" * 128)
            slice.is_little_endian, slice.is_implicit_VR = True, False
            slice.SOPClassUID, slice.SOPInstanceUID = CTImageStorage, about.MediaStorageSOPInstanceUID
            slice.Modality, slice.SeriesInstanceUID = "CT", f"1.2.3.{number}"
            slice.StudyInstanceUID, slice.InstanceNumber = "1.2.3", z + 1
            slice.Rows, slice.Columns = shape[1:]
            slice.SamplesPerPixel, slice.PhotometricInterpretation = 1, "MONOCHROME2"
            slice.BitsAllocated = slice.BitsStored = 8 * values.itemsize
            slice.HighBit, slice.PixelRepresentation = slice.BitsStored - 1, int(kind == "<i2")
            slice.PixelSpacing = [f"{SPACING[1]:.12g}", f"{SPACING[0]:.12g}"]  # between rows first
            slice.ImageOrientationPatient = [f"{n:.12g}" for n in direction[:, :2].T.ravel()]
            position = ORIGIN + direction[:, 2] * SPACING[2] * z
            slice.ImagePositionPatient = [f"{n:.12g}" for n in position]
            slice.RescaleSlope, slice.RescaleIntercept = str(slope), str(intercept)
            slice.PixelData = values[z].tobytes()
            if number == 0:
                slice.compress(RLELossless)
            slice.save_as(f"series{number}/{(z * 3) % 5}.dcm", write_like_original=False)
        found, about = raw_of(f"series{number}")
        np.testing.assert_array_equal(found, values * slope + intercept)
        assert about["voxel_type"] == ["int16", "int16", "uint8", "float32"][number], about
        expect_placed(about, direction, tolerance=1e-8)
        # The same voxels at the same places in every other format.
        run("convert", f"series{number}", "-o", f"{number}.nii.gz")
        again, place = raw_of(f"{number}.nii.gz")
        expect_same(again, found)
        expect_placed(place, direction, tolerance=1e-5)


def write_enhanced(path, values, frames, shared=None, syntax=None, **top):
    """An enhanced CT or MR file; `values` has a slice for each of `frames`: a dictionary with any of
    position, orientation, spacing, slope, intercept, stack, time, and echo; `shared` the same for all."""
    import pydicom
    from pydicom.dataset import Dataset, FileDataset, FileMetaDataset
    from pydicom.sequence import Sequence
    from pydicom.uid import EnhancedMRImageStorage, ExplicitVRLittleEndian

    def item(**elements):
        one = Dataset()
        for name, value in elements.items():
            setattr(one, name, value)
        return Sequence([one])

    text = lambda numbers: [f"{n:.12g}" for n in numbers]

    def groups(frame, is_frame):
        group = Dataset()
        if "position" in frame:
            group.PlanePositionSequence = item(ImagePositionPatient=text(frame["position"]))
        if "orientation" in frame:
            group.PlaneOrientationSequence = item(ImageOrientationPatient=text(frame["orientation"]))
        if "spacing" in frame:
            group.PixelMeasuresSequence = item(
                PixelSpacing=text(frame["spacing"][1::-1]),
                SliceThickness=f"{frame['spacing'][2]:.12g}")
        if "slope" in frame:
            group.PixelValueTransformationSequence = item(
                RescaleIntercept=str(frame.get("intercept", 0)), RescaleSlope=str(frame["slope"]),
                RescaleType="US")
        if is_frame:
            content = {}
            if "stack" in frame:
                content |= {"StackID": frame["stack"], "InStackPositionNumber": 1}
            if "time" in frame:
                content["TemporalPositionIndex"] = frame["time"]
            if "echo" in frame:
                content["DimensionIndexValues"] = [frame["echo"], 1]
            group.FrameContentSequence = item(**content)
        return group

    about = FileMetaDataset()
    about.MediaStorageSOPClassUID = EnhancedMRImageStorage
    about.MediaStorageSOPInstanceUID = "1.2.3.4"
    about.TransferSyntaxUID = ExplicitVRLittleEndian
    file = FileDataset("", {}, file_meta=about, preamble=b"\0" * 128)
    file.is_little_endian, file.is_implicit_VR = True, False
    file.SOPClassUID, file.SOPInstanceUID = EnhancedMRImageStorage, "1.2.3.4"
    file.Modality, file.StudyInstanceUID, file.SeriesInstanceUID = "MR", "1.2.3", "1.2.3.9"
    file.InstanceNumber, file.NumberOfFrames = 1, len(frames)
    file.Rows, file.Columns = values.shape[1:]
    file.SamplesPerPixel, file.PhotometricInterpretation = 1, "MONOCHROME2"
    file.BitsAllocated = file.BitsStored = 8 * values.itemsize
    file.HighBit, file.PixelRepresentation = file.BitsStored - 1, int(values.dtype.kind == "i")
    if any("echo" in frame for frame in frames):
        file.DimensionIndexSequence = Sequence([
            item(DimensionIndexPointer=0x00189082, FunctionalGroupPointer=0x00189114)[0],
            item(DimensionIndexPointer=0x00200032, FunctionalGroupPointer=0x00209113)[0]])
    if shared is not None:
        file.SharedFunctionalGroupsSequence = Sequence([groups(shared, False)])
    file.PerFrameFunctionalGroupsSequence = Sequence([groups(frame, True) for frame in frames])
    for name, value in top.items():
        setattr(file, name, value)
    file.PixelData = values.tobytes()
    if syntax == "implicit":
        about.TransferSyntaxUID = pydicom.uid.ImplicitVRLittleEndian
        file.is_implicit_VR = True
    elif syntax == "big":
        about.TransferSyntaxUID = pydicom.uid.ExplicitVRBigEndian
        file.is_little_endian = False
        file.PixelData = values.astype(values.dtype.newbyteorder(">")).tobytes()
    elif syntax is not None:
        file.compress(syntax)
    file.save_as(path, write_like_original=False)


def test_enhanced():
    """Enhanced multi-frame files as pydicom writes them: every frame with its own place and slope."""
    from pydicom.uid import RLELossless

    direction, shape = rotation(), (8, 11, 13)
    plane = {"orientation": direction[:, :2].T.ravel(), "spacing": SPACING}
    place = lambda z: ORIGIN + direction[:, 2] * SPACING[2] * z

    def expect(path, expected, kind, *words):
        found, about = raw_of(path, *words)
        np.testing.assert_array_equal(found, expected)
        assert about["voxel_type"] == kind, about
        expect_placed(about, direction, tolerance=1e-8)
        return about["notes"]

    # The same number everywhere: 100, of slopes 1 to 8.
    stored = np.full(shape, 100, "<u2")
    slopes = np.arange(1, 9)
    frames = [{"position": place(z), "slope": slopes[z], "intercept": -5} for z in range(8)]
    write_enhanced("slopes.dcm", stored, frames, plane)
    expected = stored * slopes[:, None, None] - 5.0
    notes = expect("slopes.dcm", expected, "float32")
    assert any("differ" in note for note in notes), notes

    # Frames in any order; spacing and orientation of each frame; 12 bits, so that int16 holds all.
    values = np.random.default_rng(1).integers(0, 4096, shape).astype("<u2")
    order = np.random.default_rng(2).permutation(8)
    frames = [{"position": place(z), "slope": int(z % 3 + 1), "intercept": -1000, **plane}
              for z in order]
    scaled = values * (np.arange(8) % 3 + 1)[:, None, None].astype("i4") - 1000
    bits = {"BitsStored": 12, "HighBit": 11}
    for syntax in (None, "implicit", "big", RLELossless):
        write_enhanced("order.dcm", values[order], frames, syntax=syntax, **bits)
        expect("order.dcm", scaled, "int16")
    os.makedirs("folder", exist_ok=True)
    write_enhanced("folder/order.dcm", values[order], frames, plane, **bits)
    expect("folder", scaled, "int16")
    run("build", "order.dcm", "-o", "order.isb")

    # Signed, 8 and 32 bits.
    for kind, name in (("<i2", "int16"), ("u1", "uint8"), ("i1", "int8"), ("<u4", "float32")):
        plain = np.random.default_rng(3).integers(0, 100, shape).astype(kind)
        if kind.startswith("<i") or kind == "i1":
            plain -= 50
        write_enhanced("kind.dcm", plain[order], [{"position": place(z)} for z in order], plane)
        expect("kind.dcm", plain, name)

    # Gaps and doubles.
    def frames_at(*heights):
        return [{"position": place(z)} for z in heights]

    write_enhanced("gap.dcm", values[:6], frames_at(0, 1, 2, 5, 6, 7), plane)
    run("build", "gap.dcm", fails_with="mm apart")
    write_enhanced("double.dcm", values[:4], frames_at(0, 1, 1, 2), plane)
    run("build", "double.dcm", fails_with="same position")

    # Two time points, in turns; two stacks; two echoes.
    for what, key, name in (("time", "time", lambda n: str(n)),
                               ("stack", "grid", lambda n: "AB"[n]),
                               ("echo", "channel", lambda n: str(n))):
        number = (lambda n: "AB"[n]) if what == "stack" else (lambda n: n + 1)
        frames = [{"position": place(z), what: number(n)} for z in range(4) for n in range(2)]
        write_enhanced(f"{what}.dcm", values, frames, plane, **bits)
        run("build", f"{what}.dcm", fails_with=f"--select {key}=")
        for n in range(2):
            notes = expect(f"{what}.dcm", values[n::2], "int16", "--select", f"{key}={name(n)}")
        run("build", f"{what}.dcm", "--select", key + ("=C" if what == "stack" else "=2"),
            fails_with=f"--select {key}=")
        run("build", f"{what}.dcm", "--select", f"{key}={name(0)}", "-o", "choice.isb")
        assert "up to date" in run("build", f"{what}.dcm", "--select", f"{key}={name(0)}", "-o", "choice.isb").stdout
        again = run("build", f"{what}.dcm", "--select", f"{key}={name(1)}", "-o", "choice.isb")
        assert "up to date" not in again.stdout, again.stdout
        os.remove("choice.isb")

    # No positions: an assumption, until the distance is given.
    write_enhanced("unplaced.dcm", values, [{} for _ in range(8)], plane, **bits)
    found, about = raw_of("unplaced.dcm")
    np.testing.assert_array_equal(found, values)
    assert any("assumption" in note and "2.5" in note for note in about["notes"]), about["notes"]
    notes = raw_of("unplaced.dcm", "--spacing", "0.7,0.5,3")[1]["notes"]
    assert not any("assumption" in note for note in notes), notes

    # Damaged anywhere: one line.
    small = np.arange(2 * 2 * 3, dtype="<u2").reshape(3, 2, 2)
    write_enhanced("small.dcm", small, frames_at(0, 1, 2), plane)
    whole = open("small.dcm", "rb").read()
    for size in range(132, len(whole), 97):
        with open("cut.dcm", "wb") as file:
            file.write(whole[:size])
        run("build", "cut.dcm", fails_with="cut.dcm")


def test_tiff():
    """Pages and slices against tifffile, which knows all that TIFF may be."""
    import tifffile

    variants = ({}, {"bigtiff": True}, {"byteorder": ">"}, {"compression": "zlib"},
                {"rowsperstrip": 5}, {"bigtiff": True, "byteorder": ">", "compression": "zlib"})
    for number, kind in enumerate(TYPES):
        values = voxels(kind, (7, 33, 70))
        write_nrrd("in.nrrd", values)
        run("convert", "in.nrrd", "-o", "pages.tif", "--force")
        run("convert", "in.nrrd", "-o", "slices/%03d.tif", "--force")
        expect_same(tifffile.imread("pages.tif"), values)
        found = tifffile.imread([f"slices/{z:03}.tif" for z in range(len(values))])
        expect_same(found, values)
        with tifffile.TiffFile("slices/000.tif") as file:
            x, y = (file.pages[0].tags[name].value for name in ("XResolution", "YResolution"))
            np.testing.assert_allclose(10 * x[1] / x[0], SPACING[0], rtol=1e-6)
            np.testing.assert_allclose(10 * y[1] / y[0], SPACING[1], rtol=1e-6)
            assert file.pages[0].tags["ResolutionUnit"].value == 3
        # Theirs, read by us.
        for options in (variants[number], variants[5])[: 1 + (number == 4)]:
            shutil.rmtree("theirs", ignore_errors=True)
            os.makedirs("theirs")
            plain = {"photometric": "minisblack", "metadata": None}
            byteorder = options.get("byteorder", "<")
            with tifffile.TiffWriter("theirs.tif", bigtiff=options.get("bigtiff", False),
                                     byteorder=byteorder) as file:
                for page in values:
                    file.write(page, contiguous=False, **plain, **{
                        key: options[key] for key in ("compression", "rowsperstrip") if key in options})
            for z, page in enumerate(values):
                tifffile.imwrite(f"theirs/{z}.tif", page, **plain, **options)
            for name in ("theirs.tif", "theirs"):
                found, _ = raw_of(name)
                expect_same(found, values)
    # Their lengths, as ImageJ and OME have them.
    resolution = (1 / SPACING[0], 1 / SPACING[1])
    tifffile.imwrite("imagej.tif", values.astype("u2"), imagej=True, resolution=resolution,
                     metadata={"axes": "ZYX", "unit": "um", "spacing": SPACING[2]})
    ome = {"axes": "ZYX"}
    for name, size in zip("XYZ", SPACING):
        ome |= {f"PhysicalSize{name}": size, f"PhysicalSize{name}Unit": "µm"}
    tifffile.imwrite("theirs.ome.tif", values, photometric="minisblack", metadata=ome)
    for name in ("imagej.tif", "theirs.ome.tif"):
        found, about = raw_of(name)
        np.testing.assert_array_equal(found, values.astype(found.dtype))
        expect_placed(about, spacing=SPACING / 1e3, origin=[0, 0, 0], tolerance=1e-8)
        assert about["length_unit"] == "millimetres", about
    # A list of pages that is cut, or leads in a circle, is no smaller volume.
    with open("theirs.tif", "rb") as file:
        whole = file.read()
    for length in range(16, len(whole) - 1, len(whole) // 40):
        with open("cut.tif", "wb") as file:
            file.write(whole[:length])
        run("convert", "cut.tif", "-o", "x.raw", fails_with="cut.tif")


def test_others():
    """Formats that only ITK reads, from what their specifications say; LSM from tifffile."""
    import tifffile

    def write(name, *parts):
        with open(name, "wb") as file:
            file.write(b"".join(parts))

    def png(page):
        bits = 8 * page.itemsize
        rows = b"".join(b"\0" + row.astype(f">u{page.itemsize}").tobytes() for row in page)
        chunk = lambda kind, data: (struct.pack(">I", len(data)) + kind + data
                                    + struct.pack(">I", zlib.crc32(kind + data)))
        head = struct.pack(">2I5B", page.shape[1], page.shape[0], bits, 0, 0, 0, 0)
        return (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(rows))
                + chunk(b"IEND", b""))

    shape = (9, 33, 40)
    z, y, x = shape
    for kind in ("u8", "u16"):
        os.makedirs(kind)
        values = voxels(kind, shape)
        for number, page in enumerate(values):
            write(f"{kind}/page{number}.png", png(page))
        expect_same(raw_of(kind)[0], values)
        write(f"{kind}/page4.png", png(values[4])[:-40])
        run("convert", kind, "-o", "x.raw", fails_with="page4.png")

    for kind, mode in (("i16", 1), ("f32", 2)):
        values = voxels(kind, shape)
        head = bytearray(1024)
        struct.pack_into("<10i3f", head, 0, x, y, z, mode, 0, 0, 0, x, y, z,
                         *(SPACING * shape[::-1]))
        struct.pack_into("<3f3i", head, 52, 90, 90, 90, 1, 2, 3)
        head[208:216] = b"MAP \x44\x41\0\0"
        write("a.mrc", head, values.tobytes())
        found, about = raw_of("a.mrc")
        expect_same(found, values)
        np.testing.assert_allclose(about["spacing"], SPACING * 1e-7, rtol=1e-6)  # angstroms
        assert about["length_unit"] == "millimetres"

    values = voxels("u8", shape)
    info = bytearray(256)
    struct.pack_into("<I4xiii", info, 0, 0x00400494, x, y, z)
    struct.pack_into("<3d", info, 40, *(SPACING * 1e-6))
    tifffile.imwrite("a.lsm", values, photometric="minisblack", metadata=None,
                     extratags=[(34412, "B", len(info), bytes(info), True)])
    found, about = raw_of("a.lsm")
    expect_same(found, values)
    np.testing.assert_allclose(about["spacing"], SPACING * 1e-3)  # metres
    assert about["length_unit"] == "millimetres"

    # What is read no more is told what makes a format of it that is.
    for name, converter in (("a.vtk", "ParaView"), ("a.gipl", "3D Slicer"), ("A.GIPL.GZ", "3D Slicer"),
                            ("a.pic", "Fiji")):
        write(name, b"# vtk DataFile Version 3.0\na volume\nBINARY\n", bytes(5000))
        run("convert", name, "-o", "x.raw", fails_with=converter)

    # Cut short, each is an error.
    for name in ("a.mrc", "a.lsm"):
        with open(name, "rb") as file:
            whole = file.read()
        for length in (10, 70, 250, len(whole) // 2, len(whole) - 10):
            if name == "a.lsm" and length + 10 == len(whole):
                continue  # what is behind the voxels says nothing of them
            write("cut" + name[1:], whole[:length])
            run("convert", "cut" + name[1:], "-o", "x.raw", fails_with="cut" + name[1:])


def test_vtk():
    """VTI, MetaImage and NRRD against VTK's own, where it is."""
    from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy
    from vtkmodules.vtkCommonDataModel import vtkImageData
    from vtkmodules.vtkIOImage import vtkMetaImageReader, vtkMetaImageWriter, vtkNrrdReader
    from vtkmodules.vtkIOXML import vtkXMLImageDataReader, vtkXMLImageDataWriter

    for kind in TYPES:
        values = voxels(kind)
        for direction in (np.eye(3), rotation()):
            write_nrrd("in.nrrd", values, direction)
            for name, reader in (("a.vti", vtkXMLImageDataReader()), ("a.mha", vtkMetaImageReader()),
                                 ("a.mhd", vtkMetaImageReader()), ("a.nrrd", vtkNrrdReader())):
                run("convert", "in.nrrd", "-o", name, "--force")
                reader.SetFileName(name)
                reader.Update()
                image = reader.GetOutput()
                found = vtk_to_numpy(image.GetPointData().GetScalars()).reshape(values.shape)
                expect_same(found, values)
                if name == "a.vti":
                    np.testing.assert_allclose(image.GetSpacing(), SPACING)
                    np.testing.assert_allclose(image.GetOrigin(), ORIGIN)
                    matrix = image.GetDirectionMatrix()
                    found = [[matrix.GetElement(i, j) for j in range(3)] for i in range(3)]
                    np.testing.assert_allclose(found, direction, atol=1e-12)
        image = vtkImageData()
        image.SetDimensions(*values.shape[::-1])
        image.SetSpacing(*SPACING)
        image.SetOrigin(*ORIGIN)
        image.SetDirectionMatrix(*direction.ravel())
        image.GetPointData().SetScalars(numpy_to_vtk(values.ravel(), deep=True))
        for mode, packs in itertools.product(("Appended", "Binary"), (True, False)):
            writer = vtkXMLImageDataWriter()
            writer.SetFileName("theirs.vti")
            writer.SetInputData(image)
            getattr(writer, f"SetDataModeTo{mode}")()
            writer.SetEncodeAppendedData(packs)
            if not packs:
                writer.SetCompressorTypeToNone()
            writer.Write()
            found, about = raw_of("theirs.vti")
            expect_same(found, values)
            expect_placed(about, direction)
        image.SetDirectionMatrix(*np.eye(3).ravel())
        writer = vtkMetaImageWriter()
        writer.SetInputData(image)
        writer.SetFileName("theirs.mhd")
        writer.Write()
        found, about = raw_of("theirs.mhd")
        expect_same(found, values)
        expect_placed(about, tolerance=1e-5)


def real_volumes():
    data = os.environ["ISOBRICK_DATA"]
    known = (".nrrd", ".nhdr", ".mhd", ".nii", ".nii.gz", ".vti", ".vdb")
    paths = [os.path.join(data, "vhf_head_ct", "dicom")]
    for folder, _, names in os.walk(data):
        paths += [os.path.join(folder, name) for name in names if name.endswith(known)]
    paths = sorted(filter(os.path.exists, paths))
    assert len(paths) >= 5, paths
    return paths


def through_every_format(path, most_voxels):
    """The voxels of a scan's middle, at most so many an axis, and where they are."""
    volume = os.path.relpath(path, os.environ["ISOBRICK_DATA"])
    about = run("convert", path, "-o", "whole.isb", "--force", "--json", "--no-curvature")
    low = [max(0, n // 2 - most_voxels // 2) for n in about["dimensions"]]
    high = [min(n, first + most_voxels) - 1 for n, first in zip(about["dimensions"], low)]
    box = ",".join(str(n) for n in low + high)
    run("convert", "whole.isb", "-o", "cut.isb", "--box", box, "--force", "--no-curvature")
    values, place = raw_of("cut.isb")
    direct, _ = raw_of(path, "--box", box)
    expect_same(values, direct)
    for name in ("a.nrrd", "a.mhd", "a.mha", "a.nii.gz", "a.vti", "a.h5",
                 "a.ome.zarr", "slices/%04d.exr", "a.vdb", "a.tif"):
        run("convert", "cut.isb", "-o", name, "--force", "--memory", "1G")
        found, found_place = raw_of(os.path.dirname(name) or name)
        if name == "a.vdb":
            np.testing.assert_array_equal(found, values.astype("f4"))
        else:
            expect_same(found, values)
        if name.endswith(".tif"):
            continue  # it has no places
        # The same places in the world, to a thousandth of the spacing.
        for corner in itertools.product((0, 1), repeat=3):
            index = np.array(corner) * (np.array(values.shape[::-1]) - 1)
            world = lambda p: np.array(p["origin"]) + np.array(p["direction"]).T @ (
                np.array(p["spacing"]) * index
            )
            error = np.abs(world(found_place) - world(place)).max()
            assert error < 1e-3 * min(place["spacing"]), (volume, name, error)
    print(f"{volume}: {' x '.join(str(n) for n in values.shape[::-1])} voxels of "
          f"{' x '.join(str(n) for n in about['dimensions'])} are the same in every format", flush=True)


def test_real():
    """Real scans through every format: boxes of their middle."""
    for path in real_volumes():
        through_every_format(path, 92)


def test_real_whole():
    """The same of all of their voxels; some minutes, so not among the tests of every day."""
    for path in real_volumes():
        through_every_format(path, 1 << 20)


def write_components(values):
    """The same vectors, interleaved or as planes, in every format that has them; values: z y x c."""
    import nibabel

    z, y, x, count = values.shape
    names = {"u1": ("uint8", "UCHAR", "UInt8"), "i2": ("int16", "SHORT", "Int16"),
             "f4": ("float", "FLOAT", "Float32"), "f8": ("double", "DOUBLE", "Float64")}
    nrrd, meta, vtk = names[values.dtype.str[1:]]
    big = values.dtype.str[0] == ">"
    files = []

    def write(name, head, data):
        with open(name, "wb") as file:
            file.write(head.encode() + data)
        files.append(name)

    space = "space: left-posterior-superior\nspace origin: (0,0,0)\n"
    order = f"endian: {'big' if big else 'little'}\n"
    axes = "(1,0,0) (0,1,0) (0,0,1)"
    head = f"NRRD0004\ntype: {nrrd}\ndimension: 4\n{space}{order}"
    together = f"sizes: {count} {x} {y} {z}\nspace directions: none {axes}\n" \
               "kinds: vector domain domain domain\n"
    write("v.nrrd", f"{head}{together}encoding: raw\n\n", values.tobytes())
    write("z.nrrd", f"{head}{together}encoding: gzip\n\n", gzip.compress(values.tobytes()))
    write("planes.nrrd", f"{head}sizes: {x} {y} {z} {count}\nspace directions: {axes} none\n"
          "kinds: domain domain domain vector\nencoding: raw\n\n",
          values.transpose(3, 0, 1, 2).tobytes())
    write("v.mha", f"ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = {big}\n"
          f"DimSize = {x} {y} {z}\nElementNumberOfChannels = {count}\nElementType = MET_{meta}\n"
          "ElementDataFile = LOCAL\n", values.tobytes())
    array = lambda name, offset, parts: (
        f'<DataArray type="{vtk}" Name="{name}" format="appended" offset="{offset}" '
        f'NumberOfComponents="{parts}"/>')
    first = np.arange(x * y * z, dtype=values.dtype)
    offset = 8 + first.nbytes
    write("v.vti", f'<VTKFile type="ImageData" byte_order="{"Big" if big else "Little"}Endian" '
          f'header_type="UInt64"><ImageData WholeExtent="0 {x-1} 0 {y-1} 0 {z-1}"><Piece '
          f'Extent="0 {x-1} 0 {y-1} 0 {z-1}"><PointData Scalars="pressure">'
          f'{array("pressure", 0, 1)}{array("velocity", offset, count)}'
          f'</PointData></Piece></ImageData><AppendedData encoding="raw">_',
          struct.pack(">Q" if big else "<Q", first.nbytes) + first.tobytes()
          + struct.pack(">Q" if big else "<Q", values.nbytes) + values.tobytes()
          + b"</AppendedData></VTKFile>")
    if not big:
        image = nibabel.Nifti1Image(values.transpose(2, 1, 0, 3)[:, :, :, None, :],
                                    np.diag([-1.0, -1, 1, 1]))
        image.header.set_intent("vector")
        for name in ("v.nii", "v.nii.gz"):
            image.to_filename(name)
            files.append(name)
    return files


def test_components():
    """One of several values of a voxel, or their magnitude."""
    random = np.random.default_rng(5)
    for kind, count in ((">i2", 3), ("<f8", 2)):
        values = random.normal(0, 50, (5, 33, 40, count)).clip(-100, 100)
        values = values.astype(kind)
        delivered = values.astype("<f4") if kind == "<f8" else values.astype("<" + kind.strip("<>"))
        squares = (values.astype("f8") ** 2).sum(-1)
        for name in write_components(values):
            for component in (0, count - 1):
                found, about = raw_of(name, "--component", str(component))
                expect_same(found, delivered[..., component])
                note = f"component {component} of {count} values per voxel was taken"
                assert any(note in line for line in about["notes"]), about["notes"]
            found, _ = raw_of(name, "--component", "magnitude")
            assert found.dtype == "f4"
            np.testing.assert_allclose(found, np.sqrt(squares), rtol=1e-6)
            run("convert", name, "-o", "none.raw", "--component", str(count),
                fails_with=f"{count} values per voxel, 0 to {count - 1}")
            if name == "v.vti":  # its scalars are what it always was
                raw_of(name)
                assert run("convert", name, "-o", "none.raw", "--grid", "velocity",
                           fails_with="--select component=magnitude") is None
                found, _ = raw_of(name, "--grid", "velocity", "--component", "0")
                expect_same(found, delivered[..., 0])
                run("convert", name, "-o", "none.raw", "--grid", "nothing",
                    fails_with="no array of points named 'nothing'")
            else:
                run("convert", name, "-o", "none.raw", fails_with=f"it has {count} values per voxel")
            # Cut short anywhere: a line, and no file.
            whole = open(name, "rb").read()
            for size in (len(whole) - 1, len(whole) // 2, 300) if kind == "<f8" else ():
                with open("cut" + name, "wb") as file:
                    file.write(whole[:size])
                result = subprocess.run([ISOBRICK, "convert", "cut" + name, "-o", "none.raw",
                                         "--component", "1"], capture_output=True, text=True)
                is_tail = name == "v.vti" and size > len(whole) - 30
                assert result.returncode == (0 if is_tail else 1), (name, size, result)
                assert is_tail or result.stderr.count("\n") == 1, (name, size, result.stderr)
                if is_tail:
                    os.remove("none.raw")
            assert not os.path.exists("none.raw")
    # A build knows which component it was made of.
    run("build", "v.nrrd", "-o", "a.isb", "--component", "0")
    run("build", "v.nrrd", "-o", "b.isb", "--component", "magnitude")
    levels = [raw_of(name, "--level", "0")[0] for name in ("a.isb", "b.isb")]
    expect_same(levels[0], values[..., 0].astype("<f4"))
    assert not np.array_equal(*levels)
    # Numbers that no memory holds, and formats that have none.
    head = "NRRD0004\ntype: double\ndimension: 4\nendian: little\nencoding: raw\n" \
           "kinds: vector domain domain domain\n"
    for sizes, words in (("2000 4 4 4", "2000 values per voxel, and 1 to 1024"),
                         ("1024 1048576 1048576 1048576", ""), ("3 4 4 4", "bytes")):
        with open("hostile.nrrd", "w") as file:
            file.write(f"{head}sizes: {sizes}\n\n")
        run("convert", "hostile.nrrd", "-o", "none.raw", "--component", "0", fails_with=words)
    write_nrrd("plain.nrrd", voxels("u8"))
    for name in ("plain.nrrd", "a.isb", "."):
        run("convert", name, "-o", "none.raw", "--component", "0", fails_with="cannot take a component")


with tempfile.TemporaryDirectory(prefix="isobrick-interchange-") as folder:
    os.chdir(folder)
    globals()["test_" + sys.argv[2]]()
print("all voxels and places are the same")
