"""openvdb::tools::volumeToMesh, by its Python module; the number is the adaptivity."""

import numpy as np
import pyopenvdb
from peer import ArrayPeer


class Peer(ArrayPeer):
    note = "float grid, all cores, no normals, quads counted as two triangles, closed at the volume's border"

    def prepare(self):
        # A grid of integers would round the isovalue.
        self.grid = pyopenvdb.FloatGrid(float(self.array.min()))
        self.grid.copyFromArray(self.array.astype(np.float32))
        del self.array

    def extract(self):
        self.parts = self.grid.convertToPolygons(self.task.iso, self.number)

    def mesh(self):
        points, triangles, quads = self.parts
        return points[:, ::-1], np.concatenate([triangles, quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])

    def output_bytes(self):
        return sum(array.nbytes for array in self.parts)
