"""serve_peers.py NRRD ISOVALUE [MILLISECONDS MEGABITS]: two other ways to drag an isovalue in a browser, as JSON.

`pictures`: as trame shows VTK's surfaces: for each isovalue a contour of all of the volume, drawn by the server and sent as a
JPEG of 1280 x 800. `whole volume`: as vtk.js does it: the browser fetches the volume, packed by gzip, and makes the
surfaces. With MILLISECONDS, there and back, and MEGABITS a second over a line like that (delay_relay.py).

Needs vtk, numpy and playwright of PyPI, Debian's chromium, and npm, which fetches vtk.js and esbuild.
"""

from __future__ import annotations

import gzip
import http.server
import json
import multiprocessing
import socket
import statistics
import struct
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

RELAY = Path(__file__).parents[1] / "support" / "delay_relay.py"
PAGE = """
import vtkImageData from '@kitware/vtk.js/Common/DataModel/ImageData';
import vtkDataArray from '@kitware/vtk.js/Common/Core/DataArray';
import vtkImageMarchingCubes from '@kitware/vtk.js/Filters/General/ImageMarchingCubes';
window.run = async (size, spacing, isovalues) => {
  const begin = performance.now(), image = vtkImageData.newInstance({extent: [0, size[0] - 1, 0, size[1] - 1, 0, size[2] - 1], spacing});
  const values = new Int16Array(await (await fetch('/volume')).arrayBuffer());
  const fetched = performance.now() - begin, seconds = [];
  image.getPointData().setScalars(vtkDataArray.newInstance({name: 'values', values}));
  let triangles = 0;
  for (const contourValue of isovalues) {
    const before = performance.now();
    const cubes = vtkImageMarchingCubes.newInstance({contourValue, computeNormals: true, mergePoints: true});
    cubes.setInputData(image);
    triangles = cubes.getOutputData().getNumberOfPolys();
    seconds.push((performance.now() - before) / 1000);
  }
  return {fetched: fetched / 1000, seconds, triangles};
};
"""


def relayed(port: int) -> tuple[int, subprocess.Popen[str]]:
    words = [sys.executable, str(RELAY), "127.0.0.1", str(port), *(sys.argv[3:5] or ["0"])]
    relay = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert relay.stdout is not None
    return int(relay.stdout.readline()), relay


def serve_pictures(path: str, listening: socket.socket) -> None:
    import vtk

    reader = vtk.vtkNrrdReader(file_name=path)
    contour = vtk.vtkFlyingEdges3D()
    contour.SetInputConnection(reader.GetOutputPort())
    mapper = vtk.vtkPolyDataMapper(scalar_visibility=False)
    mapper.SetInputConnection(contour.GetOutputPort())
    renderer = vtk.vtkRenderer()
    renderer.AddActor(vtk.vtkActor(mapper=mapper))
    window = vtk.vtkRenderWindow(off_screen_rendering=True, size=(1280, 800))
    window.AddRenderer(renderer)
    shot = vtk.vtkWindowToImageFilter(input=window, read_front_buffer=False)
    writer = vtk.vtkJPEGWriter(write_to_memory=True, quality=80)
    writer.SetInputConnection(shot.GetOutputPort())
    line, _ = listening.accept()
    line.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    while asked := line.recv(8):
        contour.SetValue(0, struct.unpack("<d", asked)[0])
        window.Render()
        shot.Modified()
        writer.Write()
        picture = memoryview(writer.GetResult()).tobytes()
        line.sendall(struct.pack("<QQ", len(picture), contour.GetOutput().GetNumberOfPolys()) + picture)


def pictures(path: str, isovalue: float) -> dict[str, Any]:
    listening = socket.create_server(("127.0.0.1", 0))
    server = multiprocessing.Process(target=serve_pictures, args=(path, listening), daemon=True)
    server.start()
    port, relay = relayed(listening.getsockname()[1])
    seconds, sizes = [], []
    with socket.create_connection(("127.0.0.1", port)) as line, line.makefile("rb") as answers:
        for i in range(22):
            begin = time.perf_counter()
            line.sendall(struct.pack("<d", isovalue * (1 + 0.0005 * i)))
            size, triangles = struct.unpack("<QQ", answers.read(16))
            sizes.append(len(answers.read(size)))
            seconds.append(time.perf_counter() - begin)
    server.kill()
    relay.communicate()
    return {"first_s": seconds[0], "median_s": statistics.median(seconds[2:]), "p95_s": sorted(seconds[2:])[18],
            "bytes": int(statistics.median(sizes)), "triangles": triangles}


def whole_volume(path: str, isovalue: float) -> dict[str, Any]:
    from playwright.sync_api import sync_playwright

    head, data = Path(path).read_bytes().split(b"\n\n", 1)
    fields = dict(text.split(": ", 1) for text in head.decode().splitlines() if ": " in text)
    size = [int(n) for n in fields["sizes"].split()]
    values = np.frombuffer(gzip.decompress(data) if "gz" in fields["encoding"] else data, "<i2")
    packed = gzip.compress(values.tobytes(), 6)
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "page.mjs").write_text(PAGE)
        subprocess.run("npm init -y && npm i --no-audit @kitware/vtk.js esbuild && "
                       "npx esbuild page.mjs --bundle --minify --outfile=page.js", shell=True, cwd=folder, check=True,
                       capture_output=True)
        script = (Path(folder) / "page.js").read_bytes()

    class Files(http.server.BaseHTTPRequestHandler):
        def do_GET(self) -> None:  # noqa: N802
            volume = self.path == "/volume"
            body = packed if volume else script if self.path == "/page.js" else b"<script src=page.js></script>"
            self.send_response(200)
            self.send_header("Content-Type", "text/html" if self.path == "/" else "text/javascript")
            if volume:
                self.send_header("Content-Encoding", "gzip")
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, *unused: Any) -> None:
            pass

    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Files)
    multiprocessing.Process(target=server.serve_forever, daemon=True).start()
    port, relay = relayed(server.server_port)
    with sync_playwright() as playwright:
        page = playwright.chromium.launch(executable_path="/usr/bin/chromium", args=["--no-sandbox"]).new_page()
        page.goto(f"http://127.0.0.1:{port}/")
        values_of = [isovalue * (1 + 0.0005 * i) for i in range(6)]
        page.set_default_timeout(600_000)
        done = page.evaluate("([size, isovalues]) => run(size, [1, 1, 1], isovalues)", [size, values_of])
    relay.communicate()
    return {"bytes": len(packed), "first_s": done["fetched"] + done["seconds"][0],
            "median_s": statistics.median(done["seconds"][1:]), "triangles": done["triangles"]}


if __name__ == "__main__":
    found = {way.__name__: way(sys.argv[1], float(sys.argv[2])) for way in (pictures, whole_volume)}
    print(json.dumps(found, indent=1))
