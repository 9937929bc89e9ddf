"""What a search costs is counted alike however it is shared out, and its answer does not depend on that."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from diagnosis_example import LEVEL, command, simulate

from seod.data import read
from seod.diagnose import pipeline
from seod.diagnose.fitting.work import counted, spend, used_s
from seod.diagnose.pipeline import Options, diagnose
from seod.diagnose.search.budget import Budget
from seod.diagnose.tuning.fitting import WORK


def test_a_simulation_counts_its_steps_and_rows():
    before = used_s()
    spend(1000.0, 500)
    assert used_s() - before == pytest.approx(
        1e-9 * (WORK.simulation_ns + 1000 * WORK.step_ns + 500 * WORK.row_ns)
    )


@pytest.mark.parametrize("workers", [1, 2, 7])
def test_each_task_sees_its_own_work_and_all_of_it_counts(workers):
    def task(rows):
        spend(0.0, rows)
        inner = list(counted(map)(lambda more: (spend(0.0, more), used_s())[1], [rows, rows]))
        return used_s(), inner

    begun = used_s()
    with ThreadPoolExecutor(workers) as pool:
        seen = list(counted(pool.map)(task, range(0, 9_000_000, 1_000_000)))
    simulation_s = [
        1e-9 * (WORK.simulation_ns + rows * WORK.row_ns) for rows in range(0, 9_000_000, 1_000_000)
    ]
    assert [used - begun for used, _ in seen] == pytest.approx([3.0 * each for each in simulation_s])
    for (_, inner), each in zip(seen, simulation_s, strict=True):
        assert [one - begun for one in inner] == pytest.approx([2.0 * each, 2.0 * each])
    assert used_s() - begun == pytest.approx(3.0 * sum(simulation_s))


def test_the_clock_of_the_wall_is_a_safety_stop_and_says_so():
    now = [0.0]
    budget = Budget(lambda: 0.0, 10.0, safety=(lambda: now[0], 60.0))
    trial = budget.trial()
    assert not trial()
    now[0] = 61.0
    assert trial()
    assert "stopped after 60 s by the clock" in budget.remarks[0]


@pytest.fixture(scope="module")
def record(tmp_path_factory):
    """A short recording with friction and a spring, which the search does not come to the end of."""
    path = tmp_path_factory.mktemp("work") / "run.csv"
    u = command(3000)
    effects = {"coulomb_friction": {"level": LEVEL}, "load_spring": {"stiffness": 900.0, "centre": 0.1}}
    t, y, _, _ = simulate(u, effects)
    np.savetxt(path, np.c_[t, u, y], delimiter=",", header="t,u,y [rad]", comments="", fmt="%.9g")
    return path


def answer(path):
    return json.dumps(diagnose([read(path)], (), Options(effort="quick")).as_json(), sort_keys=True)


@pytest.mark.slow
def test_on_one_core_and_on_many_the_answer_is_the_same_to_the_byte(record, monkeypatch):
    told = []
    for cores in (1, 6):
        monkeypatch.setattr(pipeline, "processors", lambda cores=cores: cores)
        told.append(answer(record))
    assert told[0] == told[1]
    assert "--effort thorough" in told[0]  # else the budget decided nothing


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_another_process_gives_the_same_bytes_whatever_its_hash_seed_and_threads(record):
    command = [sys.executable, "-m", "seod.cli", "diagnose", str(record), "--json", "--effort", "quick"]
    told = [
        subprocess.run(
            command,
            env=os.environ | {"PYTHONHASHSEED": seed, "OPENBLAS_NUM_THREADS": threads},
            capture_output=True,
            check=True,
        ).stdout
        for seed, threads in (("1", "1"), ("77", "2"))
    ]
    assert told[0] == told[1]
