"""What every peer does alike: a volume in memory, and a mesh as arrays."""

import numpy as np


class ArrayPeer:
    """extract() leaves its mesh in self.found: points in voxel indices (x, y, z) and triangles."""

    note = "one thread"

    def __init__(self, task, number):
        self.task, self.number, self.found = task, number, None

    def load(self):
        self.array = np.fromfile(self.task.volume, dtype=self.task.type).reshape(self.task.dims[::-1])

    def prepare(self):
        pass

    def mesh(self):
        return self.found

    def output_bytes(self):
        return sum(array.nbytes for array in self.found)
