"""Calls that a coroutine can wait for."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable
from typing import Any, TypeVar

from ._core import Cancel

Result = TypeVar("Result")


async def awaited(call: Callable[..., Result], *arguments: Any, **named: Any) -> Result:
    """The result of a call, made in a thread of its own. If the task that waits is cancelled, so is the call, which
    has then ended when this returns."""
    cancel = named.setdefault("cancel", None) or Cancel()
    named["cancel"] = cancel
    running = asyncio.ensure_future(asyncio.to_thread(call, *arguments, **named))
    try:
        return await asyncio.shield(running)
    except asyncio.CancelledError:
        cancel.request()
        with contextlib.suppress(Exception):
            await running
        raise
