"""TIFF against tifffile, which knows all that TIFF may be."""
import os
import shutil

import numpy as np
import tifffile

from common import SPACING, run, write_nrrd
from volumes import TYPES, expect_placed, expect_same, raw_of, read_bytes, voxels, write_bytes

SHAPE = (7, 33, 70)


def test_pages_and_slices_are_the_same_for_tifffile_and_for_us():
    variants = ({}, {"bigtiff": True}, {"byteorder": ">"}, {"compression": "zlib"},
                {"rowsperstrip": 5}, {"bigtiff": True, "byteorder": ">", "compression": "zlib"})
    for number, kind in enumerate(TYPES):
        values = voxels(kind, SHAPE)
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


def test_numbers_tiles_and_planes_of_all_kinds_are_read():
    random = np.random.default_rng(3)
    kinds = ("u1", "i1", "u2", "i2", "f2", "u4", "i4", "f4", "u8", "i8", "f8")
    for number, kind in enumerate(kinds):
        values = (random.random((5, 40, 50, 3)) * 100).astype(kind)
        delivered = values.astype("f4" if kind == "f2" else kind)
        # 32-bit integers packed and not, of the others one.
        for compression in (None, "zlib") if kind == "u4" else (("zlib", None)[number % 2],):
            grey = {"photometric": "minisblack", "compression": compression, "metadata": None}
            tifffile.imwrite("grey.tif", values[..., 0], **grey)
            tifffile.imwrite("white.tif", values[..., 0], **grey | {"photometric": "miniswhite"})
            tifffile.imwrite("tiles.tif", values[..., 0], tile=(16, 32), **grey)
            for name in ("grey.tif", "white.tif", "tiles.tif"):
                expect_same(raw_of(name)[0], delivered[..., 0])
            colours = grey | {"photometric": "rgb"}
            tifffile.imwrite("colours.tif", values, **colours)
            tifffile.imwrite("planes.tif", np.moveaxis(values, -1, 1).copy(),
                             planarconfig="separate", **colours)
            for name in ("colours.tif", "planes.tif"):
                expect_same(raw_of(name, "--select", "component=1")[0], delivered[..., 1])
            run("convert", "planes.tif", "-o", "x.raw", fails_with="3 values per voxel")


def test_lengths_of_imagej_and_ome_are_read():
    values = voxels("f32", SHAPE)
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


def test_a_list_of_pages_that_is_cut_is_no_smaller_volume():
    with tifffile.TiffWriter("theirs.tif") as file:
        for page in voxels("f32", SHAPE):
            file.write(page, contiguous=False, photometric="minisblack", metadata=None)
    whole = read_bytes("theirs.tif")
    for length in range(16, len(whole) - 1, len(whole) // 40):
        write_bytes("cut.tif", whole[:length])
        run("convert", "cut.tif", "-o", "x.raw", fails_with="cut.tif")
