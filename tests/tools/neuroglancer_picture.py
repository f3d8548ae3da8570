#!/usr/bin/env python3
"""Pictures of a volume and its meshes by Neuroglancer itself, in a Chromium without a window.

    isobrick convert scan.isb --all-levels -o scan.ome.zarr
    isobrick extract scan.isb --iso 1250 -o bone.precomputed
    neuroglancer_picture.py scan.ome.zarr bone.precomputed OUT.png [VOXELS_ACROSS [SURFACE_ONLY]]

Needs Debian's chromium and, from PyPI, neuroglancer and zarr.
"""

import functools
import http.server
import json
import os
import subprocess
import sys
import tempfile
import threading

import neuroglancer
import zarr


class Files(http.server.SimpleHTTPRequestHandler):
    """A server as Neuroglancer needs it: ranges, and other pages may read."""

    def end_headers(self):
        self.send_header("Access-Control-Allow-Origin", "*")
        super().end_headers()

    def log_message(self, *_):
        pass

    def do_GET(self):
        wanted, path = self.headers.get("Range"), self.translate_path(self.path)
        if not wanted or not os.path.isfile(path):
            return super().do_GET()
        size = os.path.getsize(path)
        first, last = wanted.split("=")[1].split("-")
        first, last = int(first), min(int(last or size), size - 1)
        self.send_response(206)
        self.send_header("Content-Range", f"bytes {first}-{last}/{size}")
        self.send_header("Content-Length", str(last - first + 1))
        self.end_headers()
        with open(path, "rb") as file:
            file.seek(first)
            self.wfile.write(file.read(last - first + 1))


def serve(folder):
    handler = functools.partial(Files, directory=folder)
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    return f"http://127.0.0.1:{server.server_port}"


def main():
    volume, meshes, out = sys.argv[1:4]
    across = float(sys.argv[4]) if len(sys.argv) > 4 else 400.0
    surface_only = len(sys.argv) > 5
    image = zarr.open_group(volume, mode="r")
    levels = image.attrs.get("ome", image.attrs)["multiscales"][0]["datasets"]
    values = image[levels[-1]["path"]][:]
    spacing = levels[0]["coordinateTransformations"][0]["scale"]
    shader = f"#uicontrol invlerp grey(range=[{values.min()}, {values.max()}])\nvoid main() {{ emitGrayscale(grey()); }}"
    with open(f"{meshes}/segment_properties/info") as file:
        segments = [int(i) for i in json.load(file)["inline"]["ids"]]
    neuroglancer.set_server_bind_address("127.0.0.1")
    viewer = neuroglancer.Viewer()
    with viewer.txn() as state:
        state.dimensions = neuroglancer.CoordinateSpace(names="xyz", units="mm", scales=spacing[::-1])
        state.layers["volume"] = neuroglancer.ImageLayer(source=f"zarr://{serve(volume)}", shader=shader)
        state.layers["meshes"] = neuroglancer.SegmentationLayer(
            source=f"precomputed://{serve(meshes)}", segments=segments)
        state.position = [n / 2 for n in image[levels[0]["path"]].shape[::-1]]
        state.layout = "3d" if surface_only else "4panel"
        state.show_slices = False
        state.show_default_annotations = not surface_only
        state.projection_orientation = [-0.62, 0.3, 0.35, 0.62]
        state.projection_scale = across
        state.cross_section_scale = across / 600
    with tempfile.TemporaryDirectory() as profile:
        browser = subprocess.Popen(
            ["chromium", "--headless=new", "--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader",
             "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist", f"--user-data-dir={profile}",
             viewer.get_viewer_url()],
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            picture = viewer.screenshot(size=[1600, 1200])
        finally:
            browser.terminate()
            browser.wait()
    with open(out, "wb") as file:
        file.write(picture.screenshot.image)
    print(out)


main()
