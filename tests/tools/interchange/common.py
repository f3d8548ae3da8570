"""Runs isobrick, the first argument of each program here, and writes a volume for it."""
import json
import os
import subprocess
import sys

import numpy as np

ISOBRICK = os.path.abspath(sys.argv[1])
SPACING = np.array([0.7, 1 / 3, 2.5])  # x, y, z
ORIGIN = np.array([-101.3, 17.77, 1000 / 7])


def run(*words, fails_with=None):
    result = subprocess.run([ISOBRICK, *words], capture_output=True, text=True)
    if fails_with is not None:
        assert result.returncode == 1, (words, result)
        assert result.stderr.count("\n") == 1 and fails_with in result.stderr, (words, result.stderr)
        return None
    assert result.returncode == 0, (words, result.stderr)
    return json.loads(result.stdout) if "--json" in words else result


def rotation():
    axis = np.array([1, -2, 3]) / np.sqrt(14)
    cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.eye(3) + np.sin(0.7) * cross + (1 - np.cos(0.7)) * cross @ cross


def write_nrrd(path, values, direction=np.eye(3), spacing=SPACING, origin=ORIGIN):
    names = {"u1": "uint8", "i1": "int8", "u2": "uint16", "i2": "int16", "f4": "float"}
    steps = [direction[:, axis] * spacing[axis] for axis in range(3)]
    vector = lambda v: "(" + ",".join(repr(float(n)) for n in v) + ")"
    header = (
        f"NRRD0004\ntype: {names[values.dtype.str[1:]]}\ndimension: 3\n"
        f"space: left-posterior-superior\nsizes: {' '.join(str(n) for n in values.shape[::-1])}\n"
        f"space directions: {' '.join(vector(step) for step in steps)}\n"
        f"endian: little\nencoding: raw\nspace origin: {vector(origin)}\n\n"
    )
    with open(path, "wb") as file:
        file.write(header.encode() + values.tobytes())
