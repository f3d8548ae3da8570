"""Volumes that the checks write and read: their voxels and their place in the world."""
import numpy as np

from common import ORIGIN, SPACING, run, write_nrrd

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
    kind = np.dtype(about["voxel_type"]).newbyteorder("<")
    shape = about["dimensions"][::-1]
    return np.fromfile("read.raw", kind).reshape(shape), about


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


def read_bytes(path):
    with open(path, "rb") as file:
        return file.read()


def write_bytes(path, *parts):
    with open(path, "wb") as file:
        file.write(b"".join(parts))
