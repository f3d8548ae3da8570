"""soak.py PART SECONDS ISOBRICK TESTS FOLDER: one part of tests/house/soak.sh, whose settings it takes.

files: random builds, kills and resumes; two processes that query one file, also while it is replaced; meshes that are
checked; and beside all that one process of random queries, builds, cancels, evictions and faults (tests/extract/soak_test.cpp).
serve: 20 clients that come, drag, stall and vanish. window: a window with random events.

TESTS is the folder of isobrick_extract_tests, explore and check_mesh; all is written in FOLDER. Prints figures; the exit
status is 1 if a mesh is wrong, a process fails, or memory, descriptors, threads or temporary files grow.
"""

from __future__ import annotations

import json
import os
import random
import signal
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from pathlib import Path
from typing import Any

PART, SECONDS = sys.argv[1], float(sys.argv[2])
ISOBRICK, TESTS, FOLDER = (Path(word).resolve() for word in sys.argv[3:])
MOST_GROWTH = 32 << 20  # of memory, once what stays from query to query has come
# What a minute tries is another thing each time; a seed tries it again.
SEED = int(os.environ.get("ISOBRICK_SEED", str(time.time_ns())))
CHANCE = random.Random(SEED)
COUNTS: Counter[str] = Counter()
WRONG: list[str] = []


def check(is_right: bool, what: object) -> None:
    if not is_right:
        WRONG.append(str(what)[:2000])


def run(*words: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run([str(word) for word in words], capture_output=True, text=True, cwd=FOLDER)


def run_well(*words: object) -> str:
    done = run(*words)
    check(done.returncode == 0, f"{words}: {done.returncode} {done.stdout}{done.stderr}")
    return done.stdout


class Held:
    """What a process holds now."""

    def __init__(self, pid: int) -> None:
        pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
        self.bytes = pages * os.sysconf("SC_PAGESIZE")
        self.files = len(os.listdir(f"/proc/{pid}/fd"))
        self.threads = len(os.listdir(f"/proc/{pid}/task"))

    def __str__(self) -> str:
        return f"{self.bytes / 2**20:.1f} MiB, {self.files} descriptors, {self.threads} threads"


def check_level(warm: Held, end: Held) -> None:
    print(f"warm: {warm}; at the end: {end}")
    check(end.bytes <= warm.bytes + MOST_GROWTH, "memory grows")
    check(end.files <= warm.files + 4, "descriptors grow")
    check(end.threads <= warm.threads + 4, "threads grow")  # workers come and go


def check_mesh(mesh: Path, voxels: int) -> None:
    last = voxels - 1
    run_well(TESTS / "check_mesh", mesh, "--box", 0, 0, 0, last, last, last)
    mesh.unlink()
    COUNTS["meshes checked"] += 1


def files() -> None:
    environment = {**os.environ, "ISOBRICK_SOAK_SECONDS": str(SECONDS)}
    words = [TESTS / "isobrick_extract_tests", "--gtest_brief=1", "--gtest_filter=Soak.*"]
    with (FOLDER / "soak.log").open("w") as log:
        beside = subprocess.Popen(words, env=environment, stdout=log, stderr=log)
        while beside.poll() is None:
            one_round()
        said = (FOLDER / "soak.log").read_text()
    check(beside.returncode == 0, f"isobrick_extract_tests: {beside.returncode} {said}")
    print(said.strip())
    check(os.listdir(FOLDER) == ["soak.log"], f"is left: {os.listdir(FOLDER)}")


def one_round() -> None:
    """A volume of its own, from the build to the meshes."""
    name = CHANCE.choice(["head", "gyroid", "torus", "sphere"])
    voxels = CHANCE.randrange(30, 110)
    kind = CHANCE.choice(["u8", "u16", "f32"])
    run_well(ISOBRICK, "phantom", name, "--voxels", voxels, "--type", kind, "-o", "volume.nrrd")
    options = ["--brick", CHANCE.choice([8, 16, 32]), "--codec", CHANCE.choice(["none", "lz4", "zstd"]),
               "--memory", CHANCE.choice(["16M", "32M"])]
    build = [ISOBRICK, "build", "volume.nrrd", "-o", "volume.isb", *options]
    for _ in range(CHANCE.randrange(3)):
        ended = CHANCE.choice([signal.SIGKILL, signal.SIGINT, signal.SIGTERM])
        running = subprocess.Popen([*map(str, build), "--resume"], cwd=FOLDER, stdout=subprocess.DEVNULL,
                                   stderr=subprocess.DEVNULL)
        time.sleep(CHANCE.random() * 0.2)
        running.send_signal(ended)
        status = running.wait()
        COUNTS["builds ended early"] += status != 0
        check(status in (0, 130, -ended), f"{build}: {status}")
    run_well(*build, "--resume")
    run_well(ISOBRICK, "verify", "volume.isb")
    COUNTS["builds"] += 1
    low, high = json.loads(run_well(ISOBRICK, "info", "volume.isb", "--json"))["value_range"]
    isovalues = [low + (high - low) * share for share in (0.3, 0.6)]
    # Two processes on one file, which may be replaced by one of the same bytes meanwhile.
    queries = [subprocess.Popen([str(TESTS / "explore"), "volume.isb", *map(str, isovalues), "20", budget, access],
                                cwd=FOLDER, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
               for budget, access in (("300000", "map"), ("4000000", "read"))]
    if CHANCE.random() < 0.5:
        run_well(*build, "--rebuild")
    heard = [query.communicate() for query in queries]
    lines = [out.splitlines()[:20] for out, _ in heard]
    check(lines[0] == lines[1] and len(lines[0]) == 20, f"two processes differ: {heard}")
    COUNTS["queries of two processes"] += 40
    where = [str(CHANCE.randrange(voxels)) for _ in range(3)]
    choices = [[], ["--level", 1], ["--focus", ",".join(where), "--radius", CHANCE.randrange(2, 20)], ["--simplify", 0.3]]
    run_well(ISOBRICK, "extract", "volume.isb", "--iso", isovalues[0], "-o", "mesh.ply", "--memory", "16M",
             *CHANCE.choice(choices))
    check_mesh(FOLDER / "mesh.ply", voxels)
    left = set(os.listdir(FOLDER)) - {"soak.log", "volume.nrrd", "volume.isb"}
    check(not left, f"is left: {left}")
    for file in ("volume.nrrd", "volume.isb"):
        (FOLDER / file).unlink()


def is_closed(client: Any) -> bool:
    """The shown surface: it may be open at the border of the volume alone."""
    import numpy as np

    places, _, triangles = client.mesh()
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    there = {(a, b) for a, b in edges.tolist()}
    ends = np.array([edge for edge in there if edge[::-1] not in there], np.int64).reshape(-1, 2)
    last = (np.array(client.volume["dimensions"]) - 1) / client.volume["position_step"]
    first, second = places[ends[:, 0]], places[ends[:, 1]]
    at_border = ((first == second) & ((first == 0) | (first == last))).any(axis=1)
    return len(there) == len(edges) and bool(at_border.all())


def serve() -> None:
    from stream_client import Client, Server
    from websockets.exceptions import ConnectionClosed

    clients, temporary = 20, tempfile.mkdtemp(dir=FOLDER)
    for name, voxels in (("head", 96), ("gyroid", 48)):
        run_well(ISOBRICK, "build", f"phantom:{name}:{voxels}", "--brick", 16, "-o", f"{name}.isb")
    isovalues = {0: (500, 1200), 1: (-0.3, 0.3)}
    lock = threading.Lock()

    def one_client(server: Any, chance: random.Random) -> None:
        volume = chance.randrange(2)
        low, high = isovalues[volume]
        line = server.stream(volume)
        client = Client(line).begin()
        radius = {"focus": [24, 24, 24], "radius": chance.randrange(2, 20)}
        done = Counter(clients=1)
        for _ in range(chance.randrange(1, 5)):
            members: dict[str, Any] = radius if chance.random() < 0.7 else {}
            for _ in range(chance.randrange(1, 20)):  # a slider
                client.wish(iso=chance.uniform(low, high), **members)
                done["wishes"] += 1
                time.sleep(1 / 60)
            what = chance.random()
            if what < 0.25:  # it reads nothing
                time.sleep(chance.uniform(0.2, 3))
                done["stalls"] += 1
            elif what < 0.5:  # without a word
                line.socket.close()
                done["vanished"] += 1
                break
            else:
                client.until("fine", client.wish_number, 300)
                if chance.random() < 0.1 and 0 < client.triangles() < 30000:
                    check(is_closed(client), "a streamed surface is open inside the volume")
                    done["surfaces checked"] += 1
        else:
            line.close()
        with lock:
            COUNTS.update(done)

    def many(server: Any, seconds: float) -> None:
        end = time.monotonic() + seconds

        def come_and_go(number: int) -> None:
            chance = random.Random(f"{SEED} {number} {seconds}")
            while time.monotonic() < end:
                try:
                    one_client(server, chance)
                except (ConnectionClosed, OSError, TimeoutError, AssertionError) as failure:
                    with lock:
                        check(False, f"a client: {failure!r}")
                    return

        threads = [threading.Thread(target=come_and_go, args=(number,)) for number in range(clients)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        time.sleep(3)  # until the server has noticed who is gone

    words = [ISOBRICK, "serve", FOLDER / "head.isb", FOLDER / "gyroid.isb", "--threads", 2, "--memory", "64M"]
    with Server(*words, env={**os.environ, "TMPDIR": temporary}) as server:
        many(server, SECONDS / 4)
        warm = Held(server.process.pid)
        many(server, 3 * SECONDS / 4)
        check_level(warm, Held(server.process.pid))
        status, said = server.end()
        check(status == 0, f"serve: {status} {said}")
    check(not os.listdir(temporary), f"is left: {os.listdir(temporary)}")


def random_step(number: int) -> dict[str, Any]:
    def place() -> list[int]:
        return [CHANCE.randrange(340, 790), CHANCE.randrange(60, 580)]

    return CHANCE.choice([
        lambda: {"drag": {"from": place(), "to": place(), "button": CHANCE.choice(["left", "middle", "right"]),
                          "seconds": CHANCE.uniform(0.05, 0.4)}},
        lambda: {"wheel": CHANCE.randrange(-2, 3)},
        lambda: {"sweep": {"isovalue": [CHANCE.randrange(300, 1500), CHANCE.randrange(300, 1500)],
                           "seconds": CHANCE.uniform(0.1, 0.8)}},
        lambda: {"sweep": {"radius": [CHANCE.randrange(5, 60), CHANCE.randrange(5, 60)],
                           "seconds": CHANCE.uniform(0.1, 0.5)}},
        lambda: {"set": {"focus": {"center": [CHANCE.randrange(96) for _ in range(3)]}}},
        lambda: {"key": CHANCE.choice(["R", "F", "W", "C", "L", "B", "S", "X", "Y", "Z", "I", "U", "TAB", "ESCAPE"])},
        lambda: {"click": place()},
        lambda: {"double_click": place()},
        lambda: {"resize": [CHANCE.randrange(600, 1000), CHANCE.randrange(400, 700)]},
        lambda: {"open": CHANCE.choice(["head.isb", "gyroid.isb"])} if number % 7 == 0 else {"wait": 0.1},
        lambda: {"wait": CHANCE.choice([0.05, 0.3, "settled"])},
        lambda: {"lose_context": True} if number % 5 == 0 else {"wheel": 1},
    ])()


def window() -> None:
    for name in ("head", "gyroid"):
        run_well(ISOBRICK, "build", f"phantom:{name}:96", "--brick", 16, "-o", f"{name}.isb")
    read, write = os.pipe()
    display = subprocess.Popen(["Xvfb", "-displayfd", str(write), "-screen", "0", "1400x1000x24"],
                               pass_fds=[write], stderr=subprocess.DEVNULL)
    os.close(write)
    environment = {**os.environ, "DISPLAY": ":" + os.fdopen(read).readline().strip()}
    try:
        held: list[Held] = []
        begin = time.monotonic()
        # One long run of short scripts would measure beginnings; so the script is as long as the time.
        steps: list[dict[str, Any]] = []
        for number in range(int(SECONDS * 5)):
            steps.append(random_step(number))
            if number % 200 == 199:
                steps += [{"open": "head.isb"}, {"wait": "settled"}, {"mesh": f"mesh-{number}.ply"}]
        (FOLDER / "script.json").write_text(json.dumps({"size": [800, 600], "steps": steps}))
        words = ["view", "head.isb", "--script", "script.json", "--memory", "64M", "--gpu-memory", "64M", "--force"]
        with (FOLDER / "view.log").open("w") as log:
            viewer = subprocess.Popen([str(ISOBRICK), *words], cwd=FOLDER, env=environment, stdout=log, stderr=log)
            while viewer.poll() is None:
                time.sleep(0.5)
                try:
                    held.append(Held(viewer.pid))
                except OSError:
                    break
                if time.monotonic() > begin + 20 * SECONDS + 120:
                    viewer.kill()
                    check(False, "the window hangs")
            status = viewer.wait()
        check(status == 0, f"view: {status} {(FOLDER / 'view.log').read_text()}")
        COUNTS["events"] = len(steps)
        COUNTS["seconds"] = int(time.monotonic() - begin)
        held = held[2:-2]
        quarter = len(held) // 4
        check(quarter > 0, "the window was there for a moment alone")
        warm, end = held[quarter : 2 * quarter], held[-quarter:]

        def usual(some: list[Held], of: str) -> float:
            return statistics.median(getattr(one, of) for one in some)

        for of, growth in (("bytes", MOST_GROWTH), ("files", 2), ("threads", 2)):
            print(f"{of}: {usual(warm, of):.0f} in the second quarter, {usual(end, of):.0f} in the last one")
            check(usual(end, of) <= usual(warm, of) + growth, f"{of} grow")
        for mesh in FOLDER.glob("mesh-*.ply"):
            check_mesh(mesh, 96)
        left = [name for name in os.listdir(FOLDER) if "partial" in name]
        check(not left, f"is left: {left}")
    finally:
        display.terminate()
        display.wait()


if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parents[2] / "python" / "tests"))
    {"files": files, "serve": serve, "window": window}[PART]()
    print(f"{PART}, {SECONDS:.0f} s, seed {SEED}: " + ", ".join(f"{n:,} {what}" for what, n in sorted(COUNTS.items())))
    for what in WRONG[:20]:
        print(f"{PART}: {what}", file=sys.stderr)
    sys.exit(bool(WRONG))
