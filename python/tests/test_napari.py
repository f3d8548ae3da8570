"""The plugin in a real napari, in a window of a virtual display."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np

import isobrick
from conftest import ball

PROGRAM = """
    import sys, time
    import napari
    import numpy as np
    from qtpy.QtWidgets import QApplication

    path, picture = sys.argv[1:]
    viewer = napari.Viewer()
    (image,) = viewer.open(path, plugin="isobrick")
    assert image.multiscale and image.metadata["isobrick"].path == path
    assert [str(unit) for unit in image.units] == ["pixel"] * 3
    _, widget = viewer.window.add_plugin_dock_widget("isobrick", "Isosurface")
    shown = []
    widget._worker.done.connect(lambda mesh, choice, seconds: shown.append((choice, len(mesh.faces))))

    def wait_for(condition):
        end = time.monotonic() + 60
        while not condition():
            assert time.monotonic() < end, "nothing came"
            QApplication.processEvents()
            time.sleep(0.002)

    wait_for(lambda: widget._layer is not None)
    pyramid = widget.pyramid()

    # The latest request wins, and most of those before it are never answered.
    before = len(shown)
    for isovalue in range(600, 1325, 4):
        widget.set_isovalue(isovalue)
    wait_for(lambda: shown and shown[-1][0]["isovalue"] == 1324)
    assert len(shown) - before < 90, len(shown)
    surface = viewer.layers[-1]
    mesh = pyramid.extract(1324)
    assert np.array_equal(surface.data[0], mesh.points[:, ::-1])

    # A double click in the plane is the focus.
    viewer.dims.set_point(0, 64)
    class Click:
        position, view_direction, dims_displayed = (64.0, 40.0, 60.0), None, [1, 2]
    widget._double_click(viewer, Click())
    wait_for(lambda: shown[-1][0].get("focus") == (60.0, 40.0, 64.0))
    assert shown[-1][1] == len(pyramid.extract(**shown[-1][0]).faces)

    # Another in space is where the surface is hit.
    viewer.dims.ndisplay = 3
    class Ray:
        position, view_direction, dims_displayed = (-50.0, 52.3, 61.7), np.array([1.0, 0, 0]), [0, 1, 2]
    widget._double_click(viewer, Ray())
    wait_for(lambda: shown[-1][0]["focus"] != (60.0, 40.0, 64.0))
    x, y, z = shown[-1][0]["focus"]
    assert abs(x - 61.7) < 3 and abs(y - 52.3) < 3, (x, y, z)

    # The surface is as fine as the picture shows, and follows the camera.
    camera = getattr(viewer, "scene", viewer).camera
    widget.set_focus(None)
    complete = []
    widget._worker.done.connect(lambda mesh, choice, seconds: mesh.is_complete and complete.append((choice, len(mesh.faces))))
    camera.zoom = 0.3
    widget.follow_camera(True)
    def seen(pixels):
        wait_for(lambda: complete and getattr(complete[-1][0].get("view"), "pixels_per_unit", 0) == pixels)
        choice, triangles = complete[-1]
        assert triangles == len(pyramid.extract(**choice).faces)
        return triangles
    far = seen(0.3)
    for zoom in np.geomspace(0.4, 4, 20):  # a wheel that turns
        camera.zoom = zoom
        QApplication.processEvents()
    near = seen(4)
    assert near > 2 * far, (near, far)
    eye = complete[-1][0]["view"].eye
    camera.angles = (10, 60, 100)
    wait_for(lambda: not np.allclose(complete[-1][0]["view"].eye, eye, rtol=0.01))
    camera.perspective = 40
    wait_for(lambda: complete[-1][0]["view"].pixels_per_unit is None)
    widget.follow_camera(False)
    wait_for(lambda: "view" not in shown[-1][0])
    camera.perspective = 0
    viewer.reset_view()
    for _ in range(20):
        QApplication.processEvents()
    pixels = viewer.screenshot(picture, canvas_only=True)
    assert len(np.unique(pixels.reshape(-1, 4), axis=0)) > 50, "there is a surface in the picture"
    viewer.close()
    print("napari: works")
"""


def test_the_widget_follows_in_a_window(head: Path, tmp_path: Path) -> None:
    assert shutil.which("xvfb-run"), "tools/packages has xvfb"
    program = tmp_path / "program.py"
    program.write_text(textwrap.dedent(PROGRAM))
    words = ["xvfb-run", "-a", "-s", "-screen 0 1280x900x24", sys.executable, program, head, tmp_path / "picture.png"]
    done = subprocess.run(
        words, capture_output=True, text=True, timeout=300, env={**os.environ, "QT_QPA_PLATFORM": "xcb"}
    )
    assert done.returncode == 0 and "napari: works" in done.stdout, done.stderr


def test_layers_lie_where_the_volume_is(tmp_path: Path) -> None:
    from isobrick.napari_plugin.reader import get_reader

    turn = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]])
    path = str(tmp_path / "t.isb")
    isobrick.build(ball(70), path, spacing=(0.5, 1, 2), origin=(7, 8, 9), direction=turn)
    assert get_reader("a.tif") is None
    reader = get_reader(path)
    assert reader is not None
    ((levels, options, kind),) = reader(path)
    assert kind == "image" and options["multiscale"] and [l.shape[0] for l in levels] == [70, 35]
    with isobrick.open(path) as pyramid:
        index = np.array([5.0, 3, 2])  # x, y, z
        world = (pyramid.affine @ [*index, 1])[:3]
        assert np.allclose((options["affine"] @ [*index[::-1], 1])[:3], world[::-1])


def test_levels_lie_over_each_other(tmp_path: Path) -> None:
    from isobrick.napari_plugin.reader import layer_of

    isobrick.build(ball(96, "uint16"), tmp_path / "ball.isb")
    with isobrick.open(tmp_path / "ball.isb") as pyramid:
        levels, options, kind = layer_of(pyramid)
        assert kind == "image" and options["multiscale"] and len(levels) > 1
        for level in levels:
            assert tuple(n * 2**level.level for n in level.shape) == (96, 96, 96)
            whole = np.asarray(pyramid.level(level.level))
            z, y, x = level.shape
            assert np.array_equal(np.asarray(level), whole[:z, :y, :x])
            assert np.array_equal(level[-1], whole[z - 1, :y, :x])


def test_a_pyramid_of_many_files_is_a_layer(tmp_path: Path) -> None:
    from isobrick.napari_plugin.reader import get_reader

    path = str(tmp_path / "ball.isbs")
    isobrick.build(ball(70), path, super_brick=64, brick_cells=16)
    for name in (path, path + "/"):
        reader = get_reader(name)
        assert reader is not None
        ((levels, options, kind),) = reader(name)
        assert kind == "image" and options["name"] == "ball" and len(levels) == 2
    manifest = (Path(isobrick.__file__).parent / "napari_plugin" / "napari.yaml").read_text()
    assert '"*.isbs"' in manifest and "accepts_directories: true" in manifest


def test_boxes_have_decimals_for_their_steps() -> None:
    from isobrick.napari_plugin.widget import _decimals

    assert _decimals(20.0) == 2  # CT: 4000 values
    assert _decimals(1e-5) == 8  # values within 0.002
    assert _decimals(0.005) == 6
    assert _decimals(1e-30) == 15
