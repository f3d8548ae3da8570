"""Pyramids and surfaces by dask.distributed, with several worker processes."""

from __future__ import annotations

import filecmp
import os
import signal
import time
from pathlib import Path

import numpy as np
import pytest

import isobrick

distributed = pytest.importorskip("distributed")
import dask.array  # noqa: E402

import isobrick.dask  # noqa: E402


@pytest.fixture(scope="module")
def client():
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, memory_limit="600MiB", dashboard_address=None
    ) as cluster, distributed.Client(cluster) as client:
        yield client


def blob(size: int) -> np.ndarray:
    z, y, x = np.ogrid[:size, :size, :size]
    return (100 + 60 * np.sin(x / 7) * np.cos(y / 9) + 40 * np.sin(z / 5)).astype(np.uint8)


def same_values(a: Path, b: Path) -> None:
    with isobrick.open(a) as first, isobrick.open(b) as second:
        assert first.value_range == second.value_range
        assert np.array_equal(first.histogram().counts, second.histogram().counts)
        for one, other in zip(first.levels, second.levels, strict=True):
            assert np.array_equal(one[...], other[...])
        assert not first.verify()


def test_parts_and_join_without_dask(tmp_path: Path) -> None:
    volume = blob(90)
    whole, divided = tmp_path / "whole.isb", tmp_path / "divided.isbs"
    isobrick.build(volume, whole, brick_cells=8)
    for part in (2, 3, 1):
        report = isobrick.build(volume, divided, brick_cells=8, super_brick=32, part=(part, 3))
        assert report.super_bricks_built == 9 and report.super_bricks_up_to_date == 0
    with pytest.raises(isobrick.Error, match="index.isb"):
        isobrick.open(divided)
    joined = isobrick.join(divided)
    assert joined.super_bricks == 27
    same_values(divided, whole)
    again = isobrick.build(volume, divided, brick_cells=8, super_brick=32)
    assert again.super_bricks_built == 0 and again.super_bricks_up_to_date == 27
    with pytest.raises(isobrick.Error, match="force=True"):
        isobrick.build(volume, divided, brick_cells=8, super_brick=32, codec="none")
    with pytest.raises(isobrick.Error, match="ending .isbs"):
        isobrick.build(volume, tmp_path / "x.isb", part=(1, 2))
    with isobrick.open(divided) as pyramid:
        shares = []
        for number in (1, 2, 3):
            shares.append(tmp_path / f"{number}.isbm")
            pyramid.extract_to(shares[-1], 110, part=(number, 3))
        pyramid.extract_to(tmp_path / "one.ply", 110)
        parts = [pyramid.extract(110, part=(number, 3)) for number in (1, 2, 3)]
        assert sum(len(part.faces) for part in parts) == len(pyramid.extract(110).faces)
    merged = isobrick.merge(shares[::-1], tmp_path / "merged.ply")
    assert merged.shares == 3
    assert filecmp.cmp(tmp_path / "merged.ply", tmp_path / "one.ply", shallow=False)
    with pytest.raises(isobrick.Error, match="2/3"):
        isobrick.merge([shares[0], shares[2]], tmp_path / "lost.ply")


@pytest.mark.parametrize("kind", ["path", "dask", "persisted", "zarr"])
def test_build_and_extract(client, tmp_path: Path, kind: str) -> None:
    volume = blob(100)
    whole = tmp_path / "whole.isb"
    isobrick.build(volume, whole, brick_cells=8, spacing=(0.5, 0.5, 2.0))
    if kind == "path":
        source = tmp_path / "volume.raw"
        volume.tofile(source)
        more = {"raw": isobrick.RawLayout(volume.shape, "u8")}
    else:
        more = {}
        if kind == "zarr":
            import zarr

            stored = zarr.create_array(str(tmp_path / "volume.zarr"), shape=volume.shape, dtype="u1", chunks=(30, 40, 50))
            stored[...] = volume
            source = zarr.open_array(str(tmp_path / "volume.zarr"), mode="r")
        else:
            source = dask.array.from_array(volume, chunks=(33, 25, 40))
            if kind == "persisted":
                source = client.persist(source)
    out = tmp_path / "built.isbs"
    report = isobrick.dask.build(
        source, out, client=client, brick_cells=8, super_brick=32, spacing=(0.5, 0.5, 2.0), **more
    )
    assert report.super_bricks == 64
    same_values(out, whole)
    of_another_call = tmp_path / "mesh.ply.shares" / "1-of-9.isbm"
    of_another_call.parent.mkdir()
    of_another_call.touch()
    merged = isobrick.dask.extract(out, 110, tmp_path / "mesh.ply", client=client, parts=5)
    with isobrick.open(whole) as pyramid:
        pyramid.extract_to(tmp_path / "one.ply", 110)
        mesh = pyramid.extract(110)
    assert filecmp.cmp(tmp_path / "mesh.ply", tmp_path / "one.ply", shallow=False)
    assert merged.triangles == len(mesh.faces)
    assert list(of_another_call.parent.iterdir()) == [of_another_call]
    of_another_call.unlink()
    isobrick.dask.extract(out, 110, tmp_path / "mesh.ply", client=client, parts=5, force=True)
    assert not of_another_call.parent.exists()
    parts = dask.compute(*isobrick.dask.delayed_parts(out, 110, 4))
    assert sum(len(part.faces) for part in parts) == merged.triangles
    assert all(part.faces.max() < len(part.points) for part in parts if len(part.faces))


def test_a_killed_worker_costs_its_tasks_alone(client, tmp_path: Path) -> None:
    # Some seconds of work on two workers, one of which dies in the middle.
    out = tmp_path / "head.isbs"
    builder = client.submit(lambda: None)
    builder.result()
    victim = client.run(os.getpid)
    import threading

    failures: list[BaseException] = []

    def run() -> None:
        try:
            isobrick.dask.build("phantom:head:220", out, client=client, super_brick=64, brick_cells=16)
        except BaseException as failure:  # noqa: BLE001
            failures.append(failure)

    thread = threading.Thread(target=run)
    thread.start()
    while len(list(out.glob("*.isb"))) < 5:
        time.sleep(0.01)
        assert thread.is_alive()
    os.kill(next(iter(victim.values())), signal.SIGKILL)
    thread.join()
    assert not failures
    isobrick.build("phantom:head:220", tmp_path / "head.isb", brick_cells=16)
    same_values(out, tmp_path / "head.isb")


def test_failures_and_cancel(client, tmp_path: Path) -> None:
    volume = blob(70).astype(np.float32)
    volume[50, 50, 50] = np.nan
    with pytest.raises(isobrick.Error, match="not a number"):
        isobrick.dask.build(
            dask.array.from_array(volume, chunks=35), tmp_path / "nan.isbs", client=client, super_brick=32,
            brick_cells=8, retries=0,
        )  # fmt: skip
    assert not (tmp_path / "nan.isbs" / "index.isb").exists()
    with pytest.raises(isobrick.Error, match="ending"):
        isobrick.dask.build(volume, tmp_path / "x.isb", client=client)
    with pytest.raises(TypeError, match="colour"):
        isobrick.dask.build(volume, tmp_path / "x.isbs", client=client, colour=1)
    # A task that is cancelled ends soon, long before its work would.
    future = client.submit(
        isobrick.dask._build_task, "phantom:head:1200", None, isobrick.dask._FileInput(*[None] * 3, "", "", *[None] * 4),
        isobrick.dask._BuildSettings(
            str(tmp_path), False, "lz4", "average", True, 64, None, 1 << 28, 1, None, None, 2048
        ), 0, "256M", pure=False,
    )  # fmt: skip
    while not any("partial" in name for name in os.listdir(tmp_path)):
        time.sleep(0.01)
    future.cancel(force=True)
    began = time.monotonic()
    while client.run(lambda dask_worker: len(dask_worker.state.executing)) and any(
        client.run(lambda dask_worker: len(dask_worker.state.executing)).values()
    ):
        time.sleep(0.05)
        assert time.monotonic() - began < 30
