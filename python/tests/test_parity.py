"""What the command does is there in Python too: pieces, numbers of triangles, pictures, conversions, volumes."""

from __future__ import annotations

import asyncio
import doctest
import importlib
import pkgutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import zarr
from numpy.typing import NDArray

import isobrick
from conftest import ball

VOLUME_OF_BALL = 4 / 3 * np.pi


def two_balls() -> NDArray[np.float32]:
    """Of radius 5 and 9; and, at the border of the volume, half a one of radius 8."""
    z, y, x = np.mgrid[0:40, 0:48, 0:72].astype(np.float32)
    balls = [((12, 20, 20), 5), ((38, 20, 20), 9), ((71, 20, 20), 8)]
    distances = [r - np.sqrt((x - c[0]) ** 2 + (y - c[1]) ** 2 + (z - c[2]) ** 2) for c, r in balls]
    return np.max(distances, axis=0)


@pytest.fixture(scope="module")
def pyramid(tmp_path_factory: pytest.TempPathFactory) -> isobrick.Pyramid:
    path = tmp_path_factory.mktemp("balls") / "balls.isb"
    isobrick.build(two_balls(), path, spacing=(0.5, 0.5, 0.5), unit="mm", brick_cells=16)
    return isobrick.open(path)


def test_components_are_the_balls(pyramid: isobrick.Pyramid) -> None:
    mesh = pyramid.extract(0)
    large, half, small = mesh.components()
    assert large.volume == pytest.approx(VOLUME_OF_BALL * 4.5**3, rel=0.02)
    assert small.volume == pytest.approx(VOLUME_OF_BALL * 2.5**3, rel=0.03)
    assert half.volume is None
    assert half.enclosed == pytest.approx(VOLUME_OF_BALL * 4**3 / 2, rel=0.03)
    assert np.allclose(small.center, (6, 10, 10), atol=0.05)
    assert np.allclose(large.lower, (14.5, 5.5, 5.5), atol=0.01) and np.allclose(large.upper, (23.5, 14.5, 14.5), atol=0.01)
    numbers = mesh.component_of_faces()
    assert np.bincount(numbers).tolist() == [large.triangles, half.triangles, small.triangles]
    middles = mesh.points[mesh.faces].mean(axis=1)
    assert set(numbers[middles[:, 0] < 10]) == {2}


def test_pieces_that_are_kept(pyramid: isobrick.Pyramid) -> None:
    largest = pyramid.extract(0, keep_largest=1)
    assert largest.check().is_solid
    assert largest.volume() == pytest.approx(VOLUME_OF_BALL * 4.5**3, rel=0.02)
    assert len(largest.components()) == 1
    assert largest.report.triangles == len(largest.faces) and largest.report.levels is None
    assert largest.faces.max() == len(largest.points) - 1
    area_of_small = 4 * np.pi * 2.5**2
    assert len(pyramid.extract(0, drop_below=1.1 * area_of_small).components()) == 2
    assert len(pyramid.extract(0, drop_below=0.9 * area_of_small).components()) == 3
    assert len(pyramid.extract(0, drop_below=1e9).faces) == 0
    session = pyramid.session()
    session.extract(0, keep_largest=2)
    assert session.extract(0).report.levels is not None
    assert len(session.extract(0).components()) == 3  # memory of the former mesh is used again


@pytest.mark.parametrize("words", [("--keep-largest", 1), ("--keep-largest", 2, "--simplify", 0.2), ("--drop-below", 80), ("--triangles", 900)])
def test_files_are_the_command_s(
    pyramid: isobrick.Pyramid, command: Callable[..., str], tmp_path: Path, words: tuple[object, ...]
) -> None:
    command("extract", pyramid.path, "--iso", 0, *words, "-o", tmp_path / "theirs.ply")
    pairs = iter(words)
    choice = {str(name)[2:].replace("-", "_"): value for name, value in zip(pairs, pairs)}
    if "simplify" in choice:
        choice["simplify"] = 0.2 * 0.5  # in the world
    pyramid.extract_to(tmp_path / "ours.ply", 0, **choice)
    assert (tmp_path / "ours.ply").read_bytes() == (tmp_path / "theirs.ply").read_bytes()
    in_memory = pyramid.extract(0, **choice)
    in_memory.save(tmp_path / "saved.ply")
    assert (tmp_path / "saved.ply").read_bytes() == (tmp_path / "theirs.ply").read_bytes()


def test_several_isovalues(pyramid: isobrick.Pyramid) -> None:
    volumes = [mesh.volume() for mesh in pyramid.extract_each([0, 1, 2], keep_largest=1)]
    assert np.allclose(volumes, [VOLUME_OF_BALL * r**3 for r in (4.5, 4, 3.5)], rtol=0.03)


def test_files_of_pieces_report_what_is_in_them(pyramid: isobrick.Pyramid, tmp_path: Path) -> None:
    report = pyramid.extract_to(tmp_path / "a.ply", 0, keep_largest=1)
    mesh = pyramid.extract(0, keep_largest=1)
    assert (report.triangles, report.vertices, report.levels) == (len(mesh.faces), len(mesh.points), None)


def test_the_last_of_progressive_queries_is_that_of_extract(pyramid: isobrick.Pyramid) -> None:
    *_, last = pyramid.session().progressive(0, triangles=900, drop_small=True)
    assert len(last.faces) <= 900
    assert np.array_equal(last.points, pyramid.extract(0, triangles=900, drop_small=True).points)
    *_, simplified = pyramid.session().progressive(0, simplify=0.3)
    assert np.array_equal(simplified.points, pyramid.extract(0, simplify=0.3).points)
    *_, whole = pyramid.session().progressive(0, triangles=10**6, drop_small=True)
    assert len(whole.faces) == len(pyramid.extract(0).faces)


def test_all_channels_and_times(tmp_path: Path) -> None:
    stack = np.arange(2 * 2 * 20**3).reshape(2, 2, 20, 20, 20).astype(np.uint16)
    axes = [{"name": "t", "type": "time"}, {"name": "c", "type": "channel"}]
    axes += [{"name": name, "type": "space"} for name in "zyx"]
    group = zarr.open_group(tmp_path / "run.ome.zarr", mode="w", zarr_format=2)
    group.create_array("0", data=stack, chunks=(1, 1, 20, 20, 20))
    scale = {"type": "scale", "scale": [1, 1, 1, 1, 1]}
    group.attrs["multiscales"] = [
        {"version": "0.4", "axes": axes, "datasets": [{"path": "0", "coordinateTransformations": [scale]}]}
    ]
    group.attrs["omero"] = {"channels": [{"label": "red", "color": "FF0000"}, {"label": "green", "color": "00FF00"}]}

    run = tmp_path / "run.ome.zarr"
    report = isobrick.build(run, tmp_path / "{channel}-{time}.isb", channel="all", time="all")
    assert sorted(Path(one).name for one in report.outputs) == ["green-0.isb", "green-1.isb", "red-0.isb", "red-1.isb"]
    for c, channel in enumerate(["red", "green"]):
        for t in range(2):
            with isobrick.open(tmp_path / f"{channel}-{t}.isb") as one:
                assert np.array_equal(np.asarray(one.level(0))[:20, :20, :20], stack[t, c])
    with pytest.raises(ValueError, match="channel"):
        isobrick.build(run, tmp_path / "one.isb", channel="all")
    with pytest.raises(ValueError, match="array"):
        isobrick.build(stack[0, 0], tmp_path / "{channel}.isb", channel="all")
    micro = isobrick.build(run, tmp_path / "um-{channel}.isb", channel="all", unit="um")
    with isobrick.open(micro.outputs[0]) as one:
        assert one.unit == "millimetres" and np.allclose(one.spacing, 0.001)
    isobrick.build(run, tmp_path / "run.ome.isb")  # beside the volume, of its first channel and time
    opened = isobrick.open_each(run, select={"time": 1}, cache_folder=tmp_path / "cache")
    assert [one.provenance["channel"]["name"] for one in opened] == ["red", "green"]
    assert [one.value_range[1] for one in opened] == [stack[1, c].max() for c in range(2)]


def test_the_pyramid_beside_a_volume_is_each_of_one(tmp_path: Path) -> None:
    ball().astype(np.float32).tofile(tmp_path / "ball.raw")
    nz, ny, nx = ball().shape
    header = f"NRRD0004\ntype: float\ndimension: 3\nsizes: {nx} {ny} {nz}\nendian: little\nencoding: raw\n"
    (tmp_path / "ball.nhdr").write_text(header + "data file: ball.raw\n")
    isobrick.build(tmp_path / "ball.nhdr", tmp_path / "ball.isb")
    (one,) = isobrick.open_each(tmp_path / "ball.nhdr", cache_folder=tmp_path / "cache")
    assert one.path == str(tmp_path / "ball.isb")
    with pytest.raises(isobrick.Error, match="is a pyramid"):
        isobrick.open_each(tmp_path / "ball.isb")


def test_warnings_of_the_command_are_those_of_python(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from isobrick import _by_command

    command = tmp_path / "isobrick"
    command.write_text("#!/bin/sh\necho 'isobrick: warning: the cache is full' >&2\necho '{}'\n")
    command.chmod(0o755)
    monkeypatch.setattr(_by_command, "executable", lambda: command)
    with pytest.warns(RuntimeWarning, match="the cache is full"):
        _by_command.run_command("build", ["a.nrrd"], {})


def test_urls_are_not_among_the_words_of_processes(pyramid: isobrick.Pyramid, monkeypatch: pytest.MonkeyPatch) -> None:
    from isobrick import _by_command

    monkeypatch.setenv("A_PYRAMID", pyramid.path)
    assert _by_command.run_command("info", ["env:A_PYRAMID"], {})["dimensions"] == [72, 48, 40]
    with pytest.raises(isobrick.Error, match="NO_PYRAMID"):
        _by_command.run_command("info", ["env:NO_PYRAMID"], {})


def test_units_of_arrays_and_files(tmp_path: Path) -> None:
    isobrick.build(ball(), tmp_path / "a.isb", spacing=(5, 5, 5), origin=(10, 0, 0), unit="um")
    with isobrick.open(tmp_path / "a.isb") as micro:
        assert micro.unit == "millimetres"
        assert np.allclose(micro.spacing, 0.005) and np.allclose(micro.origin, (0.01, 0, 0))
    assert isobrick.isosurface(ball(), 0, unit="inch").unit == "millimetres"
    with pytest.raises(ValueError, match="parsec"):
        isobrick.build(ball(), tmp_path / "b.isb", unit="parsec")
    isobrick.build("phantom:head:16", tmp_path / "b.isb", spacing=(0.5, 0.5, 2), unit="um")
    with isobrick.open(tmp_path / "b.isb") as head:
        assert head.unit == "millimetres" and np.allclose(head.spacing, (0.0005, 0.0005, 0.002))


def test_errors_are_those_of_python(pyramid: isobrick.Pyramid, tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError) as missing:
        isobrick.open(tmp_path / "missing.isb")
    assert isinstance(missing.value, isobrick.Error) and missing.value.path == str(tmp_path / "missing.isb")
    with pytest.raises(FileNotFoundError):
        isobrick.build(tmp_path / "missing.nrrd", tmp_path / "out.isb")
    (tmp_path / "there.ply").touch()
    with pytest.raises(FileExistsError, match="force=True"):
        pyramid.extract_to(tmp_path / "there.ply", 0)
    with pytest.raises(IndexError):
        pyramid.level(99)
    for wrong in ({"focus": (1, 2, 3)}, {"simplify": 1, "triangles": 5}, {"triangles": 0}, {"keep_largest": 0}):
        with pytest.raises(ValueError):
            pyramid.extract(0, **wrong)  # type: ignore[arg-type]


def test_coroutines_wait(pyramid: isobrick.Pyramid, tmp_path: Path) -> None:
    async def both() -> tuple[isobrick.Mesh, isobrick.ExtractReport]:
        return await asyncio.gather(
            pyramid.extract_async(0, keep_largest=1), pyramid.extract_to_async(tmp_path / "a.ply", 0)
        )

    mesh, report = asyncio.run(both())
    assert len(mesh.components()) == 1 and report.triangles > len(mesh.faces)


def test_a_task_that_is_cancelled_ends_the_call(head: Path) -> None:
    cancel = isobrick.Cancel()
    ended: list[str] = []

    def tell(phase: str, fraction: float) -> None:
        ended.append("running")

    async def late() -> None:
        with isobrick.open(head) as pyramid:
            task = asyncio.ensure_future(
                pyramid.extract_async(500, simplify=0.3, triangles=None, progress=tell, cancel=cancel)
            )
            await asyncio.sleep(0)
            task.cancel()
            with pytest.raises(asyncio.CancelledError):
                await task

    asyncio.run(late())


def test_volumes_open(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    with isobrick.open("phantom:sphere:24") as pyramid:
        assert pyramid.shape == (24, 24, 24) and pyramid.path.startswith(str(tmp_path / "cache"))
    isobrick.convert("phantom:sphere:24", tmp_path / "sphere.nrrd")
    with isobrick.open(tmp_path / "sphere.nrrd", spacing=(1, 1, 2)) as pyramid:
        assert pyramid.spacing == (1, 1, 2)
    with pytest.raises(ValueError, match="build"):
        isobrick.open(pyramid.path, spacing=(1, 1, 2))


def test_conversions(pyramid: isobrick.Pyramid, tmp_path: Path) -> None:
    said = isobrick.convert(pyramid, tmp_path / "box.raw", level=1, box_voxels=((0, 0, 0), (20, 30, 38)))
    assert said["output"] == str(tmp_path / "box.raw")
    voxels = np.fromfile(tmp_path / "box.raw", np.float32).reshape(20, 16, 11)
    assert np.array_equal(voxels, np.asarray(pyramid.level(1)[:20, :16, :11]))
    with pytest.raises(FileExistsError) as exists:
        isobrick.convert(pyramid, tmp_path / "box.raw")
    assert exists.value.path == str(tmp_path / "box.raw")  # type: ignore[attr-defined]
    with pytest.warns(FutureWarning, match="box_voxels"):
        isobrick.convert(pyramid, tmp_path / "box.raw", level=1, box=((0, 0, 0), (20, 30, 38)), force=True)
    assert np.array_equal(np.fromfile(tmp_path / "box.raw", np.float32), voxels.ravel())
    with pytest.raises(ValueError, match="--tpye"):
        isobrick.convert(pyramid, tmp_path / "other.raw", tpye="f32")


def test_pictures(pyramid: isobrick.Pyramid, tmp_path: Path) -> None:
    picture = isobrick.render(pyramid, [0, 2], size=(80, 60), color=["red", "#00ff00"], background="#0000ff")
    assert picture.shape == (60, 80, 3) and picture.dtype == np.uint8
    assert picture[0, 0].tolist() == [0, 0, 255]
    assert np.any((picture[..., 0] > 100) & (picture[..., 2] < 100))
    isobrick.render(pyramid, 0, tmp_path / "a.png", size=(80, 60), azimuth=90)
    assert (tmp_path / "a.png").stat().st_size > 100
    with pytest.raises(FileExistsError):
        isobrick.render(pyramid, 0, tmp_path / "a.png")
    cut = isobrick.render(pyramid, 0, size=(80, 60), sphere=(19, 10, 10, 5))
    assert np.array_equal(cut, isobrick.render(pyramid, 0, size=(80, 60), sphere_voxels=(38, 20, 20, 10)))
    assert not np.array_equal(cut, isobrick.render(pyramid, 0, size=(80, 60)))
    with pytest.raises(ValueError, match="all in one"):
        isobrick.render(pyramid, 0, focus=(1, 2, 3), radius_voxels=3)


def test_doctests(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    tried = 0
    for module in pkgutil.iter_modules(isobrick.__path__):
        if module.name in ("paraview", "paraview_plugin", "napari_plugin", "vtk", "dask", "_core", "_volumes"):
            continue
        result = doctest.testmod(importlib.import_module(f"isobrick.{module.name}"), extraglobs={"np": np, "isobrick": isobrick},
                                 optionflags=doctest.ELLIPSIS)
        assert result.failed == 0
        tried += result.attempted
    assert tried >= 10


def test_lengths_with_a_unit_are_in_the_world(pyramid: isobrick.Pyramid, command: Callable[..., str], tmp_path: Path) -> None:
    words = ["--focus", "19,10,10mm", "--radius", "2000um", "--box", "10,0,0,30,19,19mm", "--simplify", "0.01cm"]
    command("extract", pyramid.path, "--iso", 0, *words, "-o", tmp_path / "theirs.ply")
    box = ((10, 0, 0), (30, 19, 19))
    pyramid.extract_to(tmp_path / "ours.ply", 0, focus=(19, 10, 10), radius=2, box=box, simplify=0.1)
    assert (tmp_path / "ours.ply").read_bytes() == (tmp_path / "theirs.ply").read_bytes()
