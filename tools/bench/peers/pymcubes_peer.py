"""PyMCubes."""

import mcubes
from peer import ArrayPeer


class Peer(ArrayPeer):
    note = "one thread, no normals"

    def extract(self):
        points, triangles = mcubes.marching_cubes(self.array, self.task.iso)
        self.found = points[:, ::-1], triangles
