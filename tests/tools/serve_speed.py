"""serve_speed.py ISOBRICK FILE ISOVALUE: how fast `isobrick serve` answers on this machine, as JSON.

Times are those of a client that only receives: from the wish to the last byte. `drag`: the isovalue moves before each
wish, as by a slider, and the client says that it draws at once; the surface is all of it, as fine as the server's pace has
it, or within a radius that gives 50,000 triangles. `whole`: all of the surface at level 0.
"""

from __future__ import annotations

import json
import statistics
import sys
import time
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[2] / "python" / "tests"))
from stream_client import Client, Server  # noqa: E402


def drag(client: Client, isovalue: float, times: int = 60, **members: Any) -> dict[str, Any]:
    """First surfaces after a change."""
    seconds, triangles = [], []
    for i in range(times):
        begin = time.perf_counter()
        wish = client.wish(iso=isovalue * (1 + 0.0005 * (i % 20 + 1)), **members)
        shown = client.until("show", wish)
        seconds.append(time.perf_counter() - begin)
        triangles.append(shown["triangles"])
        client.socket.send(json.dumps({"type": "shown", "pass": shown["pass"], "seconds": 0.001}))
    seconds, triangles = seconds[times // 3 :], triangles[times // 3 :]  # the pace is found by then
    ordered = sorted(seconds)
    return {
        "median_ms": round(1000 * statistics.median(seconds), 1),
        "p95_ms": round(1000 * ordered[int(0.95 * len(ordered))], 1),
        "triangles": int(statistics.median(triangles)),
    }


def of_50000(client: Client, isovalue: float) -> dict[str, Any]:
    """The focus and the radius of a surface of about as many."""
    focus = [(n - 1) / 2 for n in client.volume["dimensions"]]
    low, high = 1.0, float(max(client.volume["dimensions"]))
    for _ in range(8):
        radius = (low + high) / 2
        client.until("fine", client.wish(iso=isovalue, focus=focus, radius=radius))
        low, high = (radius, high) if client.triangles() < 50_000 else (low, radius)
    return {"focus": focus, "radius": radius}


def whole(server: Server, isovalue: float) -> dict[str, Any]:
    """All passes up to the finest, and the bytes of its chunks alone."""
    with server.stream() as line:
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


def main() -> None:
    executable, path, isovalue = sys.argv[1], sys.argv[2], float(sys.argv[3])
    with Server(executable, "serve", path) as server:
        results = {"whole": [whole(server, isovalue) for _ in range(3)]}
        with server.stream() as line:
            client = Client(line).begin()
            client.until("fine", client.wish(iso=isovalue), 600)
            results["drag"] = [drag(client, isovalue)]
            results["drag of 50,000"] = [drag(client, isovalue, **of_50000(client, isovalue))]
    print(json.dumps(results, indent=1))


if __name__ == "__main__":
    main()
