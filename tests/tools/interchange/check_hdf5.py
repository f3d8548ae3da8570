"""HDF5 against h5py."""
import os

import h5py
import numpy as np

from common import ORIGIN, SPACING, rotation, run, write_nrrd
from volumes import TYPES, expect_placed, expect_same, raw_of, read_bytes, voxels, write_bytes


def test_all_types_are_the_same_for_h5py_and_for_us():
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


def test_their_chunks_filters_and_types_are_read():
    values = voxels("i16")
    for options in (
        {}, {"chunks": (3, 20, 30)}, {"compression": "gzip"}, {"compression": "lzf"},
        {"compression": "gzip", "shuffle": True, "fletcher32": True},
        {"dtype": ">i2"}, {"dtype": "<i4"}, {"dtype": "<f8"}, {"dtype": ">f4"},
    ):
        with h5py.File("theirs.h5", "w") as file:
            stored = file.create_dataset("a/b", data=values, **options)
            stored.attrs["element_size_um"] = [3.0, 2.0, 1.0]
        found, about = raw_of("theirs.h5:/a/b")
        np.testing.assert_array_equal(found, values)
        np.testing.assert_allclose(about["spacing"], [0.001, 0.002, 0.003])
        assert about["length_unit"] == "millimetres"


def test_chunks_that_were_never_written_are_counted():
    values = voxels("i16")
    with h5py.File("sparse.h5", "w") as file:
        sparse = file.create_dataset("a", values.shape, values.dtype, chunks=(13, 20, 30), fillvalue=7)
        sparse[:, :20, :30] = values[:, :20, :30]
        chunks = np.prod([-(-n // size) for n, size in zip(values.shape, (13, 20, 30))])
    found, about = raw_of("sparse.h5")
    assert (found[:, 20:] == 7).all()
    assert f"{chunks - 1} of the {chunks} chunks" in str(about["notes"]), about


def test_a_file_of_a_virtual_dataset_that_is_not_there_gives_no_fill_values():
    values = voxels("i16")
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


def test_a_dataset_is_chosen():
    values = voxels("i16")
    with h5py.File("many.h5", "w") as file:
        file["one"] = values
        file["two"] = values > 0
        file["flat"] = values[0]
        file["four"] = np.stack([values, values + 1])
        file["thin"] = values[None, None]
    run("convert", "many.h5", "-o", "x.raw", fails_with="'/one'")
    run("convert", "many.h5:/three", "-o", "x.raw", fails_with="'/two'")
    run("convert", "many.h5:/flat", "-o", "x.raw", fails_with="three")
    run("convert", "many.h5:/four", "-o", "x.raw", fails_with="--select channel=C")
    expect_same(raw_of("many.h5:/four", "--select", "channel=1")[0], values + 1)
    expect_same(raw_of("many.h5:/two")[0], (values > 0).astype("u1"))
    expect_same(raw_of("many.h5:/thin")[0], values)


def test_files_that_are_cut_are_refused():
    with h5py.File("small.h5", "w") as file:
        file.create_dataset("a", data=voxels("u8", (4, 4, 4)), chunks=(2, 2, 2), compression="gzip")
    whole = read_bytes("small.h5")
    for length in range(0, len(whole), 97):
        write_bytes("cut.h5", whole[:length])
        run("convert", "cut.h5", "-o", "x.raw", fails_with="cut.h5")
