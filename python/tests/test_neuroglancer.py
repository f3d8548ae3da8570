"""What `convert` writes for Neuroglancer, read by other people's readers of the format."""

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
