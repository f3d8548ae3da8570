"""One run of a program: its time, its peak memory, and the bytes that it read."""
import json
import os
import subprocess
import tempfile
import time


class Failed(Exception):
    """A program that ended with another status than 0, and its last line."""


def drop_from_page_cache(path):
    with open(path, "rb") as file:
        os.fsync(file.fileno())
        os.posix_fadvise(file.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)


def bytes_by_calls(pid, kind="rchar"):
    """Bytes that a process has read (or written: wchar) by system calls; after its end too, until it was waited for."""
    with open(f"/proc/{pid}/io", encoding="ascii") as file:
        return next(int(line.split()[1]) for line in file if line.startswith(kind))


def bytes_of(output, by_calls):
    """isobrick counts its reads through the map, too; other programs and commands do not say."""
    try:
        said = json.loads(output)
    except ValueError:
        return by_calls
    return said.get("bytes_read", by_calls) if isinstance(said, dict) else by_calls


def run(command, environment=None):
    """A dict of seconds, peak_bytes and bytes_read. Throws Failed."""
    with tempfile.TemporaryFile() as output, tempfile.TemporaryFile() as errors:
        began = time.perf_counter()
        process = subprocess.Popen(list(map(str, command)), stdin=subprocess.DEVNULL, stdout=output, stderr=errors,
                                   env={**os.environ, **(environment or {})})
        os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOWAIT)
        seconds = time.perf_counter() - began
        by_calls = bytes_by_calls(process.pid)
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        output.seek(0)
        errors.seek(0)
        if process.returncode != 0:
            lines = errors.read().decode(errors="replace").strip().splitlines()
            raise Failed(lines[-1] if lines else f"{command[0]} ended with {process.returncode}")
        return {"seconds": seconds, "peak_bytes": 1024 * usage.ru_maxrss,
                "bytes_read": bytes_of(output.read().decode(errors="replace"), by_calls)}
