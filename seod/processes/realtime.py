"""Real-time set-up of a process, once, outside the loop. Each refusal of the machine is a plain sentence.

Standard library only: the supervisor imports it.
"""

from __future__ import annotations

import contextlib
import ctypes
import gc
import os
from pathlib import Path

PR_SET_TIMERSLACK = 29
MCL_CURRENT_AND_FUTURE = 3
DMA_LATENCY = Path("/dev/cpu_dma_latency")
OOM_SCORE = Path("/proc/self/oom_score_adj")
GATEWAY_OOM, OTHERS_OOM = 400, 800
"""Added to what the kernel reckons [thousandths of the memory there is]: all map the loop's ring, so size
does not order them. A gateway or an observing process that is ended stops the rig; of the others none does.
"""

_libc = ctypes.CDLL(None, use_errno=True)


def set_fifo(priority: int) -> str:
    """Run this process under SCHED_FIFO; processes it starts run ordinarily. Returns why not, or ""."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(priority))
    except OSError as error:
        return (
            f"SCHED_FIFO {priority} refused ({error.strerror}): run as root, or give CAP_SYS_NICE or "
            f"LimitRTPRIO={priority}"
        )
    return ""


def pin(cpu: int | None) -> str:
    """Run on one processor only; None leaves it to the scheduler. Returns why not, or ""."""
    if cpu is None:
        return ""
    try:
        os.sched_setaffinity(0, {cpu})
    except OSError as error:
        allowed = sorted(os.sched_getaffinity(0))
        return f"loop.cpu {cpu} refused ({error.strerror}): allowed here are {allowed}"
    return ""


def lock_memory() -> str:
    """Keep all memory of this process resident. Returns why not, or ""."""
    if _libc.mlockall(MCL_CURRENT_AND_FUTURE) == 0:
        return ""
    reason = os.strerror(ctypes.get_errno())
    return f"mlockall refused ({reason}): run as root, or give CAP_IPC_LOCK or LimitMEMLOCK=infinity"


def tighten_timers() -> str:
    """Wake within 1 ns of the time asked for instead of 50 us, where SCHED_FIFO is refused."""
    return "" if _libc.prctl(PR_SET_TIMERSLACK, 1, 0, 0, 0) == 0 else "PR_SET_TIMERSLACK refused"


def forbid_deep_sleep() -> str:
    """Keep the processors out of sleep states that are slow to leave, while this process lives.

    Returns why not, or "". A kernel without the device (most virtual machines) has no such states to offer.
    """
    if not DMA_LATENCY.exists():
        return ""
    try:
        fd = os.open(DMA_LATENCY, os.O_WRONLY | os.O_CLOEXEC)
        os.write(fd, b"\0\0\0\0")  # 0 us; holds until the descriptor is closed with the process
    except OSError as error:
        return f"{DMA_LATENCY} refused ({error.strerror}): deep sleep states may add lateness"
    return ""


def be_ended_sooner(score: int) -> None:
    """Where memory runs out the kernel ends this process, and what it starts, before the loop."""
    with contextlib.suppress(OSError):
        OOM_SCORE.write_text(f"{score}\n")


def freeze_collector() -> None:
    """Stop garbage collections: what exists lives for good, and the tick makes no cycles."""
    gc.collect()
    gc.freeze()
    gc.disable()


def enter_realtime(priority: int, cpu: int | None) -> list[str]:
    """All of the above for the loop process; returns what the machine refused."""
    refusals = [set_fifo(priority), pin(cpu), lock_memory(), tighten_timers(), forbid_deep_sleep()]
    freeze_collector()
    return [why for why in refusals if why]
