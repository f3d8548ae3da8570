#!/usr/bin/env python3
"""The pictures of docs/how-to/prints.md: runs the commands of the page and draws the files that they write.

    ISOBRICK=build/release/isobrick python3 tools/prints.py [OUT]

OUT: a folder for the pictures (default: docs/figures). Takes pyvista, trimesh, lxml, networkx and tetgen of PyPI.
"""

from __future__ import annotations

import os
import sys
import tempfile
from pathlib import Path

import numpy as np
import pyvista
import trimesh

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tests/docs"))
from pages import run_page  # noqa: E402

#: Name of the picture, file, and from where it is seen; world axes.
VIEWS = [
    ("bone", "bone.3mf", (-0.6, -1, 0.25)),
    ("walls", "walls.glb", (-1, -0.5, 0.25)),
    ("pores", "pores.stl", (-0.6, -1, 0.5)),
    ("sample", "sample.ply", (-0.6, -1, 0.5)),
    ("skin", "skin.ply", (0.6, 1, 0.25)),
]
SIZE = (480, 360)


def colored(path: Path) -> pyvista.PolyData:
    """The mesh; its colours, sRGB, are the array "rgb"."""
    if path.suffix in (".ply", ".stl"):
        mesh = pyvista.read(path)
        if "RGB" in mesh.point_data:
            mesh.point_data["rgb"] = mesh.point_data["RGB"]
        return mesh
    loaded = next(iter(trimesh.load(path, process=False).geometry.values()))
    mesh = pyvista.wrap(loaded)
    if path.suffix == ".glb":  # linear light
        light = np.asarray(loaded.visual.vertex_attributes["color"])[:, :3].astype(float)
        light /= 65535 if light.max() > 255 else 255
        srgb = np.where(light <= 0.0031308, 12.92 * light, 1.055 * np.maximum(light, 1e-9) ** (1 / 2.4) - 0.055)
        mesh.point_data["rgb"] = np.round(255 * srgb).astype(np.uint8)
    return mesh


def draw(mesh: pyvista.PolyData, towards: tuple[float, float, float], path: Path) -> None:
    plotter = pyvista.Plotter(off_screen=True, window_size=SIZE)
    plotter.background_color = "white"
    has_colors = "rgb" in mesh.point_data
    plotter.add_mesh(
        mesh, scalars="rgb" if has_colors else None, rgb=has_colors, color=None if has_colors else (0.93, 0.9, 0.82),
        smooth_shading=not has_colors, split_sharp_edges=not has_colors, specular=0.1, ambient=0.2,
    )  # fmt: skip
    plotter.view_vector(towards, viewup=(0, 0, 1))
    plotter.camera.zoom(1.2)
    plotter.enable_anti_aliasing("ssaa")
    plotter.screenshot(path)
    plotter.close()


def main() -> None:
    out = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "docs/figures"
    isobrick = Path(os.environ.get("ISOBRICK", ROOT / "build/release/isobrick")).absolute()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        programs = f"{isobrick.parent}:{Path(sys.executable).parent}:{os.environ['PATH']}"
        run_page(ROOT / "docs/how-to/prints.md", folder, {"PATH": programs, "XDG_CACHE_HOME": name}, seconds=600)
        for picture, file, towards in VIEWS:
            draw(colored(folder / file), towards, out / f"print-{picture}.png")


if __name__ == "__main__":
    main()
