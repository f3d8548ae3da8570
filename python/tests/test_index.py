"""An index leaves the finest level in its source: ``isobrick.build(..., index=True)``."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

import isobrick


def ball(n: int) -> np.ndarray:
    z, y, x = np.ogrid[:n, :n, :n]
    return (1000 - 40 * np.sqrt((x - n / 2) ** 2 + (y - n / 2) ** 2 + (z - n / 2) ** 2)).clip(0).astype("u2")


def test_an_index_is_its_pyramid(tmp_path: Path) -> None:
    scan = tmp_path / "ball.raw"
    ball(70).tofile(scan)
    raw = isobrick.RawLayout((70, 70, 70), "u16")
    isobrick.build(scan, tmp_path / "whole.isb", raw=raw, brick_cells=16)
    report = isobrick.build(scan, tmp_path / "index.isb", raw=raw, brick_cells=16, index=True)
    assert report.file_bytes < (tmp_path / "whole.isb").stat().st_size
    with isobrick.open(tmp_path / "whole.isb") as whole, isobrick.open(tmp_path / "index.isb") as index:
        assert not index.verify()
        a, b = whole.extract(300), index.extract(300)
        assert len(a.faces) > 1000
        assert np.array_equal(a.points, b.points) and np.array_equal(a.faces, b.faces)
        assert np.array_equal(whole.levels[0][:], index.levels[0][:])
    os.utime(scan, (1, 1))
    with isobrick.open(tmp_path / "index.isb") as index:
        assert np.array_equal(index.levels[1][:], index.levels[1][:])
        with pytest.raises(isobrick.Error, match="changed since"):
            index.extract(300)


def test_arrays_have_no_index(tmp_path: Path) -> None:
    with pytest.raises(isobrick.Error, match="leaves its finest level in a file"):
        isobrick.build(ball(20), tmp_path / "ball.isb", index=True)
