"""Each refusal of the machine is a sentence that says what would help; nothing is raised."""

from __future__ import annotations

import os
import subprocess
import sys
from typing import TYPE_CHECKING

from seod.processes import realtime

if TYPE_CHECKING:
    from pathlib import Path

    import pytest


def refuse(*_: object) -> None:
    raise PermissionError(1, "Operation not permitted")


def test_refused_scheduling_says_what_to_grant(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    why = realtime.set_fifo(50)
    assert "SCHED_FIFO 50 refused (Operation not permitted)" in why
    assert "CAP_SYS_NICE" in why


def test_a_processor_that_is_not_there_is_named_with_those_that_are() -> None:
    before = os.sched_getaffinity(0)
    assert realtime.pin(None) == ""
    why = realtime.pin(4096)
    assert "loop.cpu 4096 refused" in why
    assert str(sorted(before)) in why
    assert os.sched_getaffinity(0) == before


def test_sleep_states_are_forbidden_where_there_are_any(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(realtime, "DMA_LATENCY", tmp_path / "none")
    assert realtime.forbid_deep_sleep() == ""
    folder = tmp_path / "cpu_dma_latency"
    folder.mkdir()
    monkeypatch.setattr(realtime, "DMA_LATENCY", folder)
    assert "refused (Is a directory)" in realtime.forbid_deep_sleep()


def test_where_memory_runs_out_a_process_and_its_children_go_before_the_loop() -> None:
    code = (
        "import subprocess; from seod.processes.realtime import OTHERS_OOM, be_ended_sooner;"
        "be_ended_sooner(OTHERS_OOM); subprocess.run(['cat', '/proc/self/oom_score_adj'])"
    )
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert int(done.stdout) == realtime.OTHERS_OOM > realtime.GATEWAY_OOM > 0


def test_a_system_without_such_scores_goes_on(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(realtime, "OOM_SCORE", tmp_path / "none" / "score")
    realtime.be_ended_sooner(800)
