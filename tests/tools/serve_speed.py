"""serve_speed.py ISOBRICK FILE ISOVALUE [MILLISECONDS MEGABITS]: how fast `isobrick serve` answers, as JSON.

With MILLISECONDS, there and back, and MEGABITS a second over a line like that (tests/support/delay_relay.py), else on this
machine. Times are those of a client that receives and unpacks: from the wish to the last chunk unpacked.

`drag`: the isovalue moves, as by a slider, and a wish follows the answer before. `drag at 60 Hz`: a wish each frame; times
are of those that were answered. The surface is all of it, as fine as the server's pace has it. `drag of 50,000`: within a
radius that gives so many triangles. `whole`: all of the surface at level 0, with the passes before it.
"""

from __future__ import annotations

import ctypes
import ctypes.util
import json
import socket
import statistics
import struct
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

TESTS = Path(__file__).parents[1]
sys.path.insert(0, str(TESTS.parent / "python" / "tests"))
from stream_client import Client, Server  # noqa: E402

MESHOPT = ctypes.CDLL(ctypes.util.find_library("meshoptimizer") or "libmeshoptimizer.so.2d")
SIZE = ctypes.c_size_t
MESHOPT.meshopt_decodeVertexBuffer.argtypes = [ctypes.c_void_p, SIZE, SIZE, ctypes.c_char_p, SIZE]
MESHOPT.meshopt_decodeIndexBuffer.argtypes = [ctypes.c_void_p, SIZE, SIZE, ctypes.c_char_p, SIZE]
MESHOPT.meshopt_decodeFilterOct.argtypes = [ctypes.c_void_p, SIZE, SIZE]


def unpack(packet: bytes) -> None:
    """As a page does, by the same code in C."""
    vertices, triangles, positions, normals, indices = struct.unpack_from("<5I", packet, 24)
    places = ctypes.create_string_buffer(8 * vertices)
    at = 48
    assert MESHOPT.meshopt_decodeVertexBuffer(places, vertices, 8, packet[at : at + positions], positions) == 0
    at += (positions + 3) & ~3
    assert MESHOPT.meshopt_decodeVertexBuffer(places, vertices, 8, packet[at : at + normals], normals) == 0
    MESHOPT.meshopt_decodeFilterOct(places, vertices, 8)
    at += (normals + 3) & ~3
    corners = ctypes.create_string_buffer(12 * triangles)
    assert MESHOPT.meshopt_decodeIndexBuffer(corners, 3 * triangles, 4, packet[at : at + indices], indices) == 0


class Drag:
    """What a page does while a slider moves."""

    def __init__(self, client: Client, isovalue: float, members: dict[str, Any]) -> None:
        self.client, self.isovalue, self.members = client, isovalue, members
        self.wished: dict[int, float] = {}
        self.seconds: list[float] = []
        self.triangles: list[int] = []
        self.done: set[int] = set()
        self.bytes: list[int] = []
        self.before = client.bytes
        client.says_shown = False

    def wish(self) -> int:
        isovalue = self.isovalue * (1 + 0.0005 * (len(self.wished) % 20 + 1))
        wish = self.client.wish(iso=isovalue, **self.members)
        self.wished[wish] = time.perf_counter()
        return wish

    def take(self, timeout: float) -> int:
        """The wish that was answered; 0: none was in this time."""
        client = self.client
        try:
            said = client.receive(timeout)
        except TimeoutError:
            return 0
        if said["type"] != "show":
            return 0
        for number in client.shown - self.done:
            unpack(client.kept[number].packed)
        self.done = set(client.shown)
        now = time.perf_counter()
        client.say_shown(said)
        if said["wish"] in self.wished:
            self.seconds.append(now - self.wished[said["wish"]])
            self.triangles.append(said["triangles"])
            self.bytes.append(client.bytes - self.before)
        self.before = client.bytes
        return int(said["wish"])

    def results(self) -> dict[str, Any]:
        first = len(self.seconds) // 3  # the pace is found by then
        seconds = sorted(self.seconds[first:])
        return {
            "median_ms": round(1000 * statistics.median(seconds), 1),
            "p95_ms": round(1000 * seconds[int(0.95 * len(seconds))], 1),
            "triangles": int(statistics.median(self.triangles[first:])),
            "bytes": int(statistics.median(self.bytes[first:])),
            "times": len(seconds),
        }


def drag(client: Client, isovalue: float, times: int = 60, **members: Any) -> dict[str, Any]:
    """First surfaces after a change."""
    moving = Drag(client, isovalue, members)
    for _ in range(times):
        wish = moving.wish()
        while moving.take(60) != wish:
            pass
    client.says_shown = True
    return moving.results()


def drag_at_60_hz(client: Client, isovalue: float, seconds: float = 8) -> dict[str, Any]:
    moving = Drag(client, isovalue, {})
    end = time.perf_counter() + seconds
    following = time.perf_counter()
    while time.perf_counter() < end:
        if time.perf_counter() >= following:
            moving.wish()
            following += 1 / 60
        moving.take(max(0.001, following - time.perf_counter()))
    client.says_shown = True
    client.until("fine", moving.wish(), 600)
    return moving.results()


def of_50000(client: Client, isovalue: float) -> dict[str, Any]:
    """The focus and the radius of a surface of about as many."""
    focus = [(n - 1) / 2 for n in client.volume["dimensions"]]
    low, high = 1.0, float(max(client.volume["dimensions"]))
    for _ in range(8):
        radius = (low + high) / 2
        client.until("fine", client.wish(iso=isovalue, focus=focus, radius=radius))
        low, high = (radius, high) if client.triangles() < 50_000 else (low, radius)
    return {"focus": focus, "radius": radius}


def whole(server: Server, isovalue: float, port: int) -> dict[str, Any]:
    """All passes up to the finest, and the bytes of its chunks alone."""
    with stream(server, port) as line:
        client = Client(line).begin()
        begin = time.perf_counter()
        client.until("fine", client.wish(iso=isovalue), 600)
        seconds = time.perf_counter() - begin
        shown = sum(len(client.kept[number].packed) for number in client.shown)
        return {
            "triangles": client.triangles(),
            "seconds": round(seconds, 2),
            "bytes": shown,
            "bytes_of_all_passes": client.bytes,
        }


def stream(server: Server, port: int) -> Any:
    """Through the relay at that port of this machine."""
    return server.stream(sock=socket.create_connection(("127.0.0.1", port)), max_queue=None)


def main() -> None:
    executable, path, isovalue = sys.argv[1], sys.argv[2], float(sys.argv[3])
    with Server(executable, "serve", path) as server:
        host, port = server.host.split(":")
        words = [sys.executable, str(TESTS / "support" / "delay_relay.py"), host, port, *sys.argv[4:]]
        relay = None
        if len(sys.argv) > 4:
            relay = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
            assert relay.stdout is not None
            port = relay.stdout.readline()
        try:
            results = {"whole": [whole(server, isovalue, int(port)) for _ in range(3)]}
            with stream(server, int(port)) as line:
                client = Client(line).begin()
                client.until("fine", client.wish(iso=isovalue), 600)
                results["drag"] = [drag(client, isovalue)]
                results["drag at 60 Hz"] = [drag_at_60_hz(client, isovalue)]
                results["drag of 50,000"] = [drag(client, isovalue, **of_50000(client, isovalue))]
        finally:
            if relay is not None:
                relay.communicate()
    print(json.dumps(results, indent=1))


if __name__ == "__main__":
    main()
