"""What a fresh process pays for the kernel: time until the first runs have ended, and memory."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from statistics import median

RUNS = "import kernel_runs; kernel_runs.everything_once()"
PROGRAMS = {
    "python alone": "",
    "import numpy": "import numpy",
    "import numba": "import numba",
    "import the kernel": "import kernel_runs",
    "import and first runs, from the cache": RUNS,
}
REPORT = """
import resource
with open('/proc/self/status') as status:
    now = next(int(line.split()[1]) for line in status if line.startswith('VmRSS'))
spent = resource.getrusage(resource.RUSAGE_SELF)
print(time.perf_counter() - start, spent.ru_utime + spent.ru_stime, now / 1024)
"""


@dataclass(frozen=True)
class Start:
    """Of a fresh process: time for the code [s], processor time of it all [s], resident memory then [MiB]."""

    wall: float
    processor: float
    memory: float


def start(code: str, cache: str) -> Start:
    """Run `code` in a fresh interpreter that keeps machine code in `cache`."""
    whole = f"import time; start = time.perf_counter()\n{code}\n{REPORT}"
    environment = {**os.environ, "NUMBA_CACHE_DIR": cache, "PYTHONPATH": str(Path(__file__).parent)}
    done = subprocess.run(
        [sys.executable, "-c", whole], capture_output=True, text=True, check=True, env=environment
    )
    return Start(*map(float, done.stdout.split()))


def starts(rounds: int, colds: int) -> dict[str, Start]:
    """Medians of each program, in turns, and of compiling everything into an empty cache."""
    found: dict[str, list[Start]] = {name: [] for name in PROGRAMS}
    cold = []
    for _ in range(colds):
        with tempfile.TemporaryDirectory() as cache:
            cold.append(start(RUNS, cache))
            for _ in range(rounds):
                for name, code in PROGRAMS.items():
                    found[name].append(start(code, cache))
    found["import and first runs, compiled anew"] = cold
    return {
        name: Start(
            median(s.wall for s in all_), median(s.processor for s in all_), median(s.memory for s in all_)
        )
        for name, all_ in found.items()
    }
