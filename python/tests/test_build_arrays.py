"""Every kind of array becomes the pyramid that its voxels say."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

import isobrick
from conftest import ball

TYPES = ["u1", "i1", "u2", "i2", "u4", "i4", "u8", "i8", "f2", "f4", "f8", "?"]


def built(source: Any, out: Path, **options: Any) -> isobrick.Pyramid:
    isobrick.build(source, out, force=True, **options)
    return isobrick.open(out)


def assert_has(pyramid: isobrick.Pyramid, array: Any) -> None:
    """The pyramid has the voxels of the array: to the bit in their own type; numbers of 32 and 64 bits to single
    precision of their range."""
    array = np.asarray(array)
    found = np.asarray(pyramid.level(0))
    if array.dtype.kind == "b":
        array = array.astype(np.uint8)
    if array.dtype.newbyteorder("=").str[1:] in ("u1", "i1", "u2", "i2", "f4"):
        assert found.dtype == array.dtype.newbyteorder("=")
        assert np.array_equal(found, array)
    else:
        reals = array.astype(np.float64)
        assert np.abs(found.astype(np.float64) - reals).max() <= 1e-7 * np.ptp(reals)


@st.composite
def strided_arrays(draw: st.DrawFn) -> Any:
    """Arrays of any type, byte order, order of axes, step and direction."""
    dtype = np.dtype(draw(st.sampled_from(TYPES))).newbyteorder(draw(st.sampled_from("<>")))
    shape = draw(st.tuples(*[st.integers(2, 9)] * 3))
    steps = draw(st.tuples(*[st.sampled_from([-3, -2, -1, 1, 2, 3])] * 3))
    order = draw(st.permutations(range(3)))
    whole = [n * abs(s) for n, s in zip(shape, steps)]
    stored = np.random.default_rng(draw(st.integers(0, 2**32))).integers(-100, 100, [whole[a] for a in order])
    stored = stored.astype(dtype) if dtype.kind != "u" else np.abs(stored).astype(dtype)
    array = stored.transpose(np.argsort(order))[tuple(slice(None, None, s) for s in steps)]
    if draw(st.booleans()):
        array = np.broadcast_to(array[:1], array.shape)
    return array


@settings(max_examples=120, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(strided_arrays())
def test_any_strides_and_byte_order(tmp_path: Path, array: Any) -> None:
    with built(array, tmp_path / "a.isb") as pyramid:
        assert pyramid.shape == array.shape
        assert_has(pyramid, array)


def test_memmap_is_read_in_place(tmp_path: Path) -> None:
    voxels = ball(48, "uint16").astype(">u2")
    voxels.tofile(tmp_path / "raw")
    mapped = np.memmap(tmp_path / "raw", ">u2", "r", shape=voxels.shape)
    with built(mapped, tmp_path / "m.isb") as pyramid:
        assert np.array_equal(np.asarray(pyramid.level(0)), voxels.astype("u2"))


def _zarr(version: int) -> Any:
    def make(array: Any, folder: Path) -> Any:
        import zarr

        z = zarr.create_array(
            store=folder / f"z{version}.zarr", shape=array.shape, chunks=(16, 20, 24), dtype=array.dtype,
            zarr_format=version,
        )  # fmt: skip
        z[...] = array
        return z

    return make


def _sharded(array: Any, folder: Path) -> Any:
    import zarr

    z = zarr.create_array(store=folder / "s.zarr", shape=array.shape, chunks=(8, 8, 8), shards=(32, 32, 32), dtype=array.dtype)
    z[...] = array
    return z


def _dask(array: Any, folder: Path) -> Any:
    import dask.array

    return dask.array.from_array(array, chunks=((10, 30), (25, 15), 40)) + 0


def _h5py(chunks: Any) -> Any:
    def make(array: Any, folder: Path) -> Any:
        import h5py

        return h5py.File(folder / "a.h5", "w").create_dataset("v", data=array, chunks=chunks)

    return make


def _tensorstore(array: Any, folder: Path) -> Any:
    import tensorstore

    spec = {"driver": "zarr", "kvstore": {"driver": "file", "path": str(folder / "ts")}}
    store = tensorstore.open(
        spec, create=True, dtype=str(array.dtype), shape=array.shape,
        chunk_layout=tensorstore.ChunkLayout(read_chunk_shape=(16, 16, 16)),
    ).result()  # fmt: skip
    store[...] = array
    return store


def _list_like(array: Any, folder: Path) -> Any:
    class Boxes:
        """Nothing but what the docs ask for."""

        shape, dtype = array.shape, array.dtype

        def __getitem__(self, box: Any) -> Any:
            return array[box]

    return Boxes()


@pytest.mark.parametrize(
    "make",
    [_zarr(2), _zarr(3), _sharded, _dask, _h5py((16, 16, 40)), _h5py(None), _tensorstore, _list_like],
    ids=["zarr2", "zarr3", "sharded", "dask", "h5py", "h5py-contiguous", "tensorstore", "boxes"],
)
@pytest.mark.parametrize("dtype", ["uint8", "int16", "float64"])
def test_chunked_arrays(make: Any, dtype: str, tmp_path: Path) -> None:
    array = ball(40, dtype)
    with built(make(array, tmp_path), tmp_path / "c.isb", memory="64M") as pyramid:
        assert_has(pyramid, array)


def test_numbers_that_no_voxel_type_holds(tmp_path: Path) -> None:
    distance = ball(40, "float64")
    cases = [
        (101325 + 0.001 * distance, 101325.0, np.float64),
        (1_700_000_000 + np.rint(100 * distance).astype(np.int32), 1.7e9, np.int32),
        (np.rint(100 * distance).astype(np.int64), 0.5, np.int16),
        (np.uint64(2**63) + np.rint(100 * distance + 10240).astype(np.uint64), 2.0**63 + 10240, np.uint64),
    ]
    for array, isovalue, dtype in cases:
        with built(array, tmp_path / "v.isb") as pyramid:
            assert pyramid.dtype == dtype
            assert_has(pyramid, array)
            low, high = pyramid.value_range
            assert abs(low - float(array.min())) <= 1e-6 * (high - low)
            mesh = pyramid.extract(isovalue)
            assert len(mesh.points) > 500
            assert all(low <= one.value <= high for one in pyramid.isovalues())


def test_the_kind_of_array_makes_no_difference(tmp_path: Path) -> None:
    array = ball(70, "uint16")
    of_numpy = built(array, tmp_path / "n.isb")
    of_dask = built(_dask_of(array), tmp_path / "d.isb", memory="64M")
    for a, b in zip(of_numpy.levels, of_dask.levels):
        assert np.array_equal(np.asarray(a), np.asarray(b))
    assert np.array_equal(of_numpy.extract(100).points, of_dask.extract(100).points)


def _dask_of(array: Any) -> Any:
    import dask.array

    return dask.array.from_array(array, chunks=32)


def test_chunks_are_read_aligned_several_at_once_and_rarely_twice(tmp_path: Path) -> None:
    array = ball(96, "uint16")
    reads: list[Any] = []
    most = [0, 0]
    lock = threading.Lock()
    together = threading.Barrier(2)

    class Counted:
        shape, dtype, chunks = array.shape, array.dtype, (32, 32, 32)

        def __getitem__(self, box: Any) -> Any:
            if box[0].stop - box[0].start == 8:  # the sample by which an array is known again
                return array[box]
            with lock:
                reads.append(box)
                most[0] += 1
                most[1] = max(most)
            if len(reads) <= 2:
                together.wait(timeout=60)  # the first two are under way at the same time, or this breaks
            with lock:
                most[0] -= 1
            return array[box]

    isobrick.build(Counted(), tmp_path / "c.isb", memory="64M")
    assert all(s.start % 32 == 0 and s.stop - s.start == 32 for box in reads for s in box)
    assert len(reads) == 27, "each chunk is read once where there is room"
    assert most[1] >= 2


def test_geometry_of_the_options(tmp_path: Path) -> None:
    turn = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]])
    with built(ball(), tmp_path / "g.isb", spacing=(0.5, 1, 2), origin=(7, 8, 9), direction=turn) as pyramid:
        assert pyramid.spacing == (0.5, 1, 2) and pyramid.origin == (7, 8, 9)
        at = pyramid.affine @ [1, 2, 3, 1]
        assert np.allclose(at[:3], np.array([7, 8, 9]) + turn @ (np.array([0.5, 1, 2]) * [1, 2, 3]))


def test_xarray_coordinates_are_geometry(tmp_path: Path) -> None:
    import xarray

    array = ball(30, "int16")
    coords = {
        "x": ("x", 5 + 0.25 * np.arange(30), {"units": "mm"}),
        "y": ("y", 9 - 0.5 * np.arange(30), {"units": "mm"}),  # falls: the axis is flipped
        "z": ("z", 1 + 2.0 * np.arange(30), {"units": "mm"}),
    }
    data = xarray.DataArray(array.transpose(2, 0, 1), coords, dims=("x", "z", "y"))
    with built(data, tmp_path / "x.isb") as pyramid:
        assert np.array_equal(np.asarray(pyramid.level(0)), array)
        assert pyramid.spacing == (0.25, 0.5, 2) and pyramid.unit == "millimetres"
        assert np.allclose((pyramid.affine @ [4, 3, 2, 1])[:3], [6, 7.5, 5])
        assert pyramid.extract(100).volume() > 0, "a flip does not turn the surface inside out"


def test_xarray_of_uneven_coordinates_is_refused(tmp_path: Path) -> None:
    import xarray

    coords = {"z": [0.0, 1, 2, 4], "y": range(4), "x": range(4)}
    data = xarray.DataArray(np.zeros((4, 4, 4)), coords, dims=("z", "y", "x"))
    with pytest.raises(isobrick.Error, match="'z' are not evenly spaced"):
        isobrick.build(data, tmp_path / "x.isb")


def test_simpleitk_and_itk_images(tmp_path: Path) -> None:
    import itk
    import SimpleITK

    array = ball(24, "int16")
    turn = [0.0, 1, 0, -1, 0, 0, 0, 0, 1]
    image = SimpleITK.GetImageFromArray(array)
    image.SetSpacing((0.5, 0.6, 0.7))
    image.SetOrigin((1, 2, 3))
    image.SetDirection(turn)
    other = itk.image_from_array(array)
    other.SetSpacing((0.5, 0.6, 0.7))
    other.SetOrigin((1, 2, 3))
    other.SetDirection(np.array(turn).reshape(3, 3))
    for i, source in enumerate([image, other]):
        with built(source, tmp_path / f"{i}.isb") as pyramid:
            assert np.array_equal(np.asarray(pyramid.level(0)), array)
            assert pyramid.unit == "millimetres"
            at = image.TransformContinuousIndexToPhysicalPoint((3.0, 4.0, 5.0))
            assert np.allclose((pyramid.affine @ [3, 4, 5, 1])[:3], at)


def test_a_file_and_its_array_have_the_same_voxels(tmp_path: Path, command: Any) -> None:
    command("phantom", "head", "--voxels", 60, "-o", tmp_path / "head.mha")
    with built(str(tmp_path / "head.mha"), tmp_path / "f.isb") as of_file:
        array = np.asarray(of_file.level(0))
        with built(array, tmp_path / "a.isb") as of_array:
            assert np.array_equal(of_file.extract(1324).points, of_array.extract(1324).points)
        import SimpleITK

        assert np.array_equal(SimpleITK.GetArrayFromImage(SimpleITK.ReadImage(tmp_path / "head.mha")), array)


@pytest.mark.parametrize(
    ("source", "message"),
    [
        (np.ma.masked_array(np.zeros((4, 4, 4)), mask=True), "masked"),
        (np.zeros((4, 4, 4), object), "Python objects"),
        (np.zeros((4, 4, 4), complex), "no real numbers"),
        (np.zeros((4, 4)), "has 2 axes"),
        (np.zeros((2, 4, 4, 4)), "has 4 axes"),
        (np.zeros((1, 4, 4)), "at least 2 voxels"),
        (42, "is no volume"),
        (np.full((4, 4, 4), np.nan), "not a number at .*nan_as"),
    ],
)
def test_what_is_no_volume_is_one_clear_error(source: Any, message: str, tmp_path: Path) -> None:
    with pytest.raises(isobrick.Error, match=message) as caught:
        isobrick.build(source, tmp_path / "e.isb")
    assert "\n" not in str(caught.value)
    assert list(tmp_path.iterdir()) == []


def test_nan_as(tmp_path: Path) -> None:
    array = ball(20)
    array[3, 4, 5] = np.nan
    report = isobrick.build(array, tmp_path / "n.isb", nan_as=-7)
    assert report.replaced_voxels == 1
    assert isobrick.open(tmp_path / "n.isb").level(0)[3, 4, 5] == -7


def test_noise_has_no_curvature_to_store(tmp_path: Path) -> None:
    array = np.random.default_rng(1).integers(0, 256, (40, 40, 40), np.uint8)
    report = isobrick.build(array, tmp_path / "n.isb")
    assert "nothing to gain" in report.notes[-1]
    assert not any("nothing to gain" in note for note in isobrick.build(ball(40), tmp_path / "b.isb").notes)


def test_mask_nan(tmp_path: Path) -> None:
    array = ball(20)
    array[:, :, 12:] = np.nan
    report = isobrick.build(array, tmp_path / "n.isb", mask_nan=True)
    assert report.missing_voxels == 20 * 20 * 8
    assert "have no data" in isobrick.open(tmp_path / "n.isb").provenance["notes"][-1]
    assert np.array_equal(isobrick.open(tmp_path / "n.isb").level(0)[:], array, equal_nan=True)


def test_an_output_that_exists_is_replaced_with_force_only(tmp_path: Path) -> None:
    out = tmp_path / "o.isb"
    isobrick.build(ball(), out)
    before = out.read_bytes()
    with pytest.raises(isobrick.Error, match="force=True") as caught:
        isobrick.build(ball(30), out)
    assert caught.value.path == str(out) and out.read_bytes() == before
    isobrick.build(ball(30), out, force=True)
    assert isobrick.open(out).shape == (30, 30, 30)


def test_an_array_that_was_written_again_is_another(tmp_path: Path) -> None:
    import zarr

    def build(**more: Any) -> tuple[int, int]:
        report = isobrick.build(array, tmp_path / "a.isbs", super_brick=16, brick_cells=8, **more)
        return report.super_bricks_built, report.super_bricks_up_to_date

    array = zarr.create_array(store=str(tmp_path / "a.zarr"), shape=(40, 40, 40), chunks=(16, 16, 16), dtype="u2")
    array[:] = ball(40, "uint16")
    assert build() == (27, 0)
    assert build() == (0, 27)
    array[:] = 5
    with pytest.raises(isobrick.Error, match="force=True"):
        build()
    assert build(force=True) == (27, 0)
    # Also where the sample is the same.
    array[12, 12, 12] = 7
    assert build(force=True) == (27, 0)
    with isobrick.open(tmp_path / "a.isbs") as pyramid:
        assert pyramid.value_range == (5, 7)


def test_an_exception_of_the_array_comes_out_and_leaves_nothing(tmp_path: Path) -> None:
    class Broken:
        shape, dtype, chunks = (90, 90, 90), np.dtype("u2"), (30, 30, 30)

        def __getitem__(self, box: Any) -> Any:
            if box[0].start >= 30:
                raise RuntimeError("the store is gone")
            return np.zeros([s.stop - s.start for s in box], "u2")

    with pytest.raises(RuntimeError, match="the store is gone"):
        isobrick.build(Broken(), tmp_path / "b.isb")
    assert list(tmp_path.iterdir()) == []


def test_a_chunk_that_does_not_fit_is_an_error_that_says_how_much_does(tmp_path: Path) -> None:
    import dask.array

    whole = dask.array.zeros((256, 512, 512), chunks=-1, dtype="u2")
    with pytest.raises(isobrick.Error, match=r"give memory='\d+M' or rechunk"):
        isobrick.build(whole, tmp_path / "w.isb", memory="128M")


@pytest.mark.parametrize("size", ["", "12X", "-3", 0])
def test_sizes_that_are_none(size: Any, tmp_path: Path) -> None:
    with pytest.raises(isobrick.Error):
        isobrick.build(ball(), tmp_path / "s.isb", memory=size)
