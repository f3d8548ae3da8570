"""`isobrick serve`: what comes over the network, to friend and foe."""

from __future__ import annotations

import concurrent.futures
import contextlib
import http.client
import json
import os
import random
import signal
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from stream_client import Client, Server, open_edges
from websockets.exceptions import ConnectionClosed, InvalidStatus

from isobrick._command import EXECUTABLE

TESTS = Path(__file__).parents[2] / "tests"


def run(*words: object) -> None:
    done = subprocess.run([str(EXECUTABLE), *map(str, words)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def write_volume(path: Path, n: int = 48, steps: str = "(0.5,0,0) (0,0.7,0) (0,0,-0.9)") -> None:
    """A closed surface at 0.5 with much of it, in a place and with a spacing of its own."""
    z, y, x = np.mgrid[0:n, 0:n, 0:n].astype(np.float64) * (2 * np.pi / 24)
    gyroid = np.sin(x) * np.cos(y) + np.sin(y) * np.cos(z) + np.sin(z) * np.cos(x)
    values = np.zeros((n, n, n), "<f4")
    inner = slice(3, -3)
    values[inner, inner, inner] = (1.1 - np.abs(gyroid))[inner, inner, inner]
    header = (
        f"NRRD0004\ntype: float\ndimension: 3\nsizes: {n} {n} {n}\nencoding: raw\nendian: little\n"
        f"space: left-posterior-superior\nspace directions: {steps}\n"
        "space origin: (5,-6,7)\n\n"
    )
    path.write_bytes(header.encode() + values.tobytes())


def read_ply(path: Path) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Vertices and triangles of a binary PLY of the command."""
    head, data = path.read_bytes().split(b"end_header\n", 1)
    lines = head.decode().splitlines()
    counts = {words[1]: int(words[2]) for words in map(str.split, lines) if words[0] == "element"}
    kind = "<f8" if "property double x" in lines else "<f4"
    vertex = np.dtype([(name, kind) for name in "xyz"] + [("normal", "<f4", 3)])
    vertices = np.frombuffer(data, vertex, counts["vertex"])
    face = np.dtype([("n", "u1"), ("corners", "<u4", 3), ("level", "u1")])
    faces = np.frombuffer(data, face, counts["face"], vertices.nbytes)
    return (np.stack([vertices[name] for name in "xyz"], axis=1).astype(np.float64),
            faces["corners"].astype(np.int64))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("served")
    write_volume(path / "field.nrrd")
    run("build", path / "field.nrrd", "-o", path / "field.isb", "--brick", 16)
    return path


@pytest.fixture(scope="module")
def server(folder: Path) -> Iterator[Server]:
    with Server(EXECUTABLE, "serve", folder / "field.isb", "--threads", 2) as running:
        yield running


def ask(server: Server, path: str, key: bool = True, method: str = "GET",
        **headers: str) -> tuple[int, dict[str, str], bytes]:
    """One request; `Host` and others may be given."""
    connection = http.client.HTTPConnection(server.host, timeout=30)
    try:
        connection.putrequest(method, path, skip_host="Host" in headers)
        if key:
            connection.putheader("Authorization", "Bearer " + server.key)
        for name, value in headers.items():
            connection.putheader(name.replace("_", "-"), value)
        connection.endheaders()
        answer = connection.getresponse()
        return answer.status, {k.lower(): v for k, v in answer.getheaders()}, answer.read()
    finally:
        connection.close()


def opened(server: Server, volume: int = 0) -> dict[str, Any]:
    """The facts of a volume, once it is open."""
    for _ in range(600):
        status, _, body = ask(server, f"/api/volume/{volume}")
        if status == 200:
            return dict(json.loads(body))
        assert status == 202, body
        time.sleep(0.05)
    raise AssertionError("the volume was not opened")


@contextlib.contextmanager
def range_server(folder: Path) -> Iterator[str]:
    """The address of tests/support/range_server.py."""
    words = [sys.executable, str(TESTS / "support" / "range_server.py"), str(folder)]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as ranges:
        assert ranges.stdout is not None
        yield f"http://127.0.0.1:{int(ranges.stdout.readline())}"
        ranges.communicate()


def check_as_of_extract(client: Client, volume: int, pyramid: Path, isovalue: float, folder: Path) -> None:
    """The shown chunks of a volume, joined, are the closed surface that `isobrick extract` makes."""
    places, normals, triangles = client.mesh(volume)
    step = client.volumes[volume]["position_step"]
    matrix = np.array(client.volumes[volume]["index_to_world"]).reshape(4, 4).T
    assert open_edges(triangles) == 0
    run("extract", pyramid, "--iso", isovalue, "-o", folder / "mesh.ply", "--force")
    vertices, faces = read_ply(folder / "mesh.ply")
    assert len(triangles) == len(faces) and len(places) == len(vertices)
    to_index = np.linalg.inv(matrix[:3, :3])
    wanted = (vertices - matrix[:3, 3]) @ to_index.T / step
    # The same vertices, each within a step; along each axis they are in the same places then.
    for axis in range(3):
        assert np.abs(np.sort(wanted[:, axis]) - np.sort(places[:, axis])).max() <= 1.01
    world = places * step @ matrix[:3, :3].T + matrix[:3, 3]

    def volume_of(points: NDArray[np.float64], corners: NDArray[np.int64]) -> float:
        a, b, c = (points[corners[:, i]] for i in range(3))
        return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6)

    assert volume_of(world, triangles) > 0, "triangles are seen from outside in the world"
    assert volume_of(world, triangles) == pytest.approx(volume_of(vertices, faces), rel=1e-2)
    a, b, c = (world[triangles[:, i]] for i in range(3))
    along = np.einsum("ij,ij->i", np.cross(b - a, c - a), normals[triangles].sum(axis=1))
    assert np.mean(along > 0) > 0.99
    assert np.allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-6)


def test_chunks_make_the_closed_surface_of_extract(
    server: Server, folder: Path, tmp_path: Path
) -> None:
    with server.stream() as line:
        client = Client(line).begin()
        client.until("fine", client.wish(iso=0.5))
        check_as_of_extract(client, 0, folder / "field.isb", 0.5, tmp_path)


@pytest.fixture(scope="module")
def two_volumes(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Server, list[Path]]]:
    """The volume, one of another grid, and what is none."""
    path = tmp_path_factory.mktemp("beside")
    write_volume(path / "other.nrrd", 40, "(0.6,0,0) (0,0.6,0) (0,0,0.6)")
    run("build", path / "other.nrrd", "-o", path / "other.isb", "--brick", 16)
    (path / "damaged.isb").write_bytes(b"no pyramid")
    paths = [folder / "field.isb", path / "other.isb", path / "damaged.isb"]
    with Server(EXECUTABLE, "serve", *paths, "--threads", 2) as running:
        yield running, paths[:2]


def test_volumes_of_one_scene_are_the_surfaces_of_each(
    two_volumes: tuple[Server, list[Path]], tmp_path: Path
) -> None:
    server, paths = two_volumes
    with server.stream() as line:
        client = Client(line).begin()
        # Its wish is kept until it is open.
        wishes = [client.wish(iso=0.5), client.wish(volume=1, iso=0.4)]
        fine = {(said["volume"], said["wish"]) for said in (client.until("fine"), client.until("fine"))}
        assert fine == {(0, wishes[0]), (1, wishes[1])}
        assert client.volumes[1]["name"] == "other.isb"
        check_as_of_extract(client, 0, paths[0], 0.5, tmp_path)
        check_as_of_extract(client, 1, paths[1], 0.4, tmp_path)
        # Another wish of one of them leaves the other as it is.
        shown = client.shown_of(0)
        assert client.until("fine", client.wish(volume=1, iso=0.7, most_triangles=8000))["limited"]
        assert client.shown_of(0) == shown and 0 < client.triangles(1) <= 8000
        assert open_edges(client.mesh(1)[2]) == 0


def test_a_volume_leaves_the_scene_and_comes_back(
    two_volumes: tuple[Server, list[Path]], tmp_path: Path
) -> None:
    server, paths = two_volumes
    with server.stream() as line:
        client = Client(line).begin()
        line.send('{"type":"open","volume":1}')
        client.until("volume")
        for _ in range(5):
            client.wish(volume=1, iso=0.4)
            line.send('{"type":"end","volume":1}')
            client.until("ended")  # what was on its way comes before
            assert client.shown_of(1) == []
        for word in ('{"type":"end","volume":1}', '{"type":"shown","volume":1,"pass":1,"seconds":0}'):
            line.send(word)  # of a volume that is in no scene
        line.send('{"type":"end","volume":0}')
        client.until("ended")
        client.until("fine", client.wish(volume=1, iso=0.4))
        client.until("fine", client.wish(volume=0, iso=0.5))
        check_as_of_extract(client, 0, paths[0], 0.5, tmp_path)
        check_as_of_extract(client, 1, paths[1], 0.4, tmp_path)


def test_a_volume_that_cannot_be_opened_leaves_the_others(two_volumes: tuple[Server, list[Path]]) -> None:
    server, _ = two_volumes
    with server.stream() as line:
        client = Client(line).begin()
        client.wish(volume=2, iso=1)
        while (said := client.receive())["type"] != "error":
            pass
        assert said["volume"] == 2 and "damaged.isb" in said["error"]
        client.until("fine", client.wish(iso=0.5))
        assert open_edges(client.mesh()[2]) == 0
        client.wish(volume=3, iso=1)  # there is none
        with pytest.raises(ConnectionClosed) as closed:
            while True:
                line.recv(10)
        assert closed.value.rcvd is not None and closed.value.rcvd.code == 1008


def test_steps_of_time_are_said(two_volumes: tuple[Server, list[Path]], folder: Path) -> None:
    server, _ = two_volumes
    assert json.loads(ask(server, "/api/volumes")[2])["steps"] is False
    files = [folder / "field.isb"]
    with Server(EXECUTABLE, "serve", *files, *files, "--steps") as steps:
        assert json.loads(ask(steps, "/api/volumes")[2])["steps"] is True
    done = subprocess.run([EXECUTABLE, "serve", *files, "--steps"], capture_output=True, text=True)
    assert done.returncode == 2 and "give more of them" in done.stderr


def test_surfaces_of_several_levels_are_closed_too(server: Server) -> None:
    with server.stream() as line:
        client = Client(line).begin()
        wish = client.wish(iso=0.5, focus=[10, 20, 30], radius=4)
        fine = client.until("fine", wish)
        assert "limited" not in fine
        assert len({client.kept[number].level for number in client.shown}) > 1
        assert open_edges(client.mesh()[2]) == 0


def test_a_newer_wish_takes_the_place_of_the_older(server: Server) -> None:
    with server.stream() as line:
        client = Client(line).begin()
        for i in range(100):
            client.wish(iso=0.5 + 0.001 * i, focus=[24, 24, 24], radius=200)
        client.until("fine", client.wish_number)
        assert open_edges(client.mesh()[2]) == 0
        assert set(client.kept) == client.shown, "all others were dropped"
        # What was kept from one isovalue would be open to what came for another.
        client.until("fine", client.wish(surfaces=[{"iso": 0.5}, {"iso": 0.9}]))
        assert {client.kept[number].surface for number in client.shown} == {0, 1}
        client.until("fine", client.wish(surfaces=[{"iso": 0.5}, {"iso": 0.9, "visible": False}]))
        assert {client.kept[number].surface for number in client.shown} == {0}


def test_a_client_that_can_take_little_gets_less(server: Server) -> None:
    with server.stream() as line:
        client = Client(line).begin()
        client.until("fine", client.wish(iso=0.5))
        everything = client.triangles()
        fine = client.until("fine", client.wish(iso=0.51, most_triangles=everything // 3))
        assert "limited" in fine
        assert 0 < client.triangles() <= everything // 3


@pytest.mark.parametrize("message", [
    "", "null", "[]", "{", "\x00", "{}", '{"type":7}', "[" * 60000, '{"type":"wish"}',
    '{"type":"wish","wish":1,"surfaces":[' + "[" * 30000 + "]" * 30000 + "]}",
    '{"type":"wish","wish":1,"surfaces":[]}', '{"type":"wish","wish":1,"surfaces":[{"iso":"1"}]}',
    '{"type":"wish","wish":1,"surfaces":[{"iso":1e999}]}',
    '{"type":"wish","wish":1,"surfaces":[{"iso":1}],"focus":[1,2]}',
    '{"type":"wish","wish":1,"surfaces":[{"iso":1}],"focus":[1,2,3]}',
    '{"type":"wish","wish":1,"surfaces":[{"iso":1}],"view":3}',
    '{"type":"shown","pass":1}',
])  # fmt: skip
def test_a_message_that_is_none_ends_the_stream_alone(server: Server, message: str) -> None:
    with server.stream() as line, server.stream() as other:
        Client(line).begin()
        line.send(message)
        with pytest.raises(ConnectionClosed) as closed:
            while True:
                line.recv(10)
        assert closed.value.rcvd is not None and closed.value.rcvd.code == 1008
        client = Client(other).begin()
        client.until("fine", client.wish(iso=0.5, focus=[1, 2, 3], radius=8))


def test_unknown_messages_and_members_are_left_aside(server: Server) -> None:
    with server.stream() as line:
        client = Client(line).begin()
        line.send('{"type":"later version","x":[1]}')
        client.until("fine", client.wish(iso=0.5, later=True))
        line.send('{"type":"wish","wish":900,"x":[[["[[["]]],"surfaces":[{"iso":0.5,"x":[{}]}]}')
        client.until("fine", 900)
        assert ask(server, "/api/volume/0/slice.png?x=[[1]]")[0] == 200
        # So deep that copies of it would take all of the stack.
        deep = "[" * 14000 + "]" * 14000
        assert ask(server, "/api/volume/0/slice.png?x=" + deep[12000:-12000])[0] == 400
        line.send(f'{{"type":"wish","wish":901,"x":{deep},"surfaces":[{{"iso":0.5,"x":{deep}}}]}}')
        with pytest.raises(ConnectionClosed):
            client.until("fine", 901)
    assert ask(server, "/healthz")[0] == 200


def test_random_bytes_and_huge_frames(server: Server) -> None:
    numbers = random.Random(7)
    for length in (1, 100, 60000, 70000, 1 << 24):
        with server.stream() as line:
            Client(line).begin()
            with pytest.raises(ConnectionClosed):
                line.send(numbers.randbytes(length))
                while True:
                    line.recv(10)
    for text in (b"\r\n" * 100, b"GET", b"GET / HTTP/9.9\r\n\r\n", numbers.randbytes(5000),
                 b"GET / HTTP/1.1\r\nHost: x\r\nA: " + b"a" * 100_000 + b"\r\n\r\n",
                 b"POST / HTTP/1.1\r\nHost: x\r\nContent-Length: 99999999999\r\n\r\n"):
        with socket.create_connection(server.host.split(":"), timeout=20) as line:
            try:
                line.sendall(text)
                line.shutdown(socket.SHUT_WR)
                while line.recv(65536):
                    pass
            except OSError:
                pass
    assert ask(server, "/healthz", key=False)[0] == 200


def test_keys_hosts_and_origins(server: Server) -> None:
    port = server.host.split(":")[1]
    assert ask(server, "/healthz", key=False)[2] == b"ok\n"
    assert ask(server, "/healthz?%zz", key=False)[0] == 200, "nothing is parsed without a key"
    for path in ("/api/volumes", "/api/volume/0", "/api/volume/0/slice.png", "/metrics",
                 "/api/volume/0/surface.glb?iso=0.5"):
        assert ask(server, path, key=False)[0] == 401
        assert ask(server, path, key=False, Authorization="Bearer " + "0" * 32)[0] == 401
        assert ask(server, path, key=False, Authorization="Basic " + server.key)[0] == 401
    for host in ("evil.example", f"evil.example:{port}", "127.0.0.1", f"127.0.0.1.evil:{port}", ""):
        assert ask(server, "/api/volumes", Host=host)[0] == 403
        assert ask(server, "/healthz", Host=host)[0] == 403
    assert ask(server, "/api/volumes", Host=f"LOCALHOST:{port}")[0] == 200
    for origin in ("null", "http://evil.example", f"https://127.0.0.1:{port}",
                   f"http://127.0.0.1:{int(port) - 1}"):
        assert ask(server, "/api/volumes", Origin=origin)[0] == 403
    status, headers, _ = ask(server, "/api/volumes", Origin=server.address)
    assert status == 200 and "access-control-allow-origin" not in headers
    assert "default-src 'none'" in headers["content-security-policy"]
    # Beside its own pages the window of VS Code may show it, whose notebooks are frames.
    assert headers["content-security-policy"].endswith("frame-ancestors 'self' vscode-webview: vscode-file:")
    assert ask(server, "/api/volumes", method="OPTIONS", Origin=server.address)[0] == 405
    status, headers, _ = ask(server, "/api/volumes", method="POST")
    assert status == 405 and headers["allow"] == "GET, HEAD"
    for protocols in (["isobrick.1"], ["token." + server.key], ["isobrick.1", "token." + "0" * 32]):
        with pytest.raises(InvalidStatus) as refused:
            with server.stream(subprotocols=protocols):
                pass
        assert refused.value.response.status_code == 401
    with pytest.raises(InvalidStatus) as refused, server.stream(origin="http://evil.example"):
        pass
    assert refused.value.response.status_code == 403
    with server.stream(origin=server.address) as line:
        Client(line).begin()


def test_an_origin_that_is_let_in(folder: Path) -> None:
    page = "https://scans.example.org"
    with Server(EXECUTABLE, "serve", folder / "field.isb", "--origin", page,
                "--base-path", "/iso") as server:
        status, headers, _ = ask(server, "/iso/api/volumes", Origin=page)
        assert status == 200 and headers["access-control-allow-origin"] == page
        assert ask(server, "/iso/api/volumes", Host="scans.example.org")[0] == 200
        assert ask(server, "/iso/api/volumes", key=False, method="OPTIONS", Origin=page)[0] == 204
        assert ask(server, "/api/volumes")[0] == 404


def test_requests(server: Server, folder: Path, tmp_path: Path) -> None:
    facts = opened(server)
    assert facts["dimensions"] == [48, 48, 48] and facts["name"] == "field.isb"
    listed = json.loads(ask(server, "/api/volumes")[2])
    assert listed["protocol"] == 1 and listed["volumes"][0]["state"] == "open"
    status, headers, mesh = ask(server, "/api/volume/0/surface.ply?iso=0.5&focus=9,9,9&radius=5")
    assert status == 200 and mesh.startswith(b"ply\n")
    same = tmp_path / "same.ply"
    run("extract", folder / "field.isb", "--iso", 0.5, "--focus", "9,9,9", "--radius", 5, "-o", same)
    assert mesh == same.read_bytes()
    path = "/api/volume/0/surface.ply?radius=5&iso=0.5&focus=9,9,9"
    assert ask(server, path, If_None_Match=headers["etag"])[0] == 304
    assert ask(server, "/api/volume/0/surface.glb?iso=0.5&meshopt=1")[2].startswith(b"glTF")
    assert len(ask(server, "/api/volume/0/surface.stl?iso=0.5&level=2&simplify=0.1")[2]) > 84
    for words in ("", "?axis=x&position=3&size=64&window=0,1&iso=0.5", "?least=0.5",
                  "?corner=0,0,0&across=99,0,0&along=0,40,40"):
        status, headers, picture = ask(server, "/api/volume/0/slice.png" + words)
        assert status == 200 and picture.startswith(b"\x89PNG")
    for bad in ("surface.ply", "surface.ply?iso=x", "surface.ply?iso=1&focus=1,2", "slice.png?axis=w",
                "surface.ply?iso=1&level=0&focus=1,2,3&radius=1", "slice.png?size=1e9",
                "slice.png?position=-1", "slice.png?%zz", "slice.png?a=1&a=2", "slice.png?=",
                "slice.png?corner=1,2,3", "surface.ply?iso=1&meshopt=1"):
        assert ask(server, "/api/volume/0/" + bad)[0] == 400, bad
    for missing in ("/api/volume/1", "/api/volume/99999999999999999999", "/api/volume/-1", "/../x",
                    "/api/volume/0/other", "/api/volume/0x", "/api/nothing"):
        assert ask(server, missing)[0] == 404, missing
    assert ask(server, "/api/volume/0/surface.ply?iso=0.5&level=40")[0] == 500
    assert b"isobrick_requests_total" in ask(server, "/metrics")[2]


def test_a_folder_and_a_volume(folder: Path, tmp_path: Path) -> None:
    scans = tmp_path / "scans"
    scans.mkdir()
    (scans / "notes.txt").write_text("no volume")
    (scans / "a.isb").symlink_to(folder / "field.isb")
    (scans / "scan.nrrd").symlink_to(folder / "field.nrrd")
    with Server(EXECUTABLE, "serve", scans, "--cache-folder", tmp_path / "cache") as server:
        names = [row["name"] for row in json.loads(ask(server, "/api/volumes")[2])["volumes"]]
        assert names == ["a.isb", "scan.nrrd"]
        assert ask(server, "/api/volume/1/slice.png?build=0")[0] == 409
        assert ask(server, "/api/volume/1/slice.png?axis=q")[0] == 400, "before anything is built"
        assert ask(server, "/api/volume/0/slice.png?position=99")[0] == 400
        status, _, picture = ask(server, "/api/volume/0/slice.png?size=32")
        assert status == 200 and max(struct.unpack_from(">II", picture, 16)) <= 32
        rows = json.loads(ask(server, "/api/volumes")[2])["volumes"]
        assert [row["state"] for row in rows] == ["closed", "closed"], "a picture opens nothing"
        # The first that asks has it built, and others wait for the same.
        paths = ["surface.ply?iso=0.5", "surface.stl?iso=0.5&level=1", "slice.png?axis=y", "slice.png"]
        with concurrent.futures.ThreadPoolExecutor(8) as pool:
            answers = list(pool.map(lambda path: ask(server, "/api/volume/1/" + path), 2 * paths))
        assert [status for status, _, _ in answers] == 8 * [200]
        assert answers[0][2] == answers[4][2] and answers[0][2].startswith(b"ply\n")
        assert len(list((tmp_path / "cache").glob("*.isb"))) == 1
        assert opened(server, 1)["dimensions"] == [48, 48, 48]
        with server.stream(1) as line:
            client = Client(line).begin()
            client.until("fine", client.wish(iso=0.5))
            assert open_edges(client.mesh()[2]) == 0
        (scans / "a.isb").unlink()
        with server.stream(0) as line, pytest.raises(ConnectionClosed):
            while True:
                line.recv(20)
    with Server(EXECUTABLE, "serve", folder / "field.isb") as server:
        assert ask(server, "/api/volume/0/surface.glb?iso=0.5")[2].startswith(b"glTF"), "at once"


def test_a_volume_that_takes_long_is_said_and_keeps_nobody_waiting(folder: Path, tmp_path: Path) -> None:
    with range_server(folder) as address:
        url = f"{address}/hangs/1/field.isb"
        with (Server(EXECUTABLE, "serve", url, folder / "field.isb", "--cache-folder", tmp_path) as server,
              concurrent.futures.ThreadPoolExecutor(1) as pool):
            slow = pool.submit(ask, server, "/api/volume/0/surface.glb?iso=0.5")
            status, headers, body = ask(server, "/api/volume/0")
            assert status == 202 and headers["retry-after"] == "1" and b"opening" in body
            assert ask(server, "/api/volume/1/surface.glb?iso=0.5")[0] == 200 and not slow.done()
            status, headers, body = slow.result(60)
            assert status == 503 and headers["retry-after"] == "1" and b"ask again" in body


def test_requests_that_wait_are_bounded_and_end_with_their_clients(folder: Path, tmp_path: Path) -> None:
    with range_server(folder) as address:
        url = f"{address}/hangs/1/field.isb"
        with Server(EXECUTABLE, "serve", url, "--cache-folder", tmp_path) as server:
            path = "/api/volume/0/surface.glb?iso=0.5"
            text = f"GET {path} HTTP/1.1\r\nHost: {server.host}\r\nAuthorization: Bearer {server.key}\r\n\r\n"
            with contextlib.ExitStack() as lines:
                for _ in range(64):
                    line = lines.enter_context(socket.create_connection(server.host.split(":")))
                    line.sendall(text.encode())
                    assert ask(server, "/healthz")[0] == 200  # so that it is behind the other
                status, headers, body = ask(server, path)
                assert status == 503 and headers["retry-after"] == "1" and b"too many" in body
            for _ in range(100):
                if b"isobrick_connections 1\n" in ask(server, "/metrics")[2]:
                    break
                time.sleep(0.05)
            assert b"isobrick_connections 1\n" in ask(server, "/metrics")[2]


def test_a_fifth_volume_waits_for_its_place(folder: Path, tmp_path: Path) -> None:
    for name in "abcde":
        (tmp_path / f"{name}.isb").symlink_to(folder / "field.isb")
    with Server(EXECUTABLE, "serve", tmp_path) as server:
        with contextlib.ExitStack() as lines:
            for volume in range(4):
                Client(lines.enter_context(server.stream(volume))).begin()
            status, headers, body = ask(server, "/api/volume/4")
            assert status == 503 and headers["retry-after"] == "1" and b"in use" in body


def resident_bytes(server: Server) -> int:
    for line in Path(f"/proc/{server.process.pid}/status").read_text().splitlines():
        if line.startswith("VmRSS"):
            return 1024 * int(line.split()[1])
    raise AssertionError("no VmRSS")


def descriptors(server: Server) -> int:
    return len(os.listdir(f"/proc/{server.process.pid}/fd"))


def test_two_hundred_clients_and_one_that_reads_nothing(folder: Path) -> None:
    with Server(EXECUTABLE, "serve", folder / "field.isb", "--threads", 2,
                "--memory", "64M") as server:
        opened(server)
        before = descriptors(server)
        lines = contextlib.ExitStack()
        lazy = Client(lines.enter_context(server.stream(max_queue=1))).begin()
        lazy.wish(iso=0.5)

        def explore(number: int) -> int:
            with server.stream(open_timeout=60) as line:
                client = Client(line).begin()
                client.until("fine", client.wish(iso=0.5 + 0.001 * (number % 50),
                                                 focus=[number % 48, 24, 24], radius=8), 300)
                return open_edges(client.mesh()[2]) if number % 40 == 0 else 0

        with concurrent.futures.ThreadPoolExecutor(199) as pool:
            assert set(pool.map(explore, range(199))) == {0}
        assert resident_bytes(server) < (64 << 20) + 200 * (32 << 20)
        for _ in range(199):
            lines.enter_context(server.stream())
        with pytest.raises(InvalidStatus) as refused, server.stream():
            pass
        assert refused.value.response.status_code == 429
        lines.close()
        for _ in range(200):
            if descriptors(server) <= before:
                break
            time.sleep(0.05)
        assert descriptors(server) <= before
        status, said = server.end()
        assert status == 0 and "clients" in said


def test_connections_that_say_nothing_are_ended(server: Server) -> None:
    with socket.create_connection(server.host.split(":"), timeout=30) as half:
        half.sendall(b"GET /healthz HTTP/1.1\r\nHo")
        begin = time.monotonic()
        assert half.recv(1) == b""
        assert 5 < time.monotonic() - begin < 25


def test_head_and_range(server: Server) -> None:
    opened(server)
    connection = http.client.HTTPConnection(server.host, timeout=30)
    key = {"Authorization": "Bearer " + server.key}
    path = "/api/volume/0/surface.glb?iso=0.5&level=2"
    for headers in ({}, {"Range": "bytes=3-9"}, {"Range": "bytes=9-3,x"}, {"Expect": "100-continue"}):
        # On one connection, so that a body where none may be would be seen.
        connection.request("HEAD", path, headers=key | headers)
        answer = connection.getresponse()
        assert answer.status == 200 and answer.read() == b""
        length = int(answer.headers["Content-Length"])
        connection.request("GET", path, headers=key | headers)
        answer = connection.getresponse()
        assert answer.status == 200 and len(answer.read()) == length
        for method in ("HEAD", "OPTIONS", "DELETE"):
            connection.request(method, "/api/volume/9", headers=key)
            answer = connection.getresponse()
            assert answer.status == (404 if method == "HEAD" else 405)
            assert (answer.read() == b"") == (method == "HEAD")
    connection.close()


def test_a_file_that_is_replaced_while_it_is_served(folder: Path, tmp_path: Path) -> None:
    path = tmp_path / "field.isb"
    path.write_bytes((folder / "field.isb").read_bytes())
    run("build", folder / "field.nrrd", "-o", tmp_path / "other.isb", "--brick", 32)
    with Server(EXECUTABLE, "serve", path, "--memory", "1M") as server:
        before = opened(server)
        with server.stream() as line:
            client = Client(line).begin()
            client.until("fine", client.wish(iso=0.5))
            os.replace(tmp_path / "other.isb", path)
            assert opened(server)["edition"] != before["edition"]
            client.until("fine", client.wish(iso=0.6))
            assert open_edges(client.mesh()[2]) == 0
        # Cut off in its place: an error, and others go on.
        with server.stream() as line:
            client = Client(line).begin()
            os.truncate(path, path.stat().st_size // 2)
            with contextlib.suppress(AssertionError, ConnectionClosed):
                client.until("fine", client.wish(iso=0.7))
        assert ask(server, "/healthz")[0] == 200
        path.unlink()
        for _ in range(100):
            if ask(server, "/api/volume/0")[0] == 500:
                break
            time.sleep(0.05)
        assert "No such file" in json.loads(ask(server, "/api/volume/0")[2])["error"]
        assert server.end()[0] == 0


def relay_of(server: Server, milliseconds: float, megabits: float) -> subprocess.Popen[str]:
    """A slow line to the server, until its stdin is closed; says its port."""
    words = [sys.executable, str(TESTS / "support" / "delay_relay.py"), *server.host.split(":")]
    return subprocess.Popen([*words, str(milliseconds), str(megabits)], stdin=subprocess.PIPE,
                            stdout=subprocess.PIPE, text=True)


def test_a_slow_line_slows_itself_alone(server: Server) -> None:
    with relay_of(server, 20, 2) as relay:
        assert relay.stdout is not None
        sock = socket.create_connection(("127.0.0.1", int(relay.stdout.readline())))
        with server.stream(sock=sock) as line, server.stream() as near:
            client, other = Client(line).begin(), Client(near).begin()
            client.until("fine", client.wish(iso=0.4))
            answered = []
            for i in range(120):
                client.wish(iso=0.4 + 0.001 * i)
                end = time.monotonic() + 1 / 60
                while (left := end - time.monotonic()) > 0:
                    with contextlib.suppress(TimeoutError):
                        said = client.receive(left)
                        if said["type"] == "show":
                            answered.append(said["wish"])
                if i == 30:
                    other.until("fine", other.wish(iso=0.5))
            assert answered == sorted(answered) and len(answered) < 120
            client.until("fine", client.wish_number)
            assert open_edges(client.mesh()[2]) == 0
        relay.communicate()


def test_a_volume_behind_a_url(folder: Path, tmp_path: Path) -> None:
    with range_server(folder) as address:
        url = f"{address}/good/field.isb"
        with Server(EXECUTABLE, "serve", url, "--cache-folder", tmp_path) as server:
            assert ask(server, "/api/volume/0/slice.png?size=48")[0] == 200
            assert opened(server)["name"] == "field.isb"
            with server.stream() as line:
                client = Client(line).begin()
                client.until("fine", client.wish(iso=0.5))
                assert open_edges(client.mesh()[2]) == 0


def test_it_ends_in_the_middle_of_an_extraction(folder: Path, tmp_path: Path) -> None:
    for after in (0.0, 0.2):
        server = Server(EXECUTABLE, "serve", folder / "field.isb", env=os.environ | {"TMPDIR": str(tmp_path)})
        opened(server)
        lines = contextlib.ExitStack()
        for i in range(5):
            Client(lines.enter_context(server.stream())).begin().wish(iso=0.4 + 0.1 * i)
        with concurrent.futures.ThreadPoolExecutor(6) as pool:
            for i in range(6):
                pool.submit(ask, server, f"/api/volume/0/surface.glb?iso=0.{i + 3}&meshopt=1&simplify=0.2")
            time.sleep(after)
            server.process.send_signal(signal.SIGINT)
            assert server.end()[0] == 0
            lines.close()
        assert not list(tmp_path.iterdir()), "no surface is left behind"


def test_it_ends_with_clients_at_work(folder: Path) -> None:
    server = Server(EXECUTABLE, "serve", folder / "field.isb")
    with server.stream() as line:
        Client(line).begin().wish(iso=0.5)
        status, said = server.end()
        assert status == 0 and "1 clients" in said
        with pytest.raises(ConnectionClosed):
            while True:
                line.recv(10)
