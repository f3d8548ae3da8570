"""A client of `isobrick serve` that knows docs/SERVE.md alone; shared by tests and measurements."""

from __future__ import annotations

import json
import struct
import subprocess
import time
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from websockets.sync.client import ClientConnection, connect


class Server:
    """The command under test, which ends with the block."""

    def __init__(self, *words: object, **options: Any) -> None:
        self.process = subprocess.Popen(
            [str(word) for word in words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
            **options,
        )
        assert self.process.stdout is not None
        url = self.process.stdout.readline().strip()
        assert "#token=" in url, self.process.communicate()[1]
        self.address, self.key = url.split("/#token=")
        self.host = self.address.split("/")[2]

    def __enter__(self) -> Server:
        return self

    def __exit__(self, *unused: object) -> None:
        self.end()

    def end(self) -> tuple[int, str]:
        """Its exit status, and what it said, after a request to end."""
        if self.process.poll() is None:
            self.process.terminate()
        said = self.process.communicate(timeout=30)[1]
        return self.process.returncode, said

    def stream(self, volume: int = 0, **options: Any) -> ClientConnection:
        """A connection to the stream of a volume, to be used by `with`."""
        protocols = options.pop("subprotocols", ["isobrick.1", "token." + self.key])
        return connect(
            f"ws://{self.host}/api/volume/{volume}/stream",
            subprotocols=protocols,
            max_size=None,
            compression=None,
            **options,
        )


def unpack_vertices(data: bytes, count: int, stride: int) -> NDArray[np.uint8]:
    """Mode ATTRIBUTES of EXT_meshopt_compression, version 0: a row of bytes for each vertex."""
    assert data[0] == 0xA0
    last = np.frombuffer(data[len(data) - stride :], np.uint8).astype(np.int64)
    block = min((8192 // stride) & ~15, 256)
    at = 1
    rows = np.zeros((count, stride), np.uint8)
    for first in range(0, count, block):
        size = min(block, count - first)
        groups = (size + 15) // 16
        for k in range(stride):
            modes = data[at : at + (groups + 3) // 4]
            at += (groups + 3) // 4
            deltas = np.zeros(16 * groups, np.int64)
            for group in range(groups):
                mode = modes[group // 4] >> (2 * (group % 4)) & 3
                if mode == 3:
                    deltas[16 * group : 16 * group + 16] = np.frombuffer(data, np.uint8, 16, at)
                    at += 16
                elif mode > 0:
                    bits = 2 * mode
                    packed = np.frombuffer(data, np.uint8, 2 * bits, at)
                    at += 2 * bits
                    shifts = np.arange(8 - bits, -1, -bits)
                    values = (packed[:, None] >> shifts & (1 << bits) - 1).reshape(-1).astype(np.int64)
                    for i in np.flatnonzero(values == (1 << bits) - 1):
                        values[i] = data[at]
                        at += 1
                    deltas[16 * group : 16 * group + 16] = values
            steps = (deltas[:size] >> 1) ^ -(deltas[:size] & 1)
            column = np.cumsum(steps) + last[k]
            rows[first : first + size, k] = column & 0xFF
            last[k] = column[-1] & 0xFF
    return rows


def unpack_triangles(data: bytes, count: int) -> NDArray[np.int64]:
    """Mode TRIANGLES, version 1: `count` indices."""
    assert data[0] == 0xE1
    triangles = count // 3
    codes, table = data[1 : 1 + triangles], data[len(data) - 16 :]
    at = 1 + triangles
    edges: list[tuple[int, int]] = [(0, 0)] * 16
    vertices = [0] * 16
    edge_at = vertex_at = following = last = 0
    result: list[tuple[int, int, int]] = []

    def index() -> int:
        nonlocal at, last
        value = shift = 0
        while True:
            byte = data[at]
            at += 1
            value |= (byte & 127) << shift
            shift += 7
            if byte < 128:
                break
        last += (value >> 1) ^ -(value & 1)
        return last

    def push_edge(a: int, b: int) -> None:
        nonlocal edge_at
        edges[edge_at] = (a, b)
        edge_at = edge_at + 1 & 15

    def push_vertex(v: int) -> None:
        nonlocal vertex_at
        vertices[vertex_at] = v
        vertex_at = vertex_at + 1 & 15

    def fresh() -> int:
        nonlocal following
        following += 1
        return following - 1

    for code in codes:
        if code < 0xF0:
            a, b = edges[(edge_at - 1 - (code >> 4)) & 15]
            low = code & 15
            if low == 0:
                c = fresh()
                push_vertex(c)
            elif low < 13:
                c = vertices[(vertex_at - 1 - low) & 15]
            else:
                if low == 15:
                    c = index()
                else:
                    c = last = last + (-1 if low == 13 else 1)
                push_vertex(c)
            push_edge(c, b)
            push_edge(a, c)
        else:
            if code < 0xFE:
                aux, first = table[code & 15], 0
            else:
                aux, first = data[at], 0 if code == 0xFE else 15
                at += 1
                if aux == 0:
                    following = 0
            # The numbers come in this order, and the vertices that are read after them.
            kinds = [first, aux >> 4, aux & 15]
            spoken = [fresh() if kind == 0 else 0 for kind in kinds]
            for i, kind in enumerate(kinds):
                if i > 0 and kind not in (0, 15):
                    spoken[i] = vertices[(vertex_at - kind) & 15]
                elif kind == 15 and code >= 0xFE:
                    spoken[i] = index()
                elif kind == 15:
                    spoken[i] = vertices[(vertex_at - kind) & 15]
            a, b, c = spoken
            push_vertex(a)
            for kind, v in ((kinds[1], b), (kinds[2], c)):
                if kind == 0 or (kind == 15 and code >= 0xFE):
                    push_vertex(v)
            push_edge(b, a)
            push_edge(c, b)
            push_edge(a, c)
        result.append((a, b, c))
    return np.array(result, np.int64).reshape(-1)


def unpack_normals(rows: NDArray[np.uint8]) -> NDArray[np.float64]:
    """The filter OCTAHEDRAL with stride 8: unit vectors."""
    x, y, one, _ = rows.view(np.int16).astype(np.float64).T
    z = one - np.abs(x) - np.abs(y)
    below = np.minimum(z, 0)
    x += np.where(x >= 0, below, -below)
    y += np.where(y >= 0, below, -below)
    v = np.stack([x, y, z], axis=1)
    return v / np.linalg.norm(v, axis=1, keepdims=True)


@dataclass
class Chunk:
    """One binary message."""

    number: int
    volume: int
    surface: int
    level: int
    packed: bytes
    triangles: int

    @staticmethod
    def of(message: bytes) -> Chunk:
        assert message[:4] == b"ISBC"
        number, surface, level = struct.unpack_from("<IHB", message, 4)
        triangles, volume = (struct.unpack_from("<I", message, at)[0] for at in (28, 44))
        return Chunk(number, volume, surface, level, message, triangles)

    def unpacked(self) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.int64]]:
        """Positions in steps, normals and triangles."""
        origin = np.array(struct.unpack_from("<3i", self.packed, 12))
        v, t, p, n, i = struct.unpack_from("<5I", self.packed, 24)
        at, parts = 48, []
        for size in (p, n, i):
            parts.append(self.packed[at : at + size])
            at += (size + 3) & ~3
        assert at == len(self.packed)
        xyzw = unpack_vertices(parts[0], v, 8).view(np.uint16).astype(np.int64)
        high = np.stack([xyzw[:, 3] >> (5 * axis) & 31 for axis in range(3)], axis=1)
        assert bool(high.any()) == bool(self.packed[11])
        normals = unpack_normals(unpack_vertices(parts[1], v, 8))
        return origin + xyzw[:, :3] + 65536 * high, normals, unpack_triangles(parts[2], 3 * t)


@dataclass
class Client:
    """What a page does: keeps chunks, and shows what it is told to."""

    socket: ClientConnection
    volume: dict[str, Any] = field(default_factory=dict)  # the first that was open
    volumes: dict[int, dict[str, Any]] = field(default_factory=dict)
    numbers: set[int] = field(default_factory=set)  # of all chunks so far
    kept: dict[int, Chunk] = field(default_factory=dict)
    shown: set[int] = field(default_factory=set)
    bytes: int = 0
    last: dict[str, Any] = field(default_factory=dict)
    since: float | None = None  # when the first chunk came that is not shown yet
    says_shown: bool = True  # at once
    wish_number: int = 0

    def begin(self) -> Client:
        """Waits until the volume is open."""
        self.until("volume")
        return self

    def wish(self, **members: Any) -> int:
        """Sends a wish; `iso` is short for one surface."""
        self.wish_number += 1
        if "iso" in members:
            members["surfaces"] = [{"iso": members.pop("iso")}]
        self.socket.send(json.dumps({"type": "wish", "wish": self.wish_number, **members}))
        return self.wish_number

    def receive(self, timeout: float = 60) -> dict[str, Any]:
        """The next text message, with all chunks before it taken."""
        while True:
            message = self.socket.recv(timeout)
            if isinstance(message, bytes):
                self.bytes += len(message)
                self.since = self.since or time.perf_counter()
                chunk = Chunk.of(message)
                assert chunk.number not in self.numbers and chunk.volume in self.volumes
                self.numbers.add(chunk.number)
                self.kept[chunk.number] = chunk
                continue
            self.bytes += len(message)
            said: dict[str, Any] = json.loads(message)
            self.apply(said)
            self.last = said
            return said

    def apply(self, said: dict[str, Any]) -> None:
        """Shows and drops."""
        if said["type"] == "volume":
            self.volumes[said["id"]] = said
            self.volume = self.volume or said
        if said["type"] == "ended":
            del self.volumes[said["volume"]]
            self.kept = {n: chunk for n, chunk in self.kept.items() if chunk.volume != said["volume"]}
            self.shown &= set(self.kept)
        for first, last in said.get("show", []):
            for number in range(first, last + 1):
                if number in self.kept:
                    self.shown.add(number)
        for first, last in said.get("drop", []):
            for number in range(first, last + 1):
                self.kept.pop(number, None)
                self.shown.discard(number)
        if said["type"] == "show":
            assert self.triangles(said["volume"]) == said["triangles"]
            if self.says_shown:
                self.say_shown(said)

    def say_shown(self, said: dict[str, Any]) -> None:
        """After a `show`."""
        now = time.perf_counter()
        seconds = now - (self.since or now)
        self.since = None
        word = {"type": "shown", "volume": said["volume"], "pass": said["pass"], "seconds": seconds}
        self.socket.send(json.dumps(word))

    def until(self, kind: str, wish: int | None = None, seconds: float = 60) -> dict[str, Any]:
        """Receives up to a message of this type, of this wish."""
        end = time.monotonic() + seconds
        while True:
            said = self.receive(max(0.01, end - time.monotonic()))
            if said["type"] == "error":
                raise AssertionError(said["error"])
            if said["type"] == kind and wish in (None, said.get("wish")):
                return said

    def shown_of(self, volume: int | None = None) -> list[int]:
        """Numbers of the chunks of a volume (default: the first) that are shown."""
        wanted = self.volume["id"] if volume is None else volume
        return sorted(number for number in self.shown if self.kept[number].volume == wanted)

    def triangles(self, volume: int | None = None) -> int:
        """Shown ones."""
        return sum(self.kept[number].triangles for number in self.shown_of(volume))

    def mesh(self, volume: int | None = None) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.int64]]:
        """Those joined: positions in steps, a normal for each, triangles."""
        all_places, all_normals, all_triangles, first = [], [], [], 0
        for number in self.shown_of(volume):
            places, normals, triangles = self.kept[number].unpacked()
            all_places.append(places)
            all_normals.append(normals)
            all_triangles.append(triangles + first)
            first += len(places)
        places, one, number_of = np.unique(
            np.concatenate(all_places), axis=0, return_index=True, return_inverse=True
        )
        triangles = number_of.reshape(-1)[np.concatenate(all_triangles)].reshape(-1, 3)
        return places, np.concatenate(all_normals)[one], triangles


def open_edges(triangles: NDArray[np.int64]) -> int:
    """Edges that are not in exactly two triangles, once each way."""
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    there = {tuple(edge) for edge in edges.tolist()}
    assert len(there) == len(edges)
    return sum((b, a) not in there for a, b in there)
