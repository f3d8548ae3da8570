"""Extractions beside napari's interface: the latest request wins."""

from __future__ import annotations

import threading
import time
from typing import Any

from qtpy.QtCore import QObject, Signal

import isobrick


class LatestWorker(QObject):  # type: ignore[misc]
    """One thread that extracts what was asked for last. A request that comes while another is under way cancels
    that one; of those that wait, all but the last are forgotten."""

    #: The mesh, what it was asked for with, and how long it took in seconds; on the interface's thread.
    done = Signal(object, object, float)
    #: An isobrick.Error.
    failed = Signal(object)

    def __init__(self) -> None:
        super().__init__()
        self._changed = threading.Condition()
        self._pyramid: isobrick.Pyramid | None = None  # of the session
        self._session: isobrick.Session | None = None
        self._wanted: tuple[isobrick.Pyramid, dict[str, Any]] | None = None
        self._refines = False  # what is wanted
        self._has_shown = False  # a mesh of what is extracted now
        self._cancel = isobrick.Cancel()
        self._ends = False
        self._thread = threading.Thread(target=self._run, name="isobrick-napari", daemon=True)
        self._thread.start()

    def request(self, pyramid: isobrick.Pyramid, *, refines: bool = False, **choice: Any) -> None:
        """As Session.extract takes it; ``refines``: as Session.progressive does, whose first mesh a request of this
        kind lets come, so that a camera that moves is followed."""
        with self._changed:
            self._wanted, self._refines = (pyramid, choice), refines
            if self._has_shown or not refines:
                self._cancel.request()
            self._changed.notify()

    def end(self) -> None:
        """Waits for the thread."""
        with self._changed:
            self._ends = True
            self._cancel.request()
            self._changed.notify()
        self._thread.join()

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._wanted is not None or self._ends)
                if self._ends or self._wanted is None:
                    return
                (pyramid, choice), refines = self._wanted, self._refines
                self._wanted, self._has_shown = None, False
                self._cancel = isobrick.Cancel()
            try:
                if self._session is None or pyramid is not self._pyramid:
                    self._pyramid, self._session = pyramid, pyramid.session()
                began = time.perf_counter()
                query = self._session.progressive if refines else self._session.extract
                answer = query(**choice, cancel=self._cancel)
                for mesh in [answer] if isinstance(answer, isobrick.Mesh) else answer:
                    mesh.points  # noqa: B018  made here, and not on the interface's thread
                    self.done.emit(mesh, choice, time.perf_counter() - began)
                    with self._changed:
                        self._has_shown = True
                        if self._wanted is not None:
                            break
            except isobrick.Cancelled:
                continue
            except isobrick.Error as error:
                self.failed.emit(error)
            except RuntimeError:
                return  # Qt's side of this object is gone: napari was closed
