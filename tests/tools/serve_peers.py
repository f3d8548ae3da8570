"""serve_peers.py NRRD ISOVALUE [MILLISECONDS MEGABITS]: another way to drag an isovalue in a browser, as JSON.

As trame shows VTK's surfaces: for each isovalue a contour of all of the volume, drawn by the server and sent as a JPEG of
1280 x 800. With MILLISECONDS, there and back, and MEGABITS a second over a line like that (delay_relay.py). Needs vtk of PyPI.
"""

from __future__ import annotations

import json
import multiprocessing
import socket
import statistics
import struct
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

RELAY = Path(__file__).parents[1] / "support" / "delay_relay.py"


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


if __name__ == "__main__":
    print(json.dumps(pictures(sys.argv[1], float(sys.argv[2])), indent=1))
