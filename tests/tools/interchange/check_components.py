"""Voxels of several values: one of them is taken, or their magnitude."""
import gzip
import os
import struct
import subprocess

import nibabel
import numpy as np

from common import ISOBRICK, run, write_nrrd
from volumes import expect_same, raw_of, read_bytes, voxels, write_bytes


def write_components(values):
    """The same vectors, interleaved or as planes, in every format that has them; values: z y x c."""
    z, y, x, count = values.shape
    names = {"u1": ("uint8", "UCHAR", "UInt8"), "i2": ("int16", "SHORT", "Int16"),
             "f4": ("float", "FLOAT", "Float32"), "f8": ("double", "DOUBLE", "Float64")}
    nrrd, meta, vtk = names[values.dtype.str[1:]]
    big = values.dtype.str[0] == ">"
    files = []

    def write(name, head, data):
        write_bytes(name, head.encode(), data)
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


def expect_no_file_when_cut(name):
    whole = read_bytes(name)
    for size in (len(whole) - 1, len(whole) // 2, 300):
        write_bytes("cut" + name, whole[:size])
        result = subprocess.run([ISOBRICK, "convert", "cut" + name, "-o", "none.raw",
                                 "--select", "component=1"], capture_output=True, text=True)
        if name == "v.vti" and size > len(whole) - 30:  # its last tag, which nobody needs
            assert result.returncode == 0, (name, size, result)
            os.remove("none.raw")
        else:
            assert result.returncode == 1, (name, size, result)
            assert result.stderr.count("\n") == 1, (name, size, result.stderr)


def test_one_of_several_values_of_a_voxel_or_their_magnitude_is_read():
    random = np.random.default_rng(5)
    for kind, count in ((">i2", 3), ("<f8", 2)):
        values = random.normal(0, 50, (5, 33, 40, count)).clip(-100, 100)
        values = values.astype(kind)
        delivered = values.astype("<" + kind.strip("<>"))
        squares = (values.astype("f8") ** 2).sum(-1)
        for name in write_components(values):
            for component in (0, count - 1):
                found, about = raw_of(name, "--select", f"component={component}")
                expect_same(found, delivered[..., component])
                note = f"component {component} of {count} values per voxel was taken"
                assert any(note in line for line in about["notes"]), about["notes"]
            found, _ = raw_of(name, "--select", "component=magnitude")
            assert found.dtype == "f4"
            np.testing.assert_allclose(found, np.sqrt(squares), rtol=1e-6)
            run("convert", name, "-o", "none.raw", "--select", f"component={count}",
                fails_with=f"{count} values per voxel, 0 to {count - 1}")
            if name == "v.vti":  # its scalars are what it always was
                raw_of(name)
                assert run("convert", name, "-o", "none.raw", "--select", "grid=velocity",
                           fails_with="--select component=magnitude") is None
                found, _ = raw_of(name, "--select", "grid=velocity", "--select", "component=0")
                expect_same(found, delivered[..., 0])
                run("convert", name, "-o", "none.raw", "--select", "grid=nothing",
                    fails_with="no array 'nothing'")
            else:
                run("convert", name, "-o", "none.raw", fails_with=f"it has {count} values per voxel")
            if kind == "<f8":
                expect_no_file_when_cut(name)
            assert not os.path.exists("none.raw")


def test_a_build_knows_which_component_it_was_made_of():
    values = np.random.default_rng(5).normal(0, 50, (5, 33, 40, 2)).astype("<f8")
    write_components(values)
    run("build", "v.nrrd", "-o", "a.isb", "--select", "component=0")
    run("build", "v.nrrd", "-o", "b.isb", "--select", "component=magnitude")
    levels = [raw_of(name, "--level", "0")[0] for name in ("a.isb", "b.isb")]
    expect_same(levels[0], values[..., 0].astype("<f4"))
    assert not np.array_equal(*levels)


def test_numbers_of_values_that_no_memory_holds_are_refused():
    head = "NRRD0004\ntype: double\ndimension: 4\nendian: little\nencoding: raw\n" \
           "kinds: vector domain domain domain\n"
    for sizes, words in (("2000 4 4 4", "2000 values per voxel, and 1 to 1024"),
                         ("1024 1048576 1048576 1048576", ""), ("3 4 4 4", "bytes")):
        with open("hostile.nrrd", "w") as file:
            file.write(f"{head}sizes: {sizes}\n\n")
        run("convert", "hostile.nrrd", "-o", "none.raw", "--select", "component=0", fails_with=words)


def test_volumes_of_one_value_a_voxel_have_no_component():
    write_nrrd("plain.nrrd", voxels("u8"))
    run("build", "plain.nrrd", "-o", "a.isb")
    for name in ("plain.nrrd", "a.isb", "."):
        run("convert", name, "-o", "none.raw", "--select", "component=0", fails_with="cannot take a component")
