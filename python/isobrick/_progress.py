"""Progress of long calls."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

#: ``None`` or ``False``: silent. ``True``: a bar of tqdm. A bar of tqdm that is at hand. Or a callable, which
#: gets the name of the phase and the share that is done, 0 to 1, on the caller's thread, some times a
#: second; an exception that it raises ends the call and comes out of it.
Progress = None | bool | Callable[[str, float], object] | Any


@contextmanager
def told_progress(progress: Progress, title: str) -> Iterator[Callable[[str, float], object] | None]:
    """The argument of a call of the library for a ``progress`` that a user gave."""
    if progress is None or progress is False:
        yield None
        return
    if callable(progress) and not hasattr(progress, "update"):
        yield progress
        return
    bar: Any = progress
    if progress is True:
        try:
            from tqdm.auto import tqdm
        except ImportError as missing:
            raise ImportError("progress=True takes the package tqdm; install it, or give a callable") from missing
        bar = tqdm(total=100, unit="%", desc=title)

    def show(phase: str, fraction: float) -> None:
        if phase and hasattr(bar, "set_postfix_str"):
            bar.set_postfix_str(phase, refresh=False)
        step = fraction * (bar.total or 1) - bar.n
        if step > 0:
            bar.update(step)

    try:
        yield show
    finally:
        if progress is True:
            bar.close()
