"""Byte sizes as people write them."""

from __future__ import annotations

import re

from ._errors import ArgumentError

#: As of every command.
DEFAULT_MEMORY = "1G"

_UNITS = {"": 1, "K": 1 << 10, "M": 1 << 20, "G": 1 << 30, "T": 1 << 40}


def byte_size(size: int | str) -> int:
    """Bytes of ``268435456``, ``"256M"`` or ``"1.5G"``; the units are powers of 1024.

    >>> byte_size("1.5G"), byte_size("256MiB")
    (1610612736, 268435456)
    """
    if isinstance(size, int):
        bytes_ = size
    else:
        match = re.fullmatch(r"\s*([0-9]+(?:\.[0-9]+)?)\s*([KMGT]?)(?:i?B)?\s*", size, re.IGNORECASE)
        if match is None:
            raise ArgumentError(f"'{size}' is not a size; give bytes as an int, or a text such as '256M'")
        bytes_ = int(float(match[1]) * _UNITS[match[2].upper()])
    if bytes_ <= 0:
        raise ArgumentError(f"a size above 0 is wanted, not {size!r}")
    return bytes_
