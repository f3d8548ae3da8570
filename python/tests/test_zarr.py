"""OME-Zarr that isobrick writes, read by the libraries of others."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import zarr
from numpy.typing import NDArray

import isobrick

Command = Callable[..., str]

SHAPE = (70, 133, 200)  # z, y, x: a part of a chunk at every end
SPACING = (0.5, 0.75, 2.0)  # x, y, z
ORIGIN = (10.0, -20.0, 30.0)


def volume(dtype: str) -> NDArray[np.generic]:
    """Numbers of the whole range of the type, and a corner of zeros that is larger than a chunk."""
    random = np.random.default_rng(1)
    if np.dtype(dtype).kind == "f":
        values = random.normal(size=SHAPE).astype(dtype)
    else:
        info = np.iinfo(dtype)
        values = random.integers(info.min, info.max, SHAPE, dtype=dtype, endpoint=True)
    values[:, :64, :128] = 0
    return values


def write_nrrd(path: Path, values: NDArray[np.generic]) -> None:
    directions = " ".join(
        "(" + ",".join(str(SPACING[i] if i == axis else 0) for i in range(3)) + ")" for axis in range(3)
    )
    kind = {"f": {4: "float", 8: "double"}}.get(values.dtype.kind, {}).get(values.itemsize, values.dtype.name)
    header = (
        f"NRRD0004\ntype: {kind}\ndimension: 3\nspace: left-posterior-superior\n"
        f"sizes: {values.shape[2]} {values.shape[1]} {values.shape[0]}\nspace directions: {directions}\n"
        f'space units: "mm" "mm" "mm"\nspace origin: ({",".join(map(str, ORIGIN))})\nendian: little\n'
        "encoding: raw\n\n"
    )
    path.write_bytes(header.encode() + values.astype(values.dtype.newbyteorder("<")).tobytes())


def read_raw(command: Command, source: object, folder: Path, dtype: str, *more: object) -> NDArray[np.generic]:
    command("convert", source, "-o", folder / "back.raw", "--force", *more)
    return np.fromfile(folder / "back.raw", dtype).reshape(SHAPE)


@pytest.mark.parametrize("dtype", ["uint8", "int8", "uint16", "int16", "float32", "uint32", "int32", "float64"])
def test_version_05_is_read_by_others(command: Command, tmp_path: Path, dtype: str) -> None:
    import tensorstore

    values = volume(dtype)
    write_nrrd(tmp_path / "in.nrrd", values)
    out = tmp_path / "out.ome.zarr"
    shard = () if dtype == "int16" else ("--zarr-shard", 128)
    command("convert", tmp_path / "in.nrrd", "-o", out, *shard)
    group = zarr.open_group(out, mode="r")
    array = group["0"]
    assert isinstance(array, zarr.Array)
    assert group.metadata.zarr_format == 3 and array.dtype == np.dtype(dtype)
    assert array.chunks == (64, 64, 64)
    assert array.shards == ((128, 192, 256) if not shard else (128, 128, 128))
    assert np.array_equal(array[:], values)
    store = tensorstore.open({"driver": "zarr3", "kvstore": {"driver": "file", "path": str(out / "0")}}).result()
    assert np.array_equal(store.read().result(), values)
    assert np.array_equal(read_raw(command, out, tmp_path, dtype), values)


def test_a_shard_of_zeros_is_no_file(command: Command, tmp_path: Path) -> None:
    write_nrrd(tmp_path / "in.nrrd", volume("uint16"))
    command("convert", tmp_path / "in.nrrd", "-o", tmp_path / "out.zarr", "--zarr-shard", 64)
    files = {str(p.relative_to(tmp_path / "out.zarr/0")) for p in (tmp_path / "out.zarr/0").rglob("*") if p.is_file()}
    chunks = {f"c/{z}/{y}/{x}" for z in range(2) for y in range(3) for x in range(4)}
    assert files == {"zarr.json"} | chunks - {f"c/{z}/0/{x}" for z in range(2) for x in range(2)}


def test_bytes_depend_neither_on_threads_nor_on_memory(command: Command, tmp_path: Path) -> None:
    write_nrrd(tmp_path / "in.nrrd", volume("uint16"))
    found = []
    for number, how in enumerate((("--threads", 1), ("--threads", 2), ("--memory", "40M", "--threads", 2))):
        out = tmp_path / f"{number}.ome.zarr"
        command("convert", tmp_path / "in.nrrd", "-o", out, "--zarr-shard", 128, *how)
        files = sorted(p for p in out.rglob("*") if p.is_file())
        found.append([(p.relative_to(out), p.read_bytes()) for p in files])
    assert found[0] == found[1] == found[2] and len(found[0]) == 2 + 4


def test_metadata_are_those_of_the_specification(command: Command, tmp_path: Path) -> None:
    """By ome-zarr-models, which checks what the schemas of OME-Zarr check, and more."""
    from ome_zarr_models import open_ome_zarr

    isobrick.build("phantom:head:96", tmp_path / "head.isb")
    for version, expected in ((3, "0.5"), (2, "0.4")):
        out = tmp_path / f"{expected}.ome.zarr"
        command("convert", tmp_path / "head.isb", "-o", out, "--levels", "all", "--zarr-version", version)
        group = zarr.open_group(out, mode="r")
        image = open_ome_zarr(group)
        assert image.ome_zarr_version == expected
        with isobrick.open(tmp_path / "head.isb") as pyramid:
            for level, array in enumerate(pyramid.levels):
                assert np.array_equal(group[str(level)][:], array[:])
    array = json.loads((tmp_path / "0.5.ome.zarr/1/zarr.json").read_text())
    assert array["dimension_names"] == ["z", "y", "x"]


def test_ngff_zarr_reads_both(command: Command, tmp_path: Path) -> None:
    import ngff_zarr

    values = volume("uint16")
    write_nrrd(tmp_path / "in.nrrd", values)
    for version in (3, 2):
        out = tmp_path / f"{version}.ome.zarr"
        command("convert", tmp_path / "in.nrrd", "-o", out, "--zarr-version", version)
        image = ngff_zarr.from_ngff_zarr(str(out), validate=True).images[0]
        assert np.array_equal(np.asarray(image.data), values)
        assert image.dims == ("z", "y", "x")
        assert [image.scale[axis] for axis in "xyz"] == list(SPACING)
        assert [image.translation[axis] for axis in "xyz"] == list(ORIGIN)
        assert image.axes_units == {axis: "millimeter" for axis in "zyx"}
