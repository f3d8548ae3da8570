"""The page of `isobrick serve` in a headless browser, as a user has it (viewer/web)."""

from __future__ import annotations

import base64
import contextlib
import http.server
import json
import re
import socket
import struct
import subprocess
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from page_browser import WAIT, chromium, settle
from playwright.sync_api import Browser, Locator, Page, expect
from stream_client import Server

import isobrick
from isobrick._command import EXECUTABLE

PHONE = {"viewport": {"width": 360, "height": 640}, "has_touch": True, "is_mobile": True}


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium() as running:
        yield running


@pytest.fixture(scope="module")
def small_head(tmp_path_factory: pytest.TempPathFactory, command: Callable[..., str]) -> Path:
    path = tmp_path_factory.mktemp("page") / "head.isb"
    command("build", "phantom:head:40", "-o", path)
    return path


@pytest.fixture(scope="module")
def server(small_head: Path) -> Iterator[Server]:
    with Server(EXECUTABLE, "serve", small_head, "--threads", 2) as running:
        yield running


@pytest.fixture
def open_page(browser: Browser, server: Server) -> Iterator[Callable[..., Page]]:
    """Opens pages, which may log no error and throw none."""
    contexts = []
    complaints: list[str] = []

    def open_one(fragment: str = "", of: Server = server, **options: Any) -> Page:
        settings: dict[str, Any] = {"viewport": {"width": 660, "height": 300}, "color_scheme": "dark"}
        context = browser.new_context(**(settings | options))
        contexts.append(context)
        page = context.new_page()
        page.set_default_timeout(WAIT)
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.on("console", lambda line: complaints.append(line.text) if line.type == "error" else None)
        page.goto(f"{of.address}/#token={of.key}{fragment}")
        settle(page)
        return page

    yield open_one
    for context in contexts:
        context.close()
    lost = re.compile("ERR_CONNECTION_REFUSED|WebSocket connection")
    assert [line for line in complaints if not lost.search(line)] == []


def view_of(page: Page) -> dict[str, Any]:
    """The view that the page saves, which a link has too."""
    with page.expect_download() as download:
        page.locator("#save-view").click()
    return dict(json.loads(Path(download.value.path()).read_text()))


def picture_of(page: Page) -> NDArray[np.uint8]:
    """The scene as the page saves it, without what is written over it."""
    from matplotlib.image import imread

    page.evaluate("() => document.querySelector('#overlay').getContext('2d').reset()")
    with page.expect_download() as download:
        page.locator("#save-png").click()
    pixels = imread(download.value.path(), format="png")
    return np.rint(255 * pixels[..., :3]).astype(np.uint8)


def drag(page: Page, on: Locator, begin: tuple[float, float], end: tuple[float, float]) -> None:
    """From a place to another; both are shares of the element."""
    box = on.bounding_box()
    assert box
    x, y, width, height = box["x"], box["y"], box["width"], box["height"]
    page.mouse.move(x + begin[0] * width, y + begin[1] * height)
    page.mouse.down()
    page.mouse.move(x + end[0] * width, y + end[1] * height, steps=6)
    page.mouse.up()


def test_a_drag_over_the_histogram_shows_the_surface_of_its_isovalue(open_page: Callable[..., Page]) -> None:
    page = open_page()
    before = page.locator("#status").inner_text()
    drag(page, page.locator("#histogram"), (0.5, 0.5), (0.3, 0.5))
    expect(page.locator("#status")).not_to_have_text(before, timeout=WAIT)
    settle(page)
    assert view_of(page)["surfaces"][0]["isovalue"] == float(page.locator("#isovalue").input_value())
    page.locator("#undo").click()
    expect(page.locator("#status")).to_have_text(before, timeout=WAIT)


def likeness_to_render(page: Page, folder: Path, *pyramids: Path) -> float:
    """SSIM of the page's picture and that of `isobrick render` of the view that the page saves."""
    from matplotlib.image import imread
    from skimage.metrics import structural_similarity

    settle(page)
    page.wait_for_timeout(500)  # of the image of a cap
    shown = picture_of(page)
    (folder / "view.json").write_text(json.dumps(view_of(page)))
    height, width = shown.shape[:2]
    words = ["render", *pyramids, "--state", folder / "view.json", "--size", f"{width}x{height}"]
    subprocess.run([str(EXECUTABLE), *map(str, words), "-o", str(folder / "render.png"), "--force"], check=True)
    drawn = np.rint(255 * imread(folder / "render.png")[..., :3]).astype(np.uint8)
    return float(structural_similarity(shown, drawn, channel_axis=2))


def test_the_picture_is_that_of_render(
    open_page: Callable[..., Page], small_head: Path, tmp_path: Path
) -> None:
    page = open_page()
    for change in ["turned", "cut", "two"]:
        if change == "turned":
            drag(page, page.locator("#scene"), (0.5, 0.5), (0.8, 0.3))
        elif change == "cut":
            with page.expect_response(lambda answer: "slice.png" in answer.url):
                page.locator("#clip-x").click()
        elif change == "two":
            page.locator("#surfaces [data-field=opacity]").first.fill("0.4")
            page.locator("#add-surface").click()
        assert likeness_to_render(page, tmp_path, small_head) >= 0.97, change


@pytest.fixture(scope="module")
def balls(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Three of one grid, each larger than the one before, beside the middle of the head."""
    folder = tmp_path_factory.mktemp("balls")
    z, y, x = np.mgrid[0:32, 0:32, 0:32].astype(np.float32)
    distance = np.sqrt((x - 15) ** 2 + (y - 16) ** 2 + (z - 15) ** 2)
    paths = [folder / f"ball-{radius}.isb" for radius in (7, 10, 13)]
    for path, radius in zip(paths, (7, 10, 13), strict=True):
        isobrick.build(radius - distance, path, spacing=(0.9, 0.7, 1.1), origin=(14, 8, 9))
    return paths


def test_several_volumes_are_one_scene(
    open_page: Callable[..., Page], small_head: Path, balls: list[Path], tmp_path: Path
) -> None:
    with Server(EXECUTABLE, "serve", small_head, balls[2], balls[0], "--threads", 2) as server:
        page = open_page("&volume=0", of=server)
        alone = page.locator("#status").inner_text()
        page.locator("#add-volume").focus()
        page.keyboard.press("Enter")
        expect(page.locator("#surfaces li")).to_have_count(2, timeout=WAIT)
        settle(page)
        both = page.locator("#status").inner_text()
        assert both != alone
        # The panel has the histogram of the active surface's volume, and keys of the keyboard alone reach the rest.
        assert page.locator("#isovalue-of").inner_text() == "ball-13.isb"
        assert page.locator("#other-volume option").all_inner_texts() == ["ball-7.isb"]
        page.locator("#isovalue").fill("1")
        page.keyboard.press("Enter")
        page.locator("#scene").focus()
        page.keyboard.press("f")
        assert likeness_to_render(page, tmp_path, small_head, balls[2]) >= 0.97
        page.locator("#radius").fill("0.5")
        page.locator("#clip-x").click()
        assert likeness_to_render(page, tmp_path, small_head, balls[2]) >= 0.97
        state = view_of(page)
        assert [surface["volume"] for surface in state["surfaces"]] == [0, 1]
        assert (state["volume"], state["beside"]) == ("head.isb", ["ball-13.isb"])
        # A file of this name finds the volumes that lie beside it.
        here = tmp_path / "here"
        here.mkdir()
        for path in (small_head, balls[2]):
            (here / path.name).symlink_to(path)
        (here / "scene.view.json").write_text(json.dumps(state))
        words = ["render", here / "head.isb", "--state", here / "scene.view.json", "-o", tmp_path / "found.png"]
        subprocess.run([str(EXECUTABLE), *map(str, words)], check=True)
        # The address holds it.
        page.wait_for_timeout(600)
        other = open_page("&" + page.url.split("#")[1], of=server)
        page.reload()
        for same in (other, page):
            expect(same.locator("#surfaces li")).to_have_count(2, timeout=WAIT)
            settle(same)
            assert view_of(same) == state
        assert np.abs(picture_of(other).astype(int) - picture_of(page)).mean() < 0.5
        # A surface moves to another volume, and one without surfaces leaves the scene.
        page.locator("#surfaces select").nth(1).select_option("0")
        expect(page.locator("#surfaces select").first).to_be_hidden(timeout=WAIT)
        settle(page)
        assert [surface["volume"] for surface in view_of(page)["surfaces"]] == [0, 0]
        assert view_of(page)["beside"] == []
        page.wait_for_timeout(600)
        page.locator("#undo").click()
        settle(page)
        assert view_of(page) == state


def test_steps_of_time(open_page: Callable[..., Page], balls: list[Path], tmp_path: Path) -> None:
    with Server(EXECUTABLE, "serve", *balls, "--steps", "--threads", 2) as server:
        page = open_page(of=server)
        seen = []
        page.locator("#isovalue").fill("-2")
        page.keyboard.press("Enter")
        for step, path in enumerate(balls):
            page.locator("#step").fill(str(step))
            expect(page.locator("#name")).to_have_text(path.name, timeout=WAIT)
            assert likeness_to_render(page, tmp_path, path) >= 0.97
            seen.append(page.locator("#status").inner_text())
        assert len(set(seen)) == 3
        state = view_of(page)
        assert state["step"] == 2 and state["surfaces"][0]["isovalue"] == -2
        page.wait_for_timeout(600)
        page.reload()
        settle(page)
        assert view_of(page) == state and page.locator("#status").inner_text() == seen[2]
        page.locator("#scene").focus()
        page.keyboard.press("k")  # the first one comes behind the last one
        expect(page.locator("#status")).to_have_text(seen[0], timeout=WAIT)
        page.keyboard.press("j")
        expect(page.locator("#play")).to_have_attribute("aria-pressed", "true")
        for path in (balls[1], balls[2], balls[0]):
            expect(page.locator("#name")).to_have_text(path.name, timeout=WAIT)
        page.keyboard.press("j")
        expect(page.locator("#play")).to_have_attribute("aria-pressed", "false")
        settle(page)


def test_a_step_of_another_grid_is_refused(open_page: Callable[..., Page], small_head: Path, balls: list[Path]) -> None:
    with Server(EXECUTABLE, "serve", balls[0], small_head, "--steps") as server:
        page = open_page(of=server)
        page.locator("#step").fill("1")
        expect(page.locator("#trouble")).to_contain_text("another grid", timeout=WAIT)
        assert view_of(page)["step"] == 0


def test_chunks_of_coarse_levels_reach_far(browser: Browser, tmp_path: Path) -> None:
    z, y, x = np.mgrid[0:40, 0:40, 0:1500].astype(np.float32)
    wave = z - 20 + 8 * np.sin(x / 300) + 0 * y
    isobrick.build(wave, tmp_path / "wave.isb")
    focus = {"center": [8, 20, 20], "radius": 1, "everywhere": False}
    view = json.dumps({"surfaces": [{"isovalue": 0}], "focus": focus}).encode()
    fragment = "&volume=0&view=" + base64.urlsafe_b64encode(view).decode().rstrip("=")
    with Server(EXECUTABLE, "serve", tmp_path / "wave.isb") as server, browser.new_context() as context:
        page = context.new_page()
        page.goto(f"{server.address}/#token={server.key}{fragment}")
        assert likeness_to_render(page, tmp_path, tmp_path / "wave.isb") >= 0.97
        assert re.search("levels .*[5-9]", page.locator("#status").inner_text())


def test_a_double_click_focuses_and_a_link_shows_the_same(open_page: Callable[..., Page]) -> None:
    page = open_page()
    pivot = view_of(page)["camera"]["pivot"]
    page.locator("#scene").dblclick(position={"x": 180, "y": 150})
    expect(page).not_to_have_url(page.url, timeout=WAIT)
    state = view_of(page)
    assert state["camera"]["pivot"] != pivot
    page.locator("#radius").fill("0.5")
    settle(page)
    page.wait_for_timeout(600)  # the address follows when the view rests
    state = view_of(page)
    assert "token" not in page.url
    other = open_page("&" + page.url.split("#")[1])
    assert view_of(other) == state
    likeness = np.abs(picture_of(other).astype(int) - picture_of(page)).mean()
    assert likeness < 0.5
    page.reload()
    settle(page)
    assert view_of(page) == state


def test_a_tab_without_the_key_asks_for_it(browser: Browser, server: Server) -> None:
    with browser.new_context() as context:
        page = context.new_page()
        page.goto(server.address + "/")
        page.locator("#key-text").fill(f"{server.address}/#token={server.key}")
        page.keyboard.press("Enter")
        settle(page)


def test_two_points_measure_what_lies_between_them(open_page: Callable[..., Page]) -> None:
    page = open_page()
    page.locator("#distance").click()
    page.locator("#scene").click(position={"x": 160, "y": 150})
    page.wait_for_timeout(500)
    page.locator("#scene").click(position={"x": 200, "y": 150})
    text = page.locator("#measurements output").inner_text(timeout=WAIT)
    a, b = view_of(page)["measurements"][0]["points"]
    assert float(text.split()[0]) == pytest.approx(np.linalg.norm(np.subtract(a, b)), rel=1e-3)


def test_the_keyboard_alone_reaches_everything(open_page: Callable[..., Page]) -> None:
    page = open_page()
    first = view_of(page)
    page.locator("#scene").focus()
    for key in ["ArrowLeft", "ArrowUp", "+", "x", "c", "o"]:
        page.keyboard.press(key)
    now = view_of(page)
    assert now["camera"]["azimuth"] != first["camera"]["azimuth"]
    assert now["camera"]["distance"] < first["camera"]["distance"]
    assert now["camera"]["orthographic"] and now["coloring"] == "level" and len(now["clip_planes"]) == 1
    page.locator("#histogram").focus()
    page.keyboard.press("ArrowRight")
    assert view_of(page)["surfaces"][0]["isovalue"] > first["surfaces"][0]["isovalue"]
    names = page.evaluate("""() => [...document.querySelectorAll('button, input, select, canvas[tabindex]')]
        .filter((e) => e.checkVisibility()).map((e) =>
          e.ariaLabel || e.getAttribute('aria-labelledby') || e.labels?.length || e.textContent.trim())""")
    assert all(names)


def test_a_phone_turns_with_one_finger_and_zooms_with_two(open_page: Callable[..., Page]) -> None:
    page = open_page(**PHONE)
    first = view_of(page)["camera"]
    touch = page.context.new_cdp_session(page)

    def move(*fingers: list[tuple[float, float]]) -> None:
        for step, kind in enumerate(["touchStart", *["touchMove"] * (len(fingers[0]) - 1)]):
            points = [{"x": finger[step][0], "y": finger[step][1], "id": i} for i, finger in enumerate(fingers)]
            touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
        touch.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})

    move([(150, 150), (180, 150), (220, 150)])
    turned = view_of(page)["camera"]
    assert turned["azimuth"] != first["azimuth"]
    move([(150, 150), (120, 150), (90, 150)], [(200, 150), (230, 150), (260, 150)])
    assert view_of(page)["camera"]["distance"] < turned["distance"]


def test_a_phone_has_room_and_a_double_tap_focuses(open_page: Callable[..., Page]) -> None:
    page = open_page(**PHONE)
    scene, panel = page.locator("#view").bounding_box(), page.locator("#panel").bounding_box()
    assert scene and panel
    assert scene["height"] >= 300 and scene["y"] + scene["height"] <= panel["y"]
    assert panel["x"] == 0 and panel["width"] == 360
    small = """() => [...document.querySelectorAll('button, select, input:not([type=radio], [type=checkbox])')]
        .filter((e) => e.checkVisibility() && e.getBoundingClientRect().height < 36).map((e) => e.outerHTML)"""
    assert page.evaluate(small) == []
    pivot = view_of(page)["camera"]["pivot"]
    for _ in range(2):
        page.touchscreen.tap(170, scene["height"] / 2)
    expect(page).not_to_have_url(page.url, timeout=WAIT)
    assert view_of(page)["camera"]["pivot"] != pivot
    before = view_of(page)["surfaces"][0]["isovalue"]
    page.locator("#histogram").scroll_into_view_if_needed()
    box = page.locator("#histogram").bounding_box()
    assert box
    page.touchscreen.tap(box["x"] + 0.3 * box["width"], box["y"] + 0.5 * box["height"])
    settle(page)
    assert view_of(page)["surfaces"][0]["isovalue"] != before
    page.locator("#hide").tap()  # all of the screen for the scene
    whole = page.locator("#view").bounding_box()
    assert whole and whole["height"] > 560


def test_two_tabs_are_two_views(open_page: Callable[..., Page], server: Server) -> None:
    first = open_page()
    second = first.context.new_page()
    second.goto(first.url)  # without the key, which each tab keeps for itself
    second.locator("#key-text").fill(server.key)
    second.keyboard.press("Enter")
    settle(second)
    second.locator("#isovalue").fill("500")
    second.keyboard.press("Enter")
    settle(second)
    settle(first)
    assert view_of(first)["surfaces"][0]["isovalue"] != 500
    assert first.locator("#status").inner_text() != second.locator("#status").inner_text()
    second.close()
    first.locator("#isovalue").fill("500")
    first.keyboard.press("Enter")
    settle(first)
    assert view_of(first)["surfaces"][0]["isovalue"] == 500


def test_saved_meshes_are_what_is_shown(open_page: Callable[..., Page]) -> None:
    page = open_page()
    shown = int(re.sub(r"\D", "", page.locator("#status").inner_text().split("triangles")[0]))
    for ending in ("glb", "stl"):
        with page.expect_download() as download:
            page.locator(f"#save-{ending}").click()
        data = Path(download.value.path()).read_bytes()
        assert download.value.suggested_filename.endswith(f".{ending}")
        if ending == "stl":
            assert struct.unpack_from("<I", data, 80)[0] == shown
        else:
            length = struct.unpack_from("<I", data, 12)[0]
            gltf = json.loads(data[20 : 20 + length])
            indices = gltf["meshes"][0]["primitives"][0]["indices"]
            assert data[:4] == b"glTF" and gltf["accessors"][indices]["count"] == 3 * shown


def test_light_pages_are_light_and_fill_the_screen(open_page: Callable[..., Page]) -> None:
    brightness = {scheme: picture_of(open_page(color_scheme=scheme))[0].mean() for scheme in ("dark", "light")}
    assert brightness["light"] > 2 * brightness["dark"]
    page = open_page()
    page.locator("#full").click()
    page.wait_for_function("() => document.fullscreenElement !== null")
    page.locator("#full").click()
    page.wait_for_function("() => document.fullscreenElement === null")


def test_a_folder_is_a_list_with_pictures(
    browser: Browser, small_head: Path, command: Callable[..., str], tmp_path: Path
) -> None:
    for name in ("a.isb", "b.isb"):
        command("build", "phantom:head:24", "-o", tmp_path / name)
    (tmp_path / "damaged.isb").write_bytes(b"no pyramid")
    with Server(EXECUTABLE, "serve", tmp_path) as server, browser.new_context() as context:
        page = context.new_page()
        page.goto(f"{server.address}/#token={server.key}")
        expect(page.locator("#cards .seen")).to_have_count(2, timeout=WAIT)
        expect(page.locator("#cards .blind")).to_have_count(1)
        sizes = page.evaluate("() => [...document.querySelectorAll('.seen img')].map((i) => i.naturalWidth)")
        assert min(sizes) >= 24
        page.get_by_text("b.isb").click()
        expect(page.locator("#name")).to_have_text("b.isb", timeout=WAIT)  # the page is loaded anew
        settle(page)
        page.locator("#volumes").click()
        page.get_by_text("a.isb").click()
        expect(page.locator("#name")).to_have_text("a.isb", timeout=WAIT)  # the page is loaded anew
        settle(page)


def test_a_page_of_an_origin_may_frame_it(browser: Browser, small_head: Path, tmp_path: Path) -> None:
    handler = type("Files", (http.server.SimpleHTTPRequestHandler,), {"log_message": lambda *_: None})
    other = http.server.ThreadingHTTPServer(("127.0.0.1", 0), lambda *words: handler(*words, directory=str(tmp_path)))
    threading.Thread(target=other.serve_forever, daemon=True).start()
    address = f"http://localhost:{other.server_port}"
    with Server(EXECUTABLE, "serve", small_head, "--origin", address) as server, browser.new_context() as context:
        frame = f'<iframe src="{server.address}/#token={server.key}" width=700 height=400></iframe>'
        (tmp_path / "frame.html").write_text(frame)
        page = context.new_page()
        page.goto(f"{address}/frame.html")
        settle(page.frame_locator("iframe"))
        page.goto(f"{address.replace('localhost', '127.0.0.1')}/frame.html")  # another origin
        expect(page.frame_locator("iframe").locator("#status")).to_have_count(0)
    other.shutdown()


class Relay:
    """A line to a port of this machine, which can be cut."""

    def __init__(self) -> None:
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.port = self.listener.getsockname()[1]
        self.lines: list[socket.socket] = []
        self.target = 0  # 0: nothing gets through
        threading.Thread(target=self._accept, daemon=True).start()

    def cut(self) -> None:
        self.target = 0
        for line in self.lines:
            with contextlib.suppress(OSError):
                line.shutdown(socket.SHUT_RDWR)
        self.lines.clear()

    def _accept(self) -> None:
        while True:
            here = self.listener.accept()[0]
            if self.target == 0:
                here.close()
                continue
            there = socket.create_connection(("127.0.0.1", self.target))
            self.lines += [here, there]
            for ends in [(here, there), (there, here)]:
                threading.Thread(target=self._carry, args=ends, daemon=True).start()

    @staticmethod
    def _carry(source: socket.socket, sink: socket.socket) -> None:
        with contextlib.suppress(OSError):
            while data := source.recv(1 << 16):
                sink.sendall(data)
            sink.shutdown(socket.SHUT_WR)


def test_a_lost_connection_is_said_and_comes_back(browser: Browser, small_head: Path) -> None:
    relay = Relay()
    address = f"http://127.0.0.1:{relay.port}"
    with Server(EXECUTABLE, "serve", small_head, "--origin", address) as server, browser.new_context() as context:
        relay.target = port = int(server.host.split(":")[1])
        page = context.new_page()
        page.goto(f"{address}/#token={server.key}")
        settle(page)
        relay.cut()
        expect(page.locator("#trouble")).to_contain_text("lost", timeout=WAIT)
        page.locator("#isovalue").fill("800")  # is asked for when the line is back
        page.keyboard.press("Enter")
        relay.target = port
        expect(page.locator("#trouble")).to_be_empty(timeout=WAIT)
        settle(page)


def longest_task(browser: Browser, page: Page, do: Callable[[], None]) -> float:
    """Milliseconds of the processor that the page's thread takes for one task while `do` runs, at most.

    Its own time, by the browser's trace: that of others on a busy machine, which also draw here, does not count.
    """
    browser.start_tracing(page=page, categories=["devtools.timeline", "disabled-by-default-devtools.timeline"])
    do()
    events = json.loads(browser.stop_tracing())["traceEvents"]
    named = [event for event in events if event["ph"] == "M" and event["name"] == "thread_name"]
    pages = {(e["pid"], e["tid"]) for e in named if e["args"]["name"] == "CrRendererMain"}
    tasks = [e for e in events if e["name"] == "RunTask" and (e["pid"], e["tid"]) in pages]
    return max(float(task.get("tdur", 0)) for task in tasks) / 1000


def test_no_task_takes_50_milliseconds_while_chunks_arrive(
    browser: Browser, command: Callable[..., str], tmp_path: Path
) -> None:
    command("build", "phantom:head:256", "-o", tmp_path / "head.isb")
    with Server(EXECUTABLE, "serve", tmp_path / "head.isb") as server, browser.new_context() as context:
        page = context.new_page()
        page.set_default_timeout(WAIT)
        page.set_viewport_size({"width": 400, "height": 64})

        def load() -> None:
            page.goto(f"{server.address}/#token={server.key}")
            settle(page)

        isovalues = iter(("700", "705", "710"))

        def another_surface() -> None:  # in the place of the one before, which goes
            page.locator("#isovalue").fill(next(isovalues))
            page.keyboard.press("Enter")
            settle(page)

        def wait_on_the_processor() -> None:
            page.evaluate("() => { for (const end = performance.now() + 500; performance.now() < end; ); }")

        for way in (load, another_surface):
            # One of three tries: other programs at work make the processor slower.
            assert any(longest_task(browser, page, way) < 50 for _ in range(3)), way
            triangles, levels, _ = page.locator("#status").inner_text().split(" · ")
            assert int(re.sub(r"\D", "", triangles)) > 400_000 and levels == "levels 0"
        assert longest_task(browser, page, wait_on_the_processor) > 50, "it would be seen"
