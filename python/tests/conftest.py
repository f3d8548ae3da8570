"""Shared by the tests. Volumes are made here; the command is the one of the package."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import isobrick
from isobrick._command import EXECUTABLE


def ball(n: int = 40, dtype: str = "float32") -> NDArray[np.generic]:
    """Distances to a sphere of radius n/3, positive inside; of integer types around 100."""
    z, y, x = np.mgrid[0:n, 0:n, 0:n].astype(np.float64)
    middle = (n - 1) / 2
    distance = n / 3 - np.sqrt((x - middle) ** 2 + (y - middle - 1) ** 2 + (z - middle + 2) ** 2)
    if np.dtype(dtype).kind == "f":
        return distance.astype(dtype)
    return np.clip(np.rint(100 + 2 * distance), 0, 120).astype(dtype)


@pytest.fixture(scope="session")
def command() -> Callable[..., str]:
    """Runs `isobrick` and returns what it prints."""

    def run(*arguments: object) -> str:
        words = [str(EXECUTABLE), *map(str, arguments)]
        done = subprocess.run(words, capture_output=True, text=True, timeout=300)
        assert done.returncode == 0, f"{words}: {done.stderr}"
        return done.stdout

    return run


@pytest.fixture(scope="session")
def head(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The pyramid of a CT-like head: bone is 1324, skin is 500."""
    path = tmp_path_factory.mktemp("head") / "head.isb"
    isobrick.build("phantom:head:128", path)
    return path
