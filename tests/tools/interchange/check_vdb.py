"""OpenVDB against pyopenvdb."""
import itertools
import json
import os
import subprocess

import numpy as np
import pyopenvdb as vdb

from common import ISOBRICK, ORIGIN, SPACING, rotation, run, write_nrrd
from volumes import TYPES, expect_placed, pyramid_levels, raw_of, voxels


def test_every_level_of_every_type_is_the_same_for_openvdb_and_for_us():
    for kind in TYPES:
        values = voxels(kind)
        levels = pyramid_levels(values)
        run("convert", "levels.isb", "-o", "out.vdb", "--all-levels", "--force")
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
            found, about = raw_of("out.vdb", *(["--select", f"grid=density_level{level}"] if level else []))
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
        run("build", "theirs.vdb", "--select", f"grid={grid.name}", "-o", "back.isb", "--force")
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
    found, about = raw_of("theirs.vdb", "--select", "grid=mask")
    assert about["voxel_type"] == "uint8" and found.sum() == 9 * 8 * 7
    run("convert", "theirs.vdb", "-o", "x.raw", "--select", "grid=fire", fails_with="'smoke' (float)")


def three_grids():
    ball = vdb.createLevelSetSphere(7.3, (3, 4, 5), 0.5, 3.0)
    ball.name = "ball"
    smoke = vdb.FloatGrid(0.25)
    smoke.name, smoke.gridClass = "smoke", vdb.GridClass.FOG_VOLUME
    smoke.copyFromArray(np.random.default_rng(5).integers(1, 9, (9, 20, 17)).astype("f4"), ijk=(-3, 5, 100))
    smoke.transform = vdb.createLinearTransform(0.3)
    flow = vdb.Vec3SGrid()
    flow.name = "flow"
    flow.fill((1, 2, 3), (4, 4, 4), (1.0, 2.0, 3.0))
    return ball, flow, smoke


def expect_same(back, grid):
    """Values, active voxels, band, class, background and place."""
    assert back.gridClass == grid.gridClass and back.background == grid.background
    assert back.activeVoxelCount() == grid.activeVoxelCount()
    assert back.evalActiveVoxelBoundingBox() == grid.evalActiveVoxelBoundingBox()
    np.testing.assert_allclose(back.transform.indexToWorld((1, 2, 3)), grid.transform.indexToWorld((1, 2, 3)))
    low, high = grid.evalActiveVoxelBoundingBox()
    shape = tuple(b - a + 1 for a, b in zip(low, high))
    values, found = np.empty(shape, "f4"), np.empty(shape, "f4")
    grid.copyToArray(values, ijk=low)
    back.copyToArray(found, ijk=low)
    np.testing.assert_array_equal(found, values)


def test_several_grids_of_a_file_go_into_one():
    ball, flow, smoke = three_grids()
    vdb.write("three.vdb", [ball, flow, smoke])
    for words in (["grid=all"], ["grid=ball", "grid=smoke"], ["grid=0", "grid=2"]):
        selected = [part for word in words for part in ("--select", word)]
        run("convert", "three.vdb", *selected, "-o", "both.vdb", "--force")
        assert [grid.name for grid in vdb.readAllGridMetadata("both.vdb")] == ["ball", "smoke"]
        for grid in (ball, smoke):
            expect_same(vdb.read("both.vdb", grid.name), grid)
    about = run("info", "three.vdb", "--json")
    assert "of 3 grids, 'ball' was taken; the others are 'flow' (vec3s), 'smoke' (float)" in str(about["notes"]), about
    # A pyramid of each.
    run("build", "three.vdb", "--select", "grid=all", "-o", "each.isb")
    assert [name for name in sorted(os.listdir(".")) if name.startswith("each")] == ["each-ball.isb", "each-smoke.isb"]
    ball.name, smoke.name = "../up", "/top"  # a stranger's names
    vdb.write("named.vdb", [ball, smoke])
    run("build", "named.vdb", "--select", "grid=all", "-o", "safe.isb")
    assert [name for name in sorted(os.listdir(".")) if name.startswith("safe")] == ["safe--top.isb", "safe-..-up.isb"]
    ball.name, smoke.name = "ball", "smoke"
    # A level set has its band and its inside also by way of a pyramid.
    run("build", "three.vdb", "--select", "grid=0", "-o", "ball.isb")
    run("convert", "ball.isb", "-o", "back.vdb", "--force")
    back = vdb.read("back.vdb", "ball")
    expect_same(back, ball)
    assert back.getConstAccessor().getValue((6, 8, 10)) == -1.5 and back.getConstAccessor().getValue((99, 0, 0)) == 1.5
    for words in (["-o", "x.nrrd"], ["-o", "x.vdb", "--box", "0,0,0,3,3,3"]):
        result = subprocess.run([ISOBRICK, "convert", "three.vdb", "--select", "grid=all", *words], capture_output=True)
        assert result.returncode == 2 and b"choose one" in result.stderr, result


def test_other_programs_say_what_a_file_holds():
    ball, _, smoke = three_grids()
    vdb.write("theirs.vdb", [ball, smoke])
    run("convert", "theirs.vdb", "--select", "grid=all", "-o", "ours.vdb", "--force")
    theirs, ours = ({grid.name: grid for grid in vdb.readAllGridMetadata(name)} for name in ("theirs.vdb", "ours.vdb"))
    for name in ("ball", "smoke"):
        for key in ("file_voxel_count", "file_bbox_min", "file_bbox_max", "class"):
            assert ours[name].metadata[key] == theirs[name].metadata[key], (name, key)


def test_values_are_packed_as_asked():
    fog = vdb.FloatGrid(0)
    fog.name = "density"
    fog.copyFromArray(np.add.outer(np.arange(64), np.add.outer(np.arange(64), np.arange(64))).astype("f4"))
    vdb.write("fog.vdb", [fog])
    sizes = {}
    for words in (["none"], ["zip"], ["blosc"], ["blosc", "--half"]):
        run("convert", "fog.vdb", "-o", "x.vdb", "--vdb-codec", *words, "--force")
        expect_same(vdb.read("x.vdb", "density"), fog)  # whole numbers up to 2048 are halves too
        sizes[" ".join(words)] = os.path.getsize("x.vdb")
    assert max(sizes["zip"], sizes["blosc"], sizes["blosc --half"]) < sizes["none"], sizes


def test_a_sequence_is_converted_file_by_file():
    for step in (3, 10):
        ball = vdb.createLevelSetSphere(2 + step / 10, (0, 0, 0), 0.5, 3.0)
        ball.name = "ball"
        vdb.write(f"run.{step:04}.vdb", [ball])
    about = run("convert", "run.%04d.vdb", "-o", "out.%03d.vdb", "--json")
    assert [one["output"] for one in about["volumes"]] == ["out.003.vdb", "out.010.vdb"], about
    for step in (3, 10):
        expect_same(vdb.read(f"out.{step:03}.vdb", "ball"), vdb.read(f"run.{step:04}.vdb", "ball"))
    about = run("build", "run.%04d.vdb", "--out-dir", "pyramids", "--json")
    assert about["built"] == 2, about
    run("convert", "pyramids/run.%04d.isb", "-o", "again.%d.vdb")
    expect_same(vdb.read("again.10.vdb", "ball"), vdb.read("run.0010.vdb", "ball"))


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


def closures(levels, level, tile=4):
    """docs/FORMAT.md, section 6: of each tile the least and the greatest sample of all finer levels,
    and of coarser ones up to that of which it is a cell."""
    count = -(-(np.array(levels[level].shape) - 1) // tile)
    found = np.empty((2, *count), levels[0].dtype)
    for at in np.ndindex(*count):
        corners = [(tile * i << level, tile * (i + 1) << level) for i in at]
        inside = [
            values[tuple(slice(low >> l, (high >> l) + 1) for low, high in corners)]
            for l, values in enumerate(levels[: level + tile.bit_length()])
        ]
        found[(slice(None), *at)] = min(p.min() for p in inside), max(p.max() for p in inside)
    return found


def expect_nodes(name, expected, spacing, first):
    grid = vdb.read("nodes.vdb", name)
    found = np.full(expected.shape[::-1], np.nan, "f4")
    grid.copyToArray(found)
    np.testing.assert_array_equal(found.T, expected)
    assert tuple(grid.metadata["isobrick:voxels"]) == expected.shape[::-1]
    for corner in ((0, 0, 0), (1, 2, 3)):
        np.testing.assert_allclose(grid.transform.indexToWorld(corner), first + spacing * corner)


def test_ranges_of_tiles_are_grids():
    for kind in ("u8", "i16", "f32"):
        levels = pyramid_levels(voxels(kind))
        run("convert", "levels.isb", "-o", "nodes.vdb", "--all-levels", "--with-ranges", "--with-curvature",
            "--vdb-background", "7", "--vdb-tolerance", "5", "--force")
        names = [grid.name for grid in vdb.readAllGridMetadata("nodes.vdb")]
        assert len(set(names)) == len(names) == 3 * len(levels) + 8, names
        for level in range(len(levels)):
            step = 4 * 2**level * SPACING
            for name, expected in zip(("min", "max"), closures(levels, level)):
                expect_nodes(name + (f"_level{level}" if level else ""), expected, step, ORIGIN + step / 2)
    run("convert", "levels.isb", "-o", "nodes.vdb", "--level", "1", "--box", "9,8,0,40,48,12", "--with-ranges", "--force")
    least, _ = closures(levels, 1)
    expect_nodes("min_level1", least[0:2, 1:6, 1:5], 8 * SPACING, ORIGIN + 8 * SPACING * [1.5, 1.5, 0.5])
    # Ours, read by us.
    found, about = raw_of("nodes.vdb", "--select", "grid=min_level1")
    np.testing.assert_array_equal(found, least[0:2, 1:6, 1:5])


def test_curvature_of_blocks_is_a_grid_for_each_coefficient():
    # A ball: level 1 lies 1.25 / radius from level 0 (docs/FORMAT.md, section 8).
    z, y, x = np.meshgrid(*(np.arange(n, dtype=float) for n in (40, 43, 46)), indexing="ij")
    radius = 15.0
    write_nrrd("ball.nrrd", (radius - np.sqrt((x - 22.3) ** 2 + (y - 20.6) ** 2 + (z - 19.8) ** 2)).astype("<f4"))
    run("build", "ball.nrrd", "-o", "ball.isb")
    run("convert", "ball.isb", "-o", "nodes.vdb", "--with-ranges", "--with-curvature", "--force")

    def values_of(name, shape):
        grid = vdb.read("nodes.vdb", name)
        values = np.empty(shape, "f4")
        grid.copyToArray(values)
        return values, grid

    shape, tiles = (6, 6, 5), (12, 11, 10)
    c = [values_of(f"curvature_{i}", shape)[0] for i in range(8)]
    grid = values_of("curvature_3", shape)[1]
    np.testing.assert_allclose(grid.transform.indexToWorld((3, 2, 1)), ORIGIN + SPACING * [28, 20, 12])
    least, greatest = values_of("min", tiles)[0], values_of("max", tiles)[0]
    seen = 0
    for block in np.ndindex(shape):
        part = tuple(slice(2 * b, 2 * b + 2) for b in block)
        low, high = least[part].min(), greatest[part].max()
        if not low < -1 < 1 < high:
            continue
        at = np.clip(8 * -low / (high - low) - 0.5, 0, 7)
        bound = np.interp(at, range(8), [coefficient[block] for coefficient in c])
        assert 0.8 / radius < bound < 2 / radius, (block, bound)
        seen += 1
    assert seen > 20
    run("build", "ball.nrrd", "-o", "flat.isb", "--no-curvature")
    run("convert", "flat.isb", "-o", "x.vdb", "--with-curvature", fails_with="holds no curvature")
