"""Formats that only ITK reads, from what their specifications say; LSM from tifffile."""
import os
import struct
import zlib

import numpy as np
import tifffile

from common import SPACING, run
from volumes import expect_same, raw_of, read_bytes, voxels, write_bytes

SHAPE = (9, 33, 40)


def png(page):
    bits = 8 * page.itemsize
    rows = b"".join(b"\0" + row.astype(f">u{page.itemsize}").tobytes() for row in page)
    chunk = lambda kind, data: (struct.pack(">I", len(data)) + kind + data
                                + struct.pack(">I", zlib.crc32(kind + data)))
    head = struct.pack(">2I5B", page.shape[1], page.shape[0], bits, 0, 0, 0, 0)
    return (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(rows))
            + chunk(b"IEND", b""))


def test_slices_of_png_are_read():
    for kind in ("u8", "u16"):
        os.makedirs(kind)
        values = voxels(kind, SHAPE)
        for number, page in enumerate(values):
            write_bytes(f"{kind}/page{number}.png", png(page))
        expect_same(raw_of(kind)[0], values)
        write_bytes(f"{kind}/page4.png", png(values[4])[:-40])
        run("convert", kind, "-o", "x.raw", fails_with="page4.png")


def expect_refused_when_cut(name, lengths):
    whole = read_bytes(name)
    cut = "cut" + os.path.splitext(name)[1]
    for length in lengths:
        write_bytes(cut, whole[:length])
        run("convert", cut, "-o", "x.raw", fails_with=cut)


def test_mrc_is_read():
    z, y, x = SHAPE
    for kind, mode in (("i16", 1), ("f32", 2)):
        values = voxels(kind, SHAPE)
        head = bytearray(1024)
        struct.pack_into("<10i3f", head, 0, x, y, z, mode, 0, 0, 0, x, y, z,
                         *(SPACING * SHAPE[::-1]))
        struct.pack_into("<3f3i", head, 52, 90, 90, 90, 1, 2, 3)
        head[208:216] = b"MAP \x44\x41\0\0"
        write_bytes("a.mrc", head, values.tobytes())
        found, about = raw_of("a.mrc")
        expect_same(found, values)
        np.testing.assert_allclose(about["spacing"], SPACING * 1e-7, rtol=1e-6)  # angstroms
        assert about["length_unit"] == "millimetres"
    size = os.path.getsize("a.mrc")
    expect_refused_when_cut("a.mrc", (10, 70, 250, size // 2, size - 10))


def test_lsm_is_read():
    z, y, x = SHAPE
    values = voxels("u8", SHAPE)
    info = bytearray(256)
    struct.pack_into("<I4xiii", info, 0, 0x00400494, x, y, z)
    struct.pack_into("<3d", info, 40, *(SPACING * 1e-6))
    tifffile.imwrite("a.lsm", values, photometric="minisblack", metadata=None,
                     extratags=[(34412, "B", len(info), bytes(info), True)])
    found, about = raw_of("a.lsm")
    expect_same(found, values)
    np.testing.assert_allclose(about["spacing"], SPACING * 1e-3)  # metres
    assert about["length_unit"] == "millimetres"
    size = os.path.getsize("a.lsm")
    # The bytes behind the voxels say nothing of them.
    expect_refused_when_cut("a.lsm", (10, 70, 250, size // 2))


def test_formats_that_are_read_no_more_are_told_a_converter():
    for name, converter in (("a.gipl", "3D Slicer"), ("A.GIPL.GZ", "3D Slicer"),
                            ("a.pic", "Fiji")):
        write_bytes(name, b"# vtk DataFile Version 3.0\na volume\nBINARY\n", bytes(5000))
        run("convert", name, "-o", "x.raw", fails_with=converter)
