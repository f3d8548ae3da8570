"""OME-Zarr of Zarr 2 against zarr and numcodecs."""
import itertools
import json
import os
import shutil
import zipfile

import numcodecs
import numpy as np
import zarr

from common import ORIGIN, SPACING, rotation, run, write_nrrd
from volumes import (SHAPE, TYPES, expect_placed, expect_same, pyramid_levels, raw_of, read_bytes,
                     voxels, write_bytes)

# From 3 on, zarr writes Zarr 3 unless it is told; before, it does not know the word.
ZARR2 = {} if zarr.__version__.startswith("2.") else {"zarr_format": 2}


def write_zarr(path, values, **how):
    array = zarr.open_array(path, mode="w", shape=values.shape, dtype=values.dtype, **ZARR2, **how)
    array[...] = values
    return array


def test_every_level_of_every_type_is_the_same_for_zarr_and_for_us():
    for kind in TYPES:
        values = voxels(kind)
        levels = pyramid_levels(values)
        run("convert", "levels.isb", "-o", "out.ome.zarr", "--all-levels", "--zarr-version", "2", "--force")
        image = zarr.open("out.ome.zarr", mode="r")
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


def test_a_direction_comes_back_and_is_warned_of():
    values = voxels("f32")
    write_nrrd("in.nrrd", values, rotation())
    result = run("convert", "in.nrrd", "-o", "turned.ome.zarr")
    assert "direction" in result.stderr
    found, about = raw_of("turned.ome.zarr")
    expect_same(found, values)
    expect_placed(about, rotation())


def test_their_compressors_orders_separators_byte_orders_and_missing_chunks_are_read():
    compressors = [
        None,
        numcodecs.Blosc("lz4", shuffle=numcodecs.Blosc.SHUFFLE),
        numcodecs.Blosc("lz4hc", shuffle=numcodecs.Blosc.BITSHUFFLE),
        numcodecs.Blosc("zlib"),
        numcodecs.Blosc("zstd", shuffle=numcodecs.Blosc.NOSHUFFLE),
        numcodecs.Blosc("blosclz"),
        numcodecs.LZ4(),
        numcodecs.BZ2(),
        numcodecs.LZMA(),
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
        array = write_zarr(
            "theirs.zarr", values, chunks=(7, 20, 30), order=order, compressor=compressor,
            dimension_separator=separator, fill_value=9, write_empty_chunks=False,
        )
        assert array.nchunks_initialized < array.nchunks
        found, about = raw_of("theirs.zarr")
        expect_same(found, values.astype(values.dtype.newbyteorder("<")))
        assert "no spacing" in str(about["notes"])


def test_wide_types_keep_their_numbers():
    for kind in ("<u4", "<i8", "<f8", "|b1"):
        values = voxels("u8").astype(kind)
        write_zarr("wide.zarr", values)
        found, _ = raw_of("wide.zarr")
        expect_same(found, values.astype(kind if kind != "|b1" else "u1"))


def write_five_axes(path):
    """An image of two time steps and three channels, whose level is said to be at `path`."""
    values = np.stack([np.stack([voxels("u8", (5, 6, 7), 10 * t + c) for c in range(3)]) for t in range(2)])
    group = zarr.open_group("five.zarr", mode="w", **ZARR2)
    write_zarr("five.zarr/s0", values, chunks=(1, 2, 3, 4, 5))
    names = ["t", "c", "z", "y", "x"]
    group.attrs["multiscales"] = [{
        "version": "0.4",
        "axes": [{"name": n, "unit": "micrometer"} if n in "zyx" else {"name": n} for n in names],
        "datasets": [{
            "path": path,
            "coordinateTransformations": [
                {"type": "scale", "scale": [1, 1, 3, 2, 1]},
                {"type": "translation", "translation": [0, 0, 30, 20, 10]},
            ],
        }],
        "coordinateTransformations": [{"type": "scale", "scale": [1, 1, 2, 2, 2]}],
    }]
    return values


def test_time_steps_and_channels_are_chosen():
    values = write_five_axes("s0")
    found, about = raw_of("five.zarr")
    expect_same(found, values[0, 0])
    assert "of 3 channels, the first" in str(about["notes"])
    expect_placed(about, spacing=[2e-3, 4e-3, 6e-3], origin=[20e-3, 40e-3, 60e-3])
    assert "micrometer" in str(about["notes"]) and about["length_unit"] == "millimetres"
    found, _ = raw_of("five.zarr", "--select", "time=1", "--select", "channel=2")
    expect_same(found, values[1, 2])
    run("convert", "five.zarr", "-o", "x.raw", "--select", "channel=3", fails_with="0 to 2")


def test_names_that_lead_out_of_the_store_are_refused():
    write_zarr("wide.zarr", voxels("u8"))
    for path in ("../wide.zarr", "/etc", "s0/../../wide.zarr", "", "."):
        write_five_axes(path)
        run("convert", "five.zarr", "-o", "x.raw", fails_with="leads out of the store")


def test_metadata_that_is_not_possible_is_refused():
    write_zarr("good.zarr", np.zeros(SHAPE, ">u2"), chunks=(7, 20, 30), fill_value=9)
    with open("good.zarr/.zarray") as file:
        good = json.load(file)
    os.makedirs("bad.zarr")
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
        ({"compressor": {"id": "zfpy"}}, "zfpy"),
        ({"filters": [{"id": "categorize"}]}, "filter"),
        ({"filters": [{"id": "delta"}]}, "dtype"),
        ({"dimension_separator": "/../"}, "separator"),
        ({"fill_value": "abc"}, "fill_value"),
        ({"fill_value": 70000}, "fill_value"),
        ({"fill_value": 0.5}, "fill_value"),
        ({"fill_value": "NaN"}, "fill_value"),
        ({"shape": [1 << 20] * 3}, "not enough space"),
        ({"zarr_format": 7}, "zarr_format"),
    ):
        with open("bad.zarr/.zarray", "w") as file:
            json.dump({**good, **changes}, file)
        run("convert", "bad.zarr", "-o", "x.raw", fails_with=message)


def test_chunks_that_are_cut_short_are_refused():
    write_zarr("cut.zarr", voxels("u8", (4, 4, 4)), compressor=numcodecs.Blosc("lz4"))
    chunk = read_bytes("cut.zarr/0.0.0")
    for length in range(len(chunk)):
        write_bytes("cut.zarr/0.0.0", chunk[:length])
        run("convert", "cut.zarr", "-o", "x.raw", fails_with="cut.zarr/0.0.0")


def test_their_zip_files_are_read():
    for kind in ("u16", "f32"):
        values = voxels(kind)
        for compression in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            if os.path.exists("in.zarr.zip"):
                os.remove("in.zarr.zip")
            store = getattr(zarr, "storage", zarr).ZipStore("in.zarr.zip", compression=compression, mode="w")
            group = zarr.group(store=store, **ZARR2)
            make = getattr(group, "create_array", None) or group.create_dataset
            array = make("a/b", shape=values.shape, dtype=values.dtype, chunks=(16, 16, 16))
            array[...] = values
            store.close()
            for path in ("in.zarr.zip", "in.zarr.zip/a/b"):
                expect_same(raw_of(path)[0], values)
