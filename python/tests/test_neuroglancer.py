"""Meshes for Neuroglancer, read by another program's reader of the format."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
from cloudvolume import CloudVolume

import isobrick
from conftest import ball


def test_meshes_of_all_levels_are_read_by_cloud_volume(tmp_path: Path, command: Callable[..., str]) -> None:
    array = ball(90, "float32")
    isobrick.build(array, tmp_path / "v.isb", spacing=(0.5, 1, 2), brick_cells=16)
    command("extract", tmp_path / "v.isb", "--iso", "-1,2", "-o", tmp_path / "m.precomputed")
    # cloud-volume reads meshes beside a segmentation alone.
    scale = {
        "key": "0",
        "size": [90, 90, 90],
        "resolution": [500000, 1000000, 2000000],
        "voxel_offset": [0, 0, 0],
        "chunk_sizes": [[64, 64, 64]],
        "encoding": "raw",
    }
    info = {
        "@type": "neuroglancer_multiscale_volume",
        "type": "segmentation",
        "data_type": "uint8",
        "num_channels": 1,
        "scales": [scale],
        "mesh": "m.precomputed",
    }
    (tmp_path / "info").write_text(json.dumps(info))
    volume = CloudVolume(f"file://{tmp_path}", progress=False)
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
