"""Long calls end when they are asked to; threads, processes and damaged files do no harm."""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
import subprocess
import sys
import textwrap
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import isobrick
from conftest import ball


def run(program: str, *arguments: object) -> subprocess.Popen[str]:
    # Shells start what runs in the background with Ctrl-C ignored, and children inherit that.
    listening = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)\n"
    return subprocess.Popen(
        [sys.executable, "-c", listening + textwrap.dedent(program), *map(str, arguments)],
        stdout=subprocess.PIPE, text=True,
    )  # fmt: skip


BUILD = """
    import sys, isobrick
    def tell(phase, fraction):
        print("running", flush=True)
    try:
        isobrick.build("phantom:head:700", sys.argv[1], progress=tell)
    except KeyboardInterrupt:
        print("interrupted", flush=True)
"""
BUILD_OF_ARRAY = """
    import sys, isobrick, numpy
    def tell(phase, fraction):
        print("running", flush=True)
    try:
        isobrick.build(numpy.random.default_rng(1).integers(0, 999, (500, 500, 500), "u2"), sys.argv[1], progress=tell)
    except KeyboardInterrupt:
        print("interrupted", flush=True)
"""
EXTRACT = """
    import sys, isobrick
    pyramid = isobrick.open(sys.argv[2])
    def tell(phase, fraction):
        print("running", flush=True)
    try:
        while True:
            pyramid.extract_to(sys.argv[1] + ".obj", 500, simplify=0.3, force=True, progress=tell)
    except KeyboardInterrupt:
        print("interrupted", flush=True)
"""


@pytest.mark.parametrize("program", [BUILD, BUILD_OF_ARRAY, EXTRACT], ids=["build", "array", "extract"])
def test_ctrl_c_ends_a_call_and_leaves_nothing(program: str, tmp_path: Path, head: Path) -> None:
    """It has to come long before the call's end."""
    out = tmp_path / "out.isb"
    child = run(program, out, head)
    assert child.stdout is not None
    killer = threading.Timer(120, child.kill)  # so that a call that never ends fails the test
    killer.start()
    assert child.stdout.readline() == "running\n"
    time.sleep(0.05)
    began = time.monotonic()
    child.send_signal(signal.SIGINT)
    for line in child.stdout:
        if line == "interrupted\n":
            break
    else:
        pytest.fail("the call went on to its end")
    assert time.monotonic() - began < 2
    assert child.wait(timeout=60) == 0
    killer.cancel()
    assert [p.name for p in tmp_path.iterdir() if p.suffix != ".obj"] == []
    assert all(p.name == "out.isb.obj" for p in tmp_path.iterdir()), "no temporary file is left"


def test_progress_is_told_in_order_on_the_callers_thread(tmp_path: Path) -> None:
    told: list[tuple[str, float]] = []
    threads = set()

    def tell(phase: str, fraction: float) -> None:
        threads.add(threading.get_ident())
        told.append((phase, fraction))

    isobrick.build("phantom:head:200", tmp_path / "p.isb", progress=tell)
    assert threads == {threading.get_ident()}
    assert told[-1][1] == 1 and len(told) > 2
    fractions = [fraction for _, fraction in told]
    assert fractions == sorted(fractions) and 0 <= fractions[0]


def test_a_bar_of_tqdm_and_true(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    from tqdm import tqdm

    with tqdm(total=50, file=open(os.devnull, "w")) as bar:
        isobrick.build("phantom:head:64", tmp_path / "t.isb", progress=bar)
        assert bar.n == pytest.approx(50)
    isobrick.build("phantom:head:64", tmp_path / "t.isb", progress=True, force=True)
    assert "building t.isb" in capfd.readouterr().err


def test_an_exception_of_the_callback_ends_the_call(tmp_path: Path) -> None:
    def tell(phase: str, fraction: float) -> None:
        raise ZeroDivisionError("from the callback")

    with pytest.raises(ZeroDivisionError, match="from the callback"):
        isobrick.build("phantom:head:300", tmp_path / "e.isb", progress=tell)
    assert list(tmp_path.iterdir()) == []


def test_cancel_ends_a_call_from_another_thread(tmp_path: Path) -> None:
    cancel = isobrick.Cancel()

    def tell(phase: str, fraction: float) -> None:
        cancel.request()

    with pytest.raises(isobrick.Cancelled):
        isobrick.build("phantom:head:500", tmp_path / "c.isb", progress=tell, cancel=cancel)
    assert cancel.requested and list(tmp_path.iterdir()) == []


def test_other_threads_run_meanwhile(tmp_path: Path) -> None:
    counted = 0
    done = threading.Event()

    def count() -> None:
        nonlocal counted
        while not done.is_set():
            counted += 1
            time.sleep(0)

    thread = threading.Thread(target=count)
    thread.start()
    isobrick.build("phantom:head:200", tmp_path / "g.isb")
    done.set()
    thread.join()
    assert counted > 1000


def test_many_threads_on_one_pyramid_and_one_session(head: Path) -> None:
    with isobrick.open(head) as pyramid:
        session = pyramid.session()
        wanted = {v: pyramid.extract(v).points.tobytes() for v in (500, 900, 1324)}
        failures: list[str] = []

        def work(number: int) -> None:
            for i in range(12):
                isovalue = (500, 900, 1324)[(number + i) % 3]
                mesh = (session if i % 2 else pyramid).extract(isovalue, threads=1 + number % 2)
                if mesh.points.tobytes() != wanted[isovalue]:
                    failures.append(f"thread {number}, query {i}")

        threads = [threading.Thread(target=work, args=(n,)) for n in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert failures == []


def area_of(pyramid: isobrick.Pyramid) -> float:
    return pyramid.extract(1324).area()


@pytest.mark.parametrize("method", ["fork", "spawn"])
def test_a_pyramid_goes_to_other_processes(head: Path, method: str) -> None:
    with isobrick.open(head) as pyramid:
        wanted = area_of(pyramid)  # so that threads were started before the fork
        with multiprocessing.get_context(method).Pool(2) as pool:
            assert pool.map(area_of, [pyramid] * 4) == [wanted] * 4
        copy = pickle.loads(pickle.dumps(pyramid))
        assert copy.path == pyramid.path and area_of(copy) == wanted


def test_a_child_of_fork_uses_what_it_inherited(head: Path) -> None:
    with isobrick.open(head) as pyramid:
        session = pyramid.session()
        wanted = session.extract(1324)
        child = os.fork()
        if child == 0:
            same = np.array_equal(session.extract(1324).points, wanted.points)
            same = same and np.array_equal(pyramid.extract(1324).points, wanted.points)
            os._exit(0 if same else 1)
        assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
        assert np.array_equal(session.extract(1324).points, wanted.points)


def test_errors_say_where(tmp_path: Path) -> None:
    with pytest.raises(isobrick.Error) as missing:
        isobrick.open(tmp_path / "none.isb")
    assert missing.value.path == str(tmp_path / "none.isb")
    path = tmp_path / "d.isb"
    isobrick.build(ball(70, "uint16"), path, codec="none")
    data = bytearray(path.read_bytes())
    data[len(data) // 3] ^= 0xFF  # among the samples of level 0
    path.write_bytes(data)
    with isobrick.open(path) as pyramid:
        damage = pyramid.verify()
        with pytest.raises(isobrick.Error) as damaged:
            pyramid.extract(100)
    assert damage[0].level == 0 and damage[0].brick is not None
    assert damaged.value.path == str(path) and damaged.value.level == 0
    assert damaged.value.brick == damage[0].brick
    again = pickle.loads(pickle.dumps(damaged.value))
    assert (str(again), again.brick) == (str(damaged.value), damaged.value.brick)
    for name in ("phantom:head:many", "phantom:head:64:u8"):
        with pytest.raises(isobrick.Error, match="NAME:SIZE"):
            isobrick.build(name, tmp_path / "p.isb")


def test_damaged_bytes_are_errors_or_do_no_harm(tmp_path: Path) -> None:
    path = tmp_path / "d.isb"
    isobrick.build(ball(12, "uint16"), path)
    good = path.read_bytes()
    with isobrick.open(path) as pyramid:
        right = pyramid.extract(100).points
    errors = 0
    for at in range(0, len(good), max(len(good) // 100, 1)):
        for wrong in (good[at] ^ 1 << at % 8, good[at] ^ 0xFF, None):
            end = b"" if wrong is None else bytes([wrong]) + good[at + 1 :]
            path.write_bytes(good[:at] + end)
            try:
                with isobrick.open(path) as pyramid:
                    assert pyramid.verify()
                    points = pyramid.extract(100).points
            except isobrick.Error as error:
                errors += 1
                assert "\n" not in str(error)
            else:
                assert np.array_equal(points, right)
    assert errors > 100


LEAKS = """
    import gc, os, sys, isobrick
    def kib():
        status = open("/proc/self/status").read()
        return [int(status.split(name)[1].split()[0]) for name in ("VmSize:", "VmRSS:")]
    pyramid = isobrick.open(sys.argv[1])
    session = pyramid.session()
    def make(count):
        for i in range(count):
            mesh = (session if i % 2 else pyramid).extract(500 + i % 7, focus=(64, 40, 64), radius=5)
            arrays = [mesh.points, mesh.faces, mesh.normals, mesh.levels, mesh.report]
    make(100)
    before = kib()
    make(1000)
    gc.collect()
    after = kib()
    print(*before, *after, sys.getrefcount(pyramid))
"""


def test_a_thousand_meshes_leave_nothing(head: Path) -> None:
    child = run(LEAKS, head)
    out, _ = child.communicate(timeout=300)
    size_before, rss_before, size_after, rss_after, references = map(int, out.split())
    assert size_after - size_before < 64 << 10, "the address space is flat (a mesh reserves some 100 GiB)"
    assert rss_after - rss_before < 16 << 10
    assert references <= 3  # the name, the session, and the argument


def test_the_command_of_the_package(tmp_path: Path) -> None:
    entry = Path(sys.executable).with_name("isobrick")
    done = subprocess.run([entry, "--version"], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0 and isobrick.__version__ in done.stdout
    done = subprocess.run([entry, "extract", tmp_path / "none.isb", "--iso", "1"], capture_output=True, timeout=60)
    assert done.returncode == 1


def test_a_query_is_what_its_keywords_are(head: Path, tmp_path: Path) -> None:
    query = isobrick.Query(1324, focus_voxels=(64, 64, 30), radius_voxels=9)
    with isobrick.open(head) as pyramid:
        wanted = pyramid.extract(1324, focus_voxels=(64, 64, 30), radius_voxels=9)
        session = pyramid.session()
        for mesh in (pyramid.extract(query), session.extract(query), list(session.progressive(query))[-1]):
            assert np.array_equal(mesh.points, wanted.points)
            assert np.array_equal(mesh.faces, wanted.faces)
        pyramid.extract_to(tmp_path / "query.ply", query)
        pyramid.extract_to(tmp_path / "words.ply", 1324, focus_voxels=(64, 64, 30), radius_voxels=9)
        assert (tmp_path / "query.ply").read_bytes() == (tmp_path / "words.ply").read_bytes()
        changed = pyramid.extract(query, focus=None, radius=None, level=1)
        assert np.array_equal(changed.points, pyramid.extract(1324, level=1).points)
        with pytest.raises(isobrick.Error, match="belong together"):
            isobrick.Query(1324, focus=(1, 2, 3))
        with pytest.raises(isobrick.Error, match="drop_small goes with simplify"):
            pyramid.extract(query, drop_small=True)
        with pytest.raises(TypeError, match="radios"):
            pyramid.extract(1324, radios=3)  # type: ignore[call-arg]
        with pytest.raises(isobrick.Error, match="progressive"):
            next(session.progressive(query, values=pyramid))
