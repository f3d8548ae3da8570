"""skimage.measure.marching_cubes. As a program: skimage_peer.py IN.nrrd ISOVALUE OUT.ply, from file to mesh."""

import sys

import numpy as np
from peer import ArrayPeer
from skimage.measure import marching_cubes


class Peer(ArrayPeer):
    note = "one thread, arrays of Python"

    def extract(self):
        points, triangles, self.normals, _ = marching_cubes(self.array, self.task.iso)
        self.found = points[:, ::-1], triangles

    def output_bytes(self):
        return super().output_bytes() + self.normals.nbytes


if __name__ == "__main__":
    import SimpleITK
    import trimesh

    image = SimpleITK.ReadImage(sys.argv[1])
    points, triangles, normals, _ = marching_cubes(SimpleITK.GetArrayViewFromImage(image), float(sys.argv[2]),
                                                   spacing=image.GetSpacing()[::-1])
    world = points[:, ::-1] @ np.reshape(image.GetDirection(), (3, 3)).T + image.GetOrigin()
    trimesh.Trimesh(world, triangles, vertex_normals=normals[:, ::-1], process=False).export(sys.argv[3])
