"""isobrick in napari: pyramids open as multiscale images, and a dock widget shows their isosurfaces.

napari's axes are those of the arrays, (z, y, x), its world likewise; isobrick's points are (x, y, z).
"""
