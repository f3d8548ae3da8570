"""How soon Ctrl-C ends a call: SIGINT at random moments of builds and extractions, from signal to exception.

    python python/benchmarks/interrupt.py [RUNS]
"""

from __future__ import annotations

import os
import random
import signal
import statistics
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np

import isobrick


def latency(call: Any, after: float) -> float | None:
    """Seconds from SIGINT to the exception; None: the call was done before."""
    sent = [0.0]

    def send() -> None:
        sent[0] = time.perf_counter()
        os.kill(os.getpid(), signal.SIGINT)

    timer = threading.Timer(after, send)
    timer.start()
    try:
        call()
        timer.join()
    except KeyboardInterrupt:
        return time.perf_counter() - sent[0]
    return None


def main() -> None:
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    draw = random.Random(1)
    array = np.random.default_rng(1).integers(0, 999, (400, 400, 400), "u2")
    with tempfile.TemporaryDirectory() as folder:
        isobrick.build("phantom:head:400", f"{folder}/head.isb")
        pyramid = isobrick.open(f"{folder}/head.isb")
        out = Path(folder) / "out.isb"
        calls = {
            "build of a phantom": lambda: isobrick.build("phantom:head:500", out, force=True),
            "build of an array": lambda: isobrick.build(array, out, force=True),
            "extract, simplified": lambda: pyramid.extract(500, simplify=0.3),
            "extract_to .obj": lambda: pyramid.extract_to(f"{folder}/out.obj", 500, force=True),
            "verify": lambda: pyramid.verify(),
        }
        print("| call | median ms | greatest ms | runs |\n|---|--:|--:|--:|")
        for name, call in calls.items():
            times = []
            for _ in range(runs):
                took = None
                try:
                    took = latency(call, draw.uniform(0.02, 0.25))
                except KeyboardInterrupt:
                    pass  # it came between two calls
                if took is not None:
                    times.append(1e3 * took)
            print(f"| {name} | {statistics.median(times):.0f} | {max(times):.0f} | {len(times)} |", flush=True)


if __name__ == "__main__":
    main()
