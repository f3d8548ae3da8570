"""Surfaces of arrays in one call, beside those of pyramids and of scikit-image."""

import dask.array
import h5py
import isobrick
import numpy as np
import pytest
import SimpleITK
import xarray
import zarr
from skimage.measure import marching_cubes as of_skimage


def _ball(shape=(40, 44, 48), radius=15.0, dtype=np.float32):
    z, y, x = np.indices(shape)
    middle = [(n - 1) / 2 for n in shape]
    field = radius - np.sqrt((x - middle[2]) ** 2 + (y - middle[1]) ** 2 + (z - middle[0]) ** 2)
    return (100 + 4 * field).astype(dtype) if np.dtype(dtype).kind in "ui" else field.astype(dtype)


def _same(a, b):
    np.testing.assert_array_equal(a.points, b.points)
    np.testing.assert_array_equal(a.faces, b.faces)
    np.testing.assert_array_equal(a.normals, b.normals)


def _of_pyramid(tmp_path, volume, level, **place):
    simplify = place.pop("simplify", None)
    isobrick.build(volume, tmp_path / "a.isb", force=True, **place)
    with isobrick.open(tmp_path / "a.isb") as pyramid:
        return pyramid.extract(level, simplify=simplify)


@pytest.mark.parametrize("dtype", ["u1", "i1", "u2", ">u2", "i2", ">i2", "f4", ">f4", "f8", "i4", "u4", "i8", "f2", "?"])
def test_is_that_of_the_pyramid(tmp_path, dtype):
    if dtype == "?":
        volume, level = _ball() > 0, 0.5
    elif dtype == "i1":
        volume, level = _ball().astype("i1"), 1
    else:
        volume, level = _ball(dtype=dtype), 100 if np.dtype(dtype).kind in "ui" else 0
    place = {"spacing": (0.5, 1.0, 2.0), "origin": (3.0, -2.0, 7.0)}
    _same(isobrick.isosurface(volume, level, **place), _of_pyramid(tmp_path, volume, level, **place))


@pytest.mark.parametrize("seed", range(4))
def test_strides_are_taken_as_they_are(tmp_path, seed):
    random = np.random.default_rng(seed)
    large = random.integers(0, 200, (50, 60, 70)).astype(["u1", "f4", "i2", "f8"][seed])
    views = [large[::-1, 3:40, 5:], large[1::2, ::-2, ::3], large.transpose(2, 0, 1)[:30], np.asfortranarray(large)]
    volume = views[seed]
    _same(isobrick.isosurface(volume, 101.5), _of_pyramid(tmp_path, np.ascontiguousarray(volume), 101.5))


def test_simplify_and_box(tmp_path):
    volume = _ball()
    _same(isobrick.isosurface(volume, 0, simplify=0.3), _of_pyramid(tmp_path, volume, 0, simplify=0.3))
    half = isobrick.isosurface(volume, 0, box_voxels=((0, 0, 0), (23, 43, 39)))
    assert 0 < len(half.faces) < 0.6 * len(isobrick.isosurface(volume, 0).faces)


def test_a_mesh_is_three_arrays_and_stays():
    points, faces, normals = isobrick.isosurface(_ball(), 0)
    kept = points.copy()
    assert points.shape == normals.shape and faces.max() == len(points) - 1
    isobrick.isosurface(_ball(radius=9), 0)  # takes no memory that arrays hold
    np.testing.assert_array_equal(points, kept)


def test_arrays_of_other_packages(tmp_path):
    volume = _ball(dtype="u2")
    wanted = isobrick.isosurface(volume, 100)
    sources = [
        zarr.array(volume, chunks=(16, 16, 16)),
        dask.array.from_array(volume, chunks=(20, 44, 17)),
        xarray.DataArray(volume, dims=("z", "y", "x")),
    ]
    with h5py.File(tmp_path / "a.h5", "w") as file:
        sources.append(file.create_dataset("volume", data=volume, chunks=(8, 44, 48)))
        for source in sources:
            _same(isobrick.isosurface(source, 100, memory="8M"), wanted)
    image = SimpleITK.GetImageFromArray(volume)
    image.SetSpacing((0.5, 0.25, 2.0))
    image.SetOrigin((1.0, 2.0, 3.0))
    mesh = isobrick.isosurface(image, 100)
    np.testing.assert_allclose(mesh.points, wanted.points * (0.5, 0.25, 2.0) + (1, 2, 3), atol=1e-5)
    assert mesh.unit == "millimetres"


class _Tensor:
    """What isobrick uses of torch.Tensor."""

    def __init__(self, array, device="cpu"):
        self._array, self.device = array, type("Device", (), {"type": device, "__str__": lambda _: device})()

    def detach(self):
        return self._array


_Tensor.__name__, _Tensor.__module__ = "Tensor", "torch"


def test_tensors_share_memory():
    volume = _ball()
    _same(isobrick.isosurface(_Tensor(volume), 0), isobrick.isosurface(volume, 0))
    with pytest.raises(isobrick.Error, match="cuda"):
        isobrick.isosurface(_Tensor(volume, "cuda"), 0)


def test_refusals():
    volume = _ball()
    volume[3, 4, 5] = np.nan
    with pytest.raises(isobrick.Error, match=r"\(5,4,3\)"):
        isobrick.isosurface(volume, 0)
    with pytest.raises(isobrick.Error, match="axes"):
        isobrick.isosurface(volume[0], 0)
    with pytest.raises(isobrick.Error, match="memory"):
        isobrick.isosurface(_ball(dtype="f8"), 0, memory=4096)
    with pytest.raises(isobrick.Error, match="simplify"):
        isobrick.isosurface(_ball(), 0, drop_small=True)


def _volume_of(number):
    random = np.random.default_rng(number)
    shape = tuple(random.integers(4, 34, 3))
    z, y, x = np.indices(shape)
    if number % 4 == 0:
        return random.random(shape).astype(np.float32), 0.5
    if number % 4 == 1:
        return random.integers(0, 5, shape).astype(np.uint8), 2
    if number % 4 == 2:
        return np.sin(0.4 * x) + np.sin(0.3 * y + number) + np.sin(0.5 * z), 0.1
    return (1000 * random.normal(size=shape)).astype(np.int16), None


def _closest(points, to):
    from scipy.spatial import cKDTree

    return cKDTree(to).query(points)


@pytest.mark.parametrize("number", range(20))
def test_beside_scikit_image(number):
    volume, level = _volume_of(number)
    spacing = (1, 1, 1) if number % 3 else (2.0, 0.5, 1.5)
    options = {
        "spacing": spacing,
        "step_size": 2 if number % 5 == 0 and min(volume.shape) > 5 else 1,
        "gradient_direction": "ascent" if number % 2 else "descent",
    }
    verts, faces, normals, values = isobrick.marching_cubes(volume, level, **options)
    wanted = of_skimage(volume, level, **options)
    assert [a.dtype for a in (verts, faces, normals, values)] == [a.dtype for a in wanted]
    # Every vertex is one of scikit-image's, which has more of them inside of cells.
    edge = np.array(spacing) * options["step_size"]
    distances, at = _closest(verts / edge, wanted[0] / edge)
    assert distances.max() <= 1 / 4096 + 1e-6
    cut_in_one_way = number % 4 == 2
    if cut_in_one_way:
        assert len(verts) == len(wanted[0]) and len(faces) == len(wanted[1])
        np.testing.assert_array_equal(values, wanted[3][at])
        assert np.einsum("ij,ij->i", normals, wanted[2][at]).mean() > 0.98
        assert _signed_volume(verts, faces) == pytest.approx(_signed_volume(*wanted[:2]), rel=1e-3, abs=0.5)


def _signed_volume(verts, faces):
    a, b, c = (verts[faces[:, i]].astype(float) for i in range(3))
    return np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6


def test_masks_and_errors_are_those_of_scikit_image():
    volume = _ball().astype(np.float64)
    mask = np.zeros(volume.shape, bool)
    mask[:, :, 20:] = True
    ours, theirs = (f(volume, 0.0, mask=mask) for f in (isobrick.marching_cubes, of_skimage))
    assert len(ours[1]) == len(theirs[1]) and len(ours[0]) == len(theirs[0])
    for f in (isobrick.marching_cubes, of_skimage):
        with pytest.raises(ValueError, match="within volume data range"):
            f(volume, 1e6)
        with pytest.raises(ValueError, match="3D numpy array"):
            f(volume[0], 0.0)
        with pytest.raises(ValueError, match="same shape"):
            f(volume, 0.0, mask=mask[1:])
        with pytest.raises(ValueError, match="gradient_direction"):
            f(volume, 0.0, gradient_direction="up")
        with pytest.raises(RuntimeError, match="No surface found"):
            f(np.ones((3, 3, 3)), 1.0)


def test_labels_are_exact_and_smooth(tmp_path):
    inside = _ball() > 0
    for near, dtype in ((2**24, "u4"), (2**24 + 1, ">i4"), (2**53 + 1, "u8"), (2**64 - 1, "u8"), (-(2**53), "i8")):
        label = near + 1 if near < 2**63 and near > 0 else 7
        volume = np.where(inside, np.array(label, dtype), np.array(near, dtype))
        _same(isobrick.isosurface(volume, label=label), isobrick.isosurface(inside, 0.5))
    smooth = isobrick.isosurface(volume, label=7, denoise=1.25)
    _same(smooth, isobrick.isosurface(inside, 0.5, denoise=1.25))
    _same(smooth, isobrick.isosurface(zarr.array(inside.astype("u1"), chunks=(16, 16, 16)), 0.5, denoise=1.25))
    isobrick.build(volume, tmp_path / "label.isb", label=7, denoise=1.25)
    isobrick.build(inside, tmp_path / "mask.isb")
    isobrick.build(tmp_path / "mask.isb", tmp_path / "smooth.isb", denoise=1.25)
    with (
        isobrick.open(tmp_path / "smooth.isb") as built,
        isobrick.open(tmp_path / "mask.isb", denoise=1.25, cache_folder=tmp_path / "cache") as opened,
    ):
        _same(opened.extract(0.5), built.extract(0.5))
    with pytest.raises(isobrick.Error, match=r"is a path and no array; isobrick.open\(\)"):
        isobrick.isosurface(tmp_path / "mask.isb", 0.5)
    for name in ("label.isb", "smooth.isb"):
        with isobrick.open(tmp_path / name) as pyramid:
            _same(smooth, pyramid.extract(0.5))
    rough = isobrick.isosurface(inside, 0.5)
    radii = [np.linalg.norm(mesh.points - (23.5, 21.5, 19.5), axis=1) for mesh in (rough, smooth)]
    assert radii[1].std() < radii[0].std() / 2
    assert abs(radii[1].mean() - 15) < 0.1


def test_what_a_derivation_cannot_be():
    volume = _ball()
    with pytest.raises(isobrick.Error, match="one of them"):
        isobrick.isosurface(volume)
    with pytest.raises(isobrick.Error, match="one of them"):
        isobrick.isosurface(volume, 0, label=1)
    with pytest.raises(isobrick.Error, match="denoise=11"):
        isobrick.isosurface(volume, 0, denoise=11)
    with pytest.raises(isobrick.Error, match="label -1"):
        isobrick.isosurface(volume > 0, label=-1)
    with pytest.raises(isobrick.Error, match="whole numbers"):
        isobrick.isosurface(volume, label=1)
