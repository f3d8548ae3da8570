"""Surfaces in notebooks: `isobrick.show` in a process, a kernel, and a JupyterLab with a browser."""

from __future__ import annotations

import gc
import json
import os
import re
import signal
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient
from page_browser import WAIT, chromium, settle
from playwright.sync_api import TimeoutError

import isobrick
from isobrick import _command, _show

HTTP = urllib.request.build_opener(urllib.request.ProxyHandler({}))


def page_at(url: str) -> bytes:
    with HTTP.open(url.split("#")[0], timeout=30) as answer:
        return bytes(answer.read())


def is_gone(url: str) -> bool:
    """Within ten seconds."""
    for _ in range(100):
        try:
            page_at(url)
        except OSError:
            return True
        time.sleep(0.1)
    return False


def test_one_server_a_volume_that_ends_with_its_last_view(head: Path) -> None:
    with isobrick.open(head) as pyramid:
        first = isobrick.show(pyramid, browser=False)
        second = isobrick.show(head, isovalue=500, browser=False)
    assert b"<title>isobrick" in page_at(first.url)
    assert first.url.split("#")[0] == second.url.split("#")[0]
    assert first.url in repr(first)
    url = first.url
    _show._opened.clear()  # as in a notebook, where nobody else keeps them
    del first
    gc.collect()
    assert b"<title>isobrick" in page_at(url)
    del second
    gc.collect()
    assert is_gone(url)


def test_a_closed_one_starts_anew(head: Path) -> None:
    first = isobrick.show(head, browser=False)
    first.close()
    assert is_gone(first.url)
    second = isobrick.show(head, browser=False)
    assert b"<title>isobrick" in page_at(second.url)
    second.close()


# Prints the URL as soon as the main thread is in the server's wait(), which the page's calls.
SAY_WHEN_IT_WAITS = """
def say(main=threading.get_ident()):
    names = []
    while names != ["wait", "wait"]:
        time.sleep(0.01)
        frame = sys._current_frames()[main]
        names = [f.f_code.co_name for f in (frame, frame.f_back) if f]
    print(page.url, flush=True)
threading.Thread(target=say).start()
"""


@pytest.mark.parametrize("end", ["exit", "kill", "interrupt"])
def test_the_server_ends_with_the_process(head: Path, end: str) -> None:
    program = f"import isobrick, sys, threading, time\npage = isobrick.show({str(head)!r}, browser=False)\n"
    if end == "interrupt":
        # Who started the tests may have had it ignored.
        program += "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        program += SAY_WHEN_IT_WAITS + "page.wait()\n"
    else:
        program += "print(page.url, flush=True)\nsys.stdin.read()\n"
    with subprocess.Popen(
        [sys.executable, "-c", program], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdin and process.stdout
        url = process.stdout.readline().strip()
        assert b"<title>isobrick" in page_at(url)
        if end == "kill":
            process.kill()
        elif end == "interrupt":
            process.send_signal(signal.SIGINT)
        process.stdin.close()
        assert process.wait(60) == (-signal.SIGKILL if end == "kill" else 0)
    assert is_gone(url)


def test_what_is_wrong_is_said_in_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(isobrick.Error, match=r"none\.isb") as caught:
        isobrick.show(tmp_path / "none.isb", browser=False)
    assert "\n" not in str(caught.value)
    monkeypatch.setattr(_command, "EXECUTABLE", tmp_path / "isobrick")
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(isobrick.Error, match="install the wheel"):
        isobrick.show(tmp_path / "none.isb", browser=False)


def test_the_command_on_path_is_found_but_not_the_script(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for folder in ("script", "program"):
        (tmp_path / folder).mkdir()
    (tmp_path / "script" / "isobrick").write_text("#!/usr/bin/env python3\n")
    (tmp_path / "script" / "isobrick").chmod(0o755)
    (tmp_path / "program" / "isobrick").symlink_to(_command.EXECUTABLE)
    monkeypatch.setattr(_command, "EXECUTABLE", tmp_path / "none")
    monkeypatch.setenv("PATH", f"{tmp_path / 'script'}:{tmp_path / 'program'}")
    assert _command.executable() == tmp_path / "program" / "isobrick"


def test_the_path_of_the_proxy(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("JUPYTER_RUNTIME_DIR", str(tmp_path))
    monkeypatch.delenv("JUPYTERHUB_SERVICE_PREFIX", raising=False)
    assert _show._Notebook().place_of(80) is None  # a kernel without a server of Jupyter
    facts = {"base_url": "/base/", "port": 8888, "hostname": "0.0.0.0", "secure": False}
    (tmp_path / "jpserver-77.json").write_text(json.dumps(facts))
    monkeypatch.setenv("JPY_PARENT_PID", "77")
    local = _show._Notebook()
    assert local.place_of(80) == "/base/proxy/80/"
    assert {"http://localhost:8888", "http://127.0.0.1:8888"} <= set(local.origins)
    assert _show._Notebook(proxy=False).place_of(80) is None
    assert _show._Notebook(proxy="/x/{port}/y/").place_of(80) == "/x/80/y/"
    monkeypatch.setenv("JUPYTERHUB_SERVICE_PREFIX", "/user/me/")
    monkeypatch.setenv("JUPYTERHUB_PUBLIC_URL", "https://hub.example.org/user/me/")
    hub = _show._Notebook()
    assert (hub.place_of(80), hub.origins) == ("/user/me/proxy/80/", ["https://hub.example.org"])
    assert _show._Notebook(origin="https://other.example.org").origins == ["https://other.example.org"]


def notebook_of(head: Path, words: str = "") -> nbformat.NotebookNode:
    kernel = {"name": "python3", "display_name": "Python 3", "language": "python"}
    cell = nbformat.v4.new_code_cell(f"import isobrick\nisobrick.show({str(head)!r}{words})")
    return nbformat.v4.new_notebook(cells=[cell], metadata={"kernelspec": kernel})


def test_a_kernel_shows_a_frame_and_ends_its_server(head: Path) -> None:
    notebook = notebook_of(head, ", isovalue=500")
    client = NotebookClient(notebook, timeout=240)
    with client.setup_kernel():
        client.execute_cell(notebook.cells[0], 0)
        html = notebook.cells[0].outputs[0]["data"]["text/html"]
        frame = re.search(r'<iframe src="([^"]+)"', html)
        assert frame and "&amp;view=" in frame[1]
        assert b"<title>isobrick" in page_at(frame[1])
    assert is_gone(frame[1])


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Path, str]]:
    """The folder of a JupyterLab, and its address."""
    folder = tmp_path_factory.mktemp("lab")
    own = {f"JUPYTER_{name}_DIR": str(folder / name) for name in ("RUNTIME", "CONFIG", "DATA")}
    words = ["--no-browser", "--allow-root", "--port=0", "--IdentityProvider.token=word"]
    words.append(f"--ServerApp.root_dir={folder}")
    with (folder / "log").open("w") as log:
        process = subprocess.Popen(
            [sys.executable, "-m", "jupyterlab", *words], env={**os.environ, **own}, stdout=log, stderr=log
        )
        for _ in range(600):
            if running := list((folder / "RUNTIME").glob("jpserver-*.json")):
                break
            time.sleep(0.2)
        else:
            raise AssertionError((folder / "log").read_text())
        yield folder, json.loads(running[0].read_text())["url"]
        process.terminate()
        process.wait(60)


@pytest.mark.parametrize("way", ["direct", "proxy"])
def test_a_surface_in_jupyterlab(lab: tuple[Path, str], head: Path, way: str) -> None:
    folder, address = lab
    nbformat.write(notebook_of(head, f", proxy={way == 'proxy'}"), folder / f"{way}.ipynb")
    with chromium() as browser:
        page = browser.new_page(viewport={"width": 1200, "height": 900})
        page.set_default_timeout(WAIT)
        page.goto(f"{address}lab/workspaces/{way}/tree/{way}.ipynb?token=word")
        page.locator(".jp-Notebook-ExecutionIndicator[data-status=idle]").first.wait_for()  # before, keys are lost
        cell = page.locator(".jp-Notebook .jp-Cell .cm-content").first
        shown = page.locator("iframe[title=isobrick]")
        for _ in range(4):  # a busy machine's JupyterLab loses keys all the same
            cell.click()
            page.keyboard.press("Control+Enter")
            with suppress(TimeoutError):
                shown.wait_for(state="attached", timeout=WAIT / 4)
                break
        frame = page.frame_locator("iframe[title=isobrick]")
        settle(frame)
        assert ("/proxy/" in (shown.get_attribute("src") or "")) == (way == "proxy")
        assert page.locator("iframe[title=isobrick] ~ span").inner_text() == ""
        (folder / f"{way}.png").write_bytes(page.screenshot())
