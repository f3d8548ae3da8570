"""The dock widget: histogram, isovalue, focus on double click, simplification, the camera; the surface follows."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from qtpy.QtCore import QPointF, QRectF, Qt, QTimer, Signal
from qtpy.QtGui import QColor, QMouseEvent, QPainter, QPaintEvent
from qtpy.QtWidgets import (
    QCheckBox,
    QComboBox,
    QDoubleSpinBox,
    QFormLayout,
    QLabel,
    QPushButton,
    QVBoxLayout,
    QWidget,
)

import isobrick

from .worker import LatestWorker


class HistogramView(QWidget):  # type: ignore[misc]
    """How often which values occur, by the logarithm of the counts; a click or a drag picks a value."""

    picked = Signal(float)

    def __init__(self) -> None:
        super().__init__()
        self.setMinimumHeight(90)
        self._bars: Any = np.zeros(0)
        self._low, self._high = 0.0, 1.0
        self._value = 0.0
        self._marks: list[float] = []

    def show_pyramid(self, pyramid: isobrick.Pyramid) -> None:
        histogram = pyramid.histogram()
        self._low, self._high = pyramid.value_range
        middles = (histogram.least.astype(float) + histogram.greatest) / 2
        counts, _ = np.histogram(middles, bins=200, range=(self._low, self._high), weights=histogram.counts)
        self._bars = np.log1p(counts)
        self._marks = [s.value for s in pyramid.isovalues()]
        self.update()

    def show_value(self, value: float) -> None:
        self._value = value
        self.update()

    def _x_of(self, value: float) -> float:
        return float((value - self._low) / max(self._high - self._low, 1e-9) * self.width())

    def paintEvent(self, event: QPaintEvent) -> None:
        painter = QPainter(self)
        painter.fillRect(self.rect(), QColor(30, 32, 38))
        if len(self._bars):
            step = self.width() / len(self._bars)
            for i, bar in enumerate(self._bars / max(self._bars.max(), 1e-9)):
                height = bar * (self.height() - 4)
                painter.fillRect(QRectF(i * step, self.height() - height, step, height), QColor(130, 140, 160))
        painter.setPen(QColor(90, 200, 120))
        for mark in self._marks:
            painter.drawLine(QPointF(self._x_of(mark), 0), QPointF(self._x_of(mark), self.height()))
        painter.setPen(QColor(255, 170, 60))
        painter.drawLine(QPointF(self._x_of(self._value), 0), QPointF(self._x_of(self._value), self.height()))

    def _pick(self, event: QMouseEvent) -> None:
        share = event.position().x() / max(self.width(), 1)
        self.picked.emit(self._low + min(max(share, 0.0), 1.0) * (self._high - self._low))

    def mousePressEvent(self, event: QMouseEvent) -> None:
        self._pick(event)

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        if event.buttons() & Qt.MouseButton.LeftButton:
            self._pick(event)


def _decimals(step: float) -> int:
    """Enough for a thousandth of the step."""
    return min(max(2, 3 - math.floor(math.log10(step))), 15)


def _number(low: float, high: float, decimals: int = 2) -> QDoubleSpinBox:
    box = QDoubleSpinBox()
    box.setRange(low, high)
    box.setDecimals(decimals)
    box.setKeyboardTracking(False)
    return box


class SurfaceWidget(QWidget):  # type: ignore[misc]
    """Isosurfaces of the pyramids that are open in a viewer. A double click puts the focus there: on the
    surface in 3D, on the plane in 2D. If it follows the camera, the surface in 3D is as fine as the picture can show,
    and gets finer where one looks closer."""

    def __init__(self, napari_viewer: Any) -> None:
        super().__init__()
        self._viewer = napari_viewer
        self._focus: tuple[float, float, float] | None = None  # (x, y, z)
        self._layer: Any = None
        self._status = QLabel("open an .isb")
        self._status.setWordWrap(True)
        self._worker = LatestWorker()
        self._worker.done.connect(self._show)
        self._worker.failed.connect(lambda error: self._status.setText(str(error)))

        self._choice = QComboBox()
        self._histogram = HistogramView()
        self._isovalue = _number(-1e9, 1e9)
        self._radius = _number(0, 1e9)
        self._radius.setSpecialValueText("everywhere the same level")
        self._level = _number(0, 19, 0)
        self._simplify = _number(0, 1e6, 3)
        self._simplify.setSpecialValueText("off")
        self._follows = QCheckBox("as fine as the picture shows")
        self._moved = QTimer(self)  # a moving camera asks some times a second
        self._moved.setSingleShot(True)
        self._moved.setInterval(40)
        suggest = QPushButton("next suggestion")

        form = QFormLayout()
        form.addRow("pyramid", self._choice)
        form.addRow("isovalue", self._isovalue)
        form.addRow("", suggest)
        form.addRow("radius", self._radius)
        form.addRow("level", self._level)
        form.addRow("simplify within", self._simplify)
        form.addRow("in 3D", self._follows)
        layout = QVBoxLayout(self)
        layout.addWidget(self._histogram)
        layout.addLayout(form)
        layout.addWidget(self._status)
        layout.addStretch()

        self._histogram.picked.connect(self._isovalue.setValue)
        suggest.clicked.connect(self._suggest)
        self._choice.currentIndexChanged.connect(self._begin)
        for box in (self._isovalue, self._radius, self._level, self._simplify):
            box.valueChanged.connect(self._ask)
        self._follows.toggled.connect(self._ask)
        self._moved.timeout.connect(self._ask)
        camera = self._camera().events
        for event in (camera.center, camera.zoom, camera.angles, camera.perspective, napari_viewer.dims.events.ndisplay):
            event.connect(self._follow)
        for event in (napari_viewer.layers.events.inserted, napari_viewer.layers.events.removed):
            event.connect(self._list)
        napari_viewer.mouse_double_click_callbacks.append(self._double_click)
        self.destroyed.connect(self._worker.end)
        self._list()

    def pyramid(self) -> isobrick.Pyramid | None:
        """The one that is chosen."""
        layer = self._choice.currentData()
        return None if layer is None else layer.metadata["isobrick"]

    def set_isovalue(self, isovalue: float) -> None:
        self._isovalue.setValue(isovalue)

    def follow_camera(self, follows: bool) -> None:
        self._follows.setChecked(follows)

    def set_focus(self, focus: tuple[float, float, float] | None, radius: float = 0.0) -> None:
        """(x, y, z) in world units."""
        self._focus = focus
        if radius != self._radius.value():
            self._radius.setValue(radius)
        else:
            self._ask()

    def _list(self, event: Any = None) -> None:
        wanted = [layer for layer in self._viewer.layers if isinstance(layer.metadata.get("isobrick"), isobrick.Pyramid)]
        if [self._choice.itemData(i) for i in range(self._choice.count())] == wanted:
            return
        self._choice.blockSignals(True)
        self._choice.clear()
        for layer in wanted:
            self._choice.addItem(layer.name, layer)
        self._choice.blockSignals(False)
        self._begin()

    def _begin(self) -> None:
        pyramid = self.pyramid()
        if pyramid is None:
            return
        self._histogram.show_pyramid(pyramid)
        low, high = pyramid.value_range
        step = (high - low) / 200 or 1.0
        self._isovalue.setDecimals(_decimals(step))
        self._isovalue.setRange(low, high)
        self._isovalue.setSingleStep(step)
        spacing = float(np.linalg.norm(pyramid.affine[:3, :3], axis=0).min())
        for box in (self._radius, self._simplify):
            box.setDecimals(_decimals(spacing))
            box.setSingleStep(spacing)
        self._level.setRange(0, len(pyramid.levels) - 1)
        suggestions = pyramid.isovalues()
        self._isovalue.setValue(suggestions[0].value if suggestions else (low + high) / 2)
        self._ask()

    def _suggest(self) -> None:
        pyramid = self.pyramid()
        values = [s.value for s in pyramid.isovalues()] if pyramid is not None else []
        if values:
            at = min(range(len(values)), key=lambda i: abs(values[i] - self._isovalue.value()))
            self._isovalue.setValue(values[(at + 1) % len(values)])

    def _camera(self) -> Any:
        return getattr(self._viewer, "scene", self._viewer).camera  # napari 0.9 moved it

    def _follow(self, event: Any = None) -> None:
        if self._follows.isChecked() and not self._moved.isActive():
            self._moved.start()

    def _view(self) -> isobrick.View | None:
        """From where the viewer looks, if the surface follows that."""
        if not self._follows.isChecked() or self._viewer.dims.ndisplay != 3:
            return None
        camera = self._camera()
        center = np.asarray(camera.center, float)[::-1]
        direction = np.asarray(camera.view_direction, float)[::-1]
        size = self.window().size()  # of the window: the picture in it is no larger
        least, diagonal = min(size.width(), size.height()), math.hypot(size.width(), size.height())
        if not camera.perspective:
            eye = center - diagonal / camera.zoom * direction
            return isobrick.View(
                tuple(eye), tuple(center), pixels_per_unit=camera.zoom, field_radius=diagonal / camera.zoom / 2
            )
        half = math.radians(camera.perspective) / 2
        eye = center - least / camera.zoom / (2 * math.tan(half)) * direction
        field = 2 * math.degrees(math.atan(math.tan(half) * diagonal / least))
        return isobrick.View(tuple(eye), tuple(center), pixels_per_radian=least / (2 * half), field_of_view=field)

    def _ask(self) -> None:
        pyramid = self.pyramid()
        if pyramid is None:
            return
        self._histogram.show_value(self._isovalue.value())
        choice: dict[str, Any] = {"isovalue": self._isovalue.value()}
        if self._radius.value() > 0:
            middle = pyramid.affine @ [*(n / 2 for n in pyramid.shape[::-1]), 1]
            choice.update(focus=self._focus or tuple(middle[:3]), radius=self._radius.value())
        elif self._level.value() > 0 and not self._follows.isChecked():
            choice.update(level=int(self._level.value()))
        if self._simplify.value() > 0:
            choice.update(simplify=self._simplify.value())
        if view := self._view():
            choice.update(view=view)
        self._worker.request(pyramid, refines=view is not None, **choice)

    def _show(self, mesh: isobrick.Mesh, choice: dict[str, Any], seconds: float) -> None:
        # From (x, y, z) to (z, y, x): a reflection, which the faces make up for.
        if not len(mesh.faces):
            self._status.setText("no surface at this isovalue")
            if self._layer is not None:
                self._layer.visible = False
            return
        # Lit from where the viewer looks now, by the mesh's own normals: napari would compute others, which
        # takes longer than everything else here.
        light = np.abs(mesh.normals @ np.asarray(self._camera().view_direction[::-1], np.float32))
        data = (mesh.points[:, ::-1], mesh.faces[:, ::-1].astype(np.int32), light)
        if self._layer is None or self._layer not in self._viewer.layers:
            image = self._choice.currentData()
            self._layer = self._viewer.add_surface(
                data, name=f"surface of {image.name}", colormap="bone", contrast_limits=(-0.2, 1.1), shading="none",
                units=image.units, metadata={},
            )  # fmt: skip
        else:
            self._layer.data = data
            if not self._layer.visible:
                self._layer.visible = True
        self._status.setText(
            f"{len(mesh.faces):,} triangles in {1e3 * seconds:.0f} ms, isovalue {choice['isovalue']:g}"
            f"{'' if mesh.is_complete else ', refining'}"
        )

    def _double_click(self, viewer: Any, event: Any) -> None:
        pyramid = self.pyramid()
        if pyramid is None:
            return
        at = event.position[-3:]
        if viewer.dims.ndisplay == 3:
            if self._layer is None:
                return
            hit = self._layer.get_value(
                event.position, view_direction=event.view_direction, dims_displayed=event.dims_displayed, world=True
            )
            if hit is None or hit[1] is None:
                return
            at = self._layer.data[0][self._layer.data[1][int(hit[1])]].mean(axis=0)
        z, y, x = (float(v) for v in at)
        step = math.dist(pyramid.affine[:3, :3] @ [1, 1, 1], (0, 0, 0))
        self.set_focus((x, y, z), self._radius.value() or 30 * step / math.sqrt(3))
