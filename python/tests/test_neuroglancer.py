"""Output of `convert` for Neuroglancer, read by other programs' readers of the format."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import tensorstore
from cloudvolume import CloudVolume

import isobrick
from conftest import ball


@pytest.mark.parametrize("dtype", ["uint8", "int8", "uint16", "int16", "float32"])
def test_precomputed_volumes_are_read_by_tensorstore_and_cloud_volume(
    dtype: str, tmp_path: Path, command: Callable[..., str]
) -> None:
    array = ball(140, dtype)[:, 5:120, 3:]
    spacing = (0.5, 0.25, 0.5)
    isobrick.build(array, tmp_path / "v.isb", spacing=spacing)
    command("convert", tmp_path / "v.isb", "-o", tmp_path / "v.precomputed")
    folder = tmp_path / "v.precomputed"
    scales = json.loads((folder / "info").read_text())["scales"]
    assert len(scales) == 4
    finer = array.transpose().astype(np.float64)
    for number, scale in enumerate(scales):
        opened = tensorstore.open(
            {
                "driver": "neuroglancer_precomputed",
                "kvstore": {"driver": "file", "path": f"{folder}/"},
                "scale_index": number,
            }
        ).result()
        values = opened.read().result()[..., 0]
        assert values.dtype == np.dtype(dtype) and list(values.shape) == scale["size"]
        volume = CloudVolume(f"file://{folder}", mip=number, progress=False, bounded=True)
        assert np.array_equal(np.asarray(volume[:])[..., 0], values)
        if number == 0:
            assert np.array_equal(values, array.transpose())
            assert list(volume.resolution) == [1e6 * s for s in spacing]
        # A voxel lies where the voxels that it covers lie: the middle of the ball stays.
        assert abs(values.astype(np.float64).mean() - finer.mean()) < 1.5
        finer = values.astype(np.float64)


def test_meshes_of_all_levels_are_read_by_cloud_volume(tmp_path: Path, command: Callable[..., str]) -> None:
    array = ball(90, "float32")
    isobrick.build(array, tmp_path / "v.isb", spacing=(0.5, 1, 2), brick_cells=16)
    command("convert", tmp_path / "v.isb", "-o", tmp_path / "v.precomputed")
    command("extract", tmp_path / "v.isb", "--iso", "-1,2", "-o", tmp_path / "v.precomputed" / "m.precomputed")
    # cloud-volume reads meshes beside a segmentation alone.
    info = json.loads((tmp_path / "v.precomputed" / "info").read_text())
    info.update(type="segmentation", data_type="uint8", mesh="m.precomputed")
    (tmp_path / "v.precomputed" / "info").write_text(json.dumps(info))
    volume = CloudVolume(f"file://{tmp_path / 'v.precomputed'}", progress=False)
    with isobrick.open(tmp_path / "v.isb") as pyramid:
        for segment, isovalue in ((1, -1), (2, 2)):
            for level in range(3):
                ours = pyramid.extract(isovalue, level=level)
                theirs = volume.mesh.get(segment, lod=level)[segment]
                assert len(theirs.faces) == len(ours.faces)
                # Neuroglancer counts nanometres, from the corner of the first voxel.
                corner = np.array([0.25, 0.5, 1.0])
                places = np.asarray(theirs.vertices, dtype=np.float64) / 1e6 - corner
                assert np.allclose(places.min(0), ours.points.min(0), atol=1e-3)
                assert np.allclose(places.max(0), ours.points.max(0), atol=1e-3)
