"""OME-Zarr that isobrick writes, read by the libraries of others, and read by isobrick behind URLs."""

from __future__ import annotations

import json
import os
import shutil
import urllib.request
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import zarr
from numpy.typing import NDArray
from test_remote import Server, bucket, clean  # noqa: F401 - fixtures

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
        command("convert", tmp_path / "head.isb", "-o", out, "--all-levels", "--zarr-version", version)
        group = zarr.open_group(out, mode="r")
        image = open_ome_zarr(group)
        assert image.ome_zarr_version == expected
        with isobrick.open(tmp_path / "head.isb") as pyramid:
            for level, array in enumerate(pyramid.levels):
                assert np.array_equal(group[str(level)][:], array[:])
    array = json.loads((tmp_path / "0.5.ome.zarr/1/zarr.json").read_text())
    assert array["dimension_names"] == ["z", "y", "x"]


def test_parts_make_the_same_bytes(command: Command, tmp_path: Path) -> None:
    values = volume("uint16")
    write_nrrd(tmp_path / "in.nrrd", values)
    command("build", tmp_path / "in.nrrd", "-o", tmp_path / "in.isb")
    for source, more in (("in.nrrd", ()), ("in.isb", ("--all-levels",))):
        whole, out = tmp_path / f"whole-{source}.ome.zarr", tmp_path / f"{source}.ome.zarr"
        words = ("convert", tmp_path / source, "--zarr-shard", 64, *more)
        command(*words, "-o", whole)
        for part in (3, 1, 2):
            assert not out.exists()
            command(*words, "-o", out, "--part", f"{part}/3")
        files = {file.relative_to(whole) for file in whole.rglob("*") if file.is_file()}
        assert files == {file.relative_to(out) for file in out.rglob("*") if file.is_file()}
        for file in files:
            assert (whole / file).read_bytes() == (out / file).read_bytes()
        assert not list(tmp_path.glob("*part*"))
    # Parts of another volume are noticed.
    out = tmp_path / "mixed.ome.zarr"
    command("convert", tmp_path / "in.nrrd", "-o", out, "--part", "1/2")
    with pytest.raises(AssertionError, match="part 1 of 2 is of another volume"):
        command("convert", tmp_path / "in.isb", "-o", out, "--part", "2/2")
    assert not out.exists()


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


# ---- behind URLs


@pytest.fixture(scope="module")
def stores(tmp_path_factory: pytest.TempPathFactory, command: Command) -> Path:
    """A folder with one volume as three.zarr, two.zarr, and consolidated.zarr (version 2)."""
    folder = tmp_path_factory.mktemp("stores")
    write_nrrd(folder / "in.nrrd", volume("uint16"))
    command("convert", folder / "in.nrrd", "-o", folder / "three.zarr", "--zarr-shard", 128)
    command("convert", folder / "in.nrrd", "-o", folder / "two.zarr", "--zarr-version", 2)
    shutil.copytree(folder / "two.zarr", folder / "consolidated.zarr")
    zarr.consolidate_metadata(str(folder / "consolidated.zarr"), zarr_format=2)
    for name, method in (("three", zipfile.ZIP_STORED), ("two", zipfile.ZIP_STORED), ("packed", zipfile.ZIP_DEFLATED)):
        store = folder / f"{name.replace('packed', 'two')}.zarr"
        with zipfile.ZipFile(folder / f"{name}.ozx", "w", method) as archive:
            for file in sorted(store.rglob("*"), key=str):
                if file.is_file():
                    archive.write(file, file.relative_to(store))
    return folder


@pytest.fixture
def server(stores: Path) -> Iterator[Server]:
    running = Server(stores)
    yield running
    assert running.process.stdin is not None
    running.process.stdin.close()
    running.process.wait()


def asked(server: Server) -> list[str]:
    """The paths that were asked for so far."""
    with urllib.request.urlopen(server.url("stats"), timeout=10) as answer:
        return [request["path"] for request in json.load(answer)["requests"]]


def asked_ranges(server: Server, within: str = "") -> list[tuple[int, int]]:
    """The ranges of such paths that were asked for so far, as first and last byte."""
    with urllib.request.urlopen(server.url("stats"), timeout=10) as answer:
        requests = [r for r in json.load(answer)["requests"] if within in r["path"]]
    return [(r["first"], r["last"]) for r in requests if r["first"] is not None]


@pytest.mark.parametrize("name", ["three.zarr", "two.zarr", "consolidated.zarr", "three.zarr/0", "two.zarr/0/"])
def test_a_store_behind_http_is_the_one_in_the_folder(
    server: Server, stores: Path, command: Command, tmp_path: Path, name: str
) -> None:
    values = volume("uint16")
    assert np.array_equal(read_raw(command, server.url(f"good/{name}"), tmp_path, "uint16"), values)
    chunks = [path for path in asked(server) if os.path.basename(path).isdigit()]
    if "three" not in name:
        assert len(chunks) == len(set(chunks)) == 2 * 3 * 4, "each once"
    else:
        bytes_read = sum(last + 1 - first for first, last in asked_ranges(server, "/c/"))
        stored = sum(file.stat().st_size for file in (stores / "three.zarr/0/c").rglob("*") if file.is_file())
        assert bytes_read <= 1.15 * stored
    about = json.loads(command("convert", server.url(f"good/{name}"), "-o", tmp_path / "x.raw", "--json"))
    assert about["spacing"] == list(SPACING) and about["origin"] == list(ORIGIN)


@pytest.mark.parametrize("name", ["three.ozx", "two.ozx", "packed.ozx", "three.ozx/0"])
def test_a_zipped_store_behind_http_is_the_one_in_the_folder(
    server: Server, stores: Path, command: Command, tmp_path: Path, name: str
) -> None:
    url = server.url(f"good/{name}")
    about = json.loads(command("info", url, "--json"))
    assert about["dimensions"] == list(SHAPE[::-1]) and about["spacing"] == list(SPACING)
    begun = len(asked_ranges(server))
    assert np.array_equal(read_raw(command, url, tmp_path, "uint16"), volume("uint16"))
    bytes_read = sum(last + 1 - first for first, last in asked_ranges(server)[begun:])
    size = (stores / name.split("/")[0]).stat().st_size
    assert bytes_read < 1.15 * size + (150 << 10), "its table, and each member once"
    out = tmp_path / "box.raw"
    begun = len(asked_ranges(server))
    command("convert", url, "-o", out, "--box", "130,70,5,190,120,60")
    assert np.array_equal(np.fromfile(out, "uint16").reshape(56, 51, 61), volume("uint16")[5:61, 70:121, 130:191])
    if name != "three.ozx/0":
        assert sum(last + 1 - first for first, last in asked_ranges(server)[begun:]) < size / 2
        isobrick.build(url, tmp_path / "zipped.isb")
        with isobrick.open(tmp_path / "zipped.isb") as pyramid:
            assert np.array_equal(pyramid.levels[0][:], volume("uint16"))


def test_a_zipped_store_that_changes_is_noticed(server: Server, command: Command, tmp_path: Path) -> None:
    with pytest.raises(AssertionError, match="was changed while it was open"):
        command("convert", server.url("changes/etag/three.ozx"), "-o", tmp_path / "x.raw")
    with pytest.raises(AssertionError, match="no such file"):
        command("info", server.url("good/none.ozx"))


def test_only_what_a_box_needs_is_read(server: Server, command: Command, tmp_path: Path) -> None:
    out = tmp_path / "box.raw"
    command("convert", server.url("good/two.zarr"), "-o", out, "--box", "130,70,5,190,120,60")
    found = np.fromfile(out, "uint16").reshape(56, 51, 61)
    assert np.array_equal(found, volume("uint16")[5:61, 70:121, 130:191])
    assert [path for path in asked(server) if path.startswith("/good/two.zarr/0/0/")] == ["/good/two.zarr/0/0/1/2"]


def test_info_costs_the_metadata_alone(server: Server, command: Command) -> None:
    about = json.loads(command("info", server.url("good/three.zarr"), "--json"))
    assert about["dimensions"] == list(SHAPE[::-1]) and about["voxel_type"] == "uint16"
    assert not any("/c/" in path for path in asked(server))
    assert len(asked(server)) == len(set(asked(server)))


def test_everything_takes_a_store(server: Server, stores: Path, command: Command, tmp_path: Path) -> None:
    near, far = stores / "three.zarr", server.url("good/three.zarr")
    for number, source in enumerate((near, far)):
        cache = ("--cache-folder", tmp_path / "cache")
        command("build", source, "-o", tmp_path / f"{number}.isb")
        command("extract", source, "--iso", 65500, "-o", tmp_path / f"{number}.ply")
        command("extract", source, "--iso", 46000, "--level", 1, *cache, "-o", tmp_path / f"{number}-1.ply")
    for name in ("{}.ply", "{}-1.ply"):
        assert (tmp_path / name.format(0)).read_bytes() == (tmp_path / name.format(1)).read_bytes()
    before = len(asked(server))
    command("extract", far, "--iso", 46000, "--level", 1, *cache, "-o", tmp_path / "again.ply")
    assert not any("/c/" in path for path in asked(server)[before:]), "its pyramid is in the cache"
    isobrick.build(far, tmp_path / "python.isb")
    with isobrick.open(tmp_path / "python.isb") as pyramid:
        assert np.array_equal(pyramid.levels[0][:], volume("uint16"))


def test_only_404_is_the_fill_value(
    server: Server, stores: Path, command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Zeros have no file, and isobrick says how many chunks that were.
    about = command("convert", server.url("good/two.zarr"), "-o", tmp_path / "x.raw")
    assert "4 of the 24 chunks that were read are not in the store" in about
    chunk = stores / "two.zarr/0/1/2/3"
    os.rename(chunk, tmp_path / "kept")
    try:
        found = read_raw(command, server.url("good/two.zarr"), tmp_path, "uint16")
        assert not found[64:, 128:, 192:].any()
    finally:
        os.rename(tmp_path / "kept", chunk)
    monkeypatch.setenv("ISOBRICK_HTTP_TIMEOUT", "1")
    for behaviour, said in (
        ("refuses-chunks/403", "refuses access (403)"),
        ("refuses-chunks/410", "no such file (410)"),
        ("refuses-chunks/500", "busy or fails (500)"),
        ("cuts-chunks", "fewer bytes"),
    ):
        with pytest.raises(AssertionError, match=said.replace("(", r"\(").replace(")", r"\)")):
            command("convert", server.url(f"{behaviour}/two.zarr"), "-o", tmp_path / "y.raw")
    found = read_raw(command, server.url("once-busy/three.zarr"), tmp_path, "uint16")
    assert np.array_equal(found, volume("uint16")), "tried again"


def test_a_shard_that_changes_is_noticed(server: Server, command: Command, tmp_path: Path) -> None:
    with pytest.raises(AssertionError, match="was changed while it was open"):
        command("convert", server.url("changes/etag/three.zarr"), "-o", tmp_path / "x.raw")
    assert not (tmp_path / "x.raw").exists()


def test_failures_are_one_line(server: Server, command: Command, tmp_path: Path) -> None:
    for words, said in (
        (("info", server.url("good/none.zarr")), "no metadata of a Zarr store"),
        (("info", server.url("fails/403/first/three.zarr")), "refuses access"),
        (("info", "http://127.0.0.1:1/x.zarr"), "cannot be reached"),
        (("build", server.url("good/in.nrrd"), "-o", tmp_path / "x.isb"), "OME-Zarr alone"),
        (("convert", server.url("good/three.zarr") + "?sig=1", "-o", tmp_path / "x.raw"), "many files"),
    ):
        with pytest.raises(AssertionError, match=said):
            command(*words)


def test_a_store_in_s3(
    bucket: str,  # noqa: F811
    clean: pytest.MonkeyPatch,  # noqa: F811
    stores: Path,
    command: Command,
    tmp_path: Path,
) -> None:
    import boto3

    client = boto3.client(
        "s3", endpoint_url=bucket, region_name="us-east-1", aws_access_key_id="id", aws_secret_access_key="secret"
    )
    for name in ("three.zarr", "two.zarr"):
        for file in (stores / name).rglob("*"):
            if file.is_file():
                client.upload_file(str(file), "scans", f"a b/{name}/{file.relative_to(stores / name)}")
    clean.setenv("AWS_ENDPOINT_URL", bucket)
    clean.setenv("AWS_ACCESS_KEY_ID", "id")
    clean.setenv("AWS_SECRET_ACCESS_KEY", "secret")
    for name in ("three.zarr", "two.zarr"):
        found = read_raw(command, f"s3://scans/a b/{name}", tmp_path, "uint16")
        assert np.array_equal(found, volume("uint16"))
    # Google's storage speaks the same language, under names of its own.
    clean.setenv("STORAGE_EMULATOR_HOST", bucket)
    clean.setenv("GS_ACCESS_KEY_ID", "id")
    clean.setenv("GS_SECRET_ACCESS_KEY", "secret")
    assert np.array_equal(read_raw(command, "gs://scans/a b/three.zarr", tmp_path, "uint16"), volume("uint16"))
    clean.delenv("GS_ACCESS_KEY_ID")
    clean.delenv("GS_SECRET_ACCESS_KEY")
    with pytest.raises(AssertionError, match="refuses access"):
        command("info", "gs://scans/a b/three.zarr")
    clean.delenv("AWS_ACCESS_KEY_ID")
    clean.delenv("AWS_SECRET_ACCESS_KEY")
    with pytest.raises(AssertionError, match="refuses access"):
        command("info", "s3://scans/a b/three.zarr")
