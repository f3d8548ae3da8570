"""OpenVDB against pyopenvdb."""
import itertools
import json
import subprocess

import numpy as np
import pyopenvdb as vdb

from common import ISOBRICK, ORIGIN, SPACING, rotation, run, write_nrrd
from volumes import TYPES, expect_placed, pyramid_levels, raw_of, voxels


def test_every_level_of_every_type_is_the_same_for_openvdb_and_for_us():
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


def test_a_direction_comes_back_and_memory_that_is_too_small_is_refused():
    values = voxels("f32")
    write_nrrd("in.nrrd", values, rotation())
    run("convert", "in.nrrd", "-o", "turned.vdb")
    found, about = raw_of("turned.vdb")
    np.testing.assert_array_equal(found, values)
    expect_placed(about, rotation())
    run("convert", "in.nrrd", "-o", "x.vdb", "--memory", "17M", "--threads", "1", fails_with="MiB")


def test_values_mask_background_class_name_and_transform_come_back_from_a_pyramid():
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
        # If a voxel equals the background, nothing says that it was active.
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


def test_a_grid_larger_than_memory_is_read_slab_by_slab():
    random = np.random.default_rng(4)
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
