"""What a search costs is counted alike however it is shared out, and its answer does not depend on that."""

from __future__ import annotations

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from threading import get_ident

import numpy as np
import pytest
from diagnose_truth import K_L, OMEGA_N, ZETA, linear, multisine, recording
from diagnosis_example import LEVEL, command, simulate

from seod.cli import app
from seod.diagnose import pipeline
from seod.diagnose.fitting import simulate as simulated
from seod.diagnose.fitting.work import counted, spend, uncounted, used_s
from seod.diagnose.record.series import series
from seod.diagnose.record.windows import cut
from seod.diagnose.search.budget import EFFORTS, Budget
from seod.diagnose.tuning.fitting import WORK
from sim.parameters import parameters
from tests.command_line import CliRunner


def test_a_simulation_counts_its_steps_and_rows():
    before = used_s()
    spend(1000.0, 500)
    assert used_s() - before == pytest.approx(
        1e-9 * (WORK.simulation_ns + 1000 * WORK.step_ns + 500 * WORK.row_ns)
    )


def test_what_is_not_counted_is_not_counted_side_by_side_either():
    before, rows = used_s(), [100, 200]
    side_by_side = counted(map)
    assert uncounted(lambda: list(side_by_side(lambda n: spend(0.0, n) or n, rows))) == rows
    assert used_s() == before
    with pytest.raises(ZeroDivisionError):
        uncounted(lambda: (spend(0.0, 100), 1 / 0))
    assert used_s() == before


def test_steps_with_an_orifice_count_as_what_they_take():
    before = used_s()
    spend(1000.0, 0, orifice=True)
    assert used_s() - before == pytest.approx(1e-9 * (WORK.simulation_ns + 1000 * WORK.orifice_step_ns))


@pytest.mark.parametrize(
    ("effects", "orifice"), [({}, False), ({"square_root_flow": {"supply": 900.0}}, True)]
)
def test_a_simulation_says_whether_it_has_an_orifice(monkeypatch, effects, orifice):
    spent = []
    monkeypatch.setattr("seod.diagnose.fitting.work.spend", lambda *_, **how: spent.append(how))
    u = multisine(4000)
    seen = cut([series(recording(u, linear(u)))])[0]
    start = np.zeros((len(seen.windows), simulated.STATES))
    simulated.simulate(parameters(K_L, OMEGA_N, ZETA, effects), seen, start)
    assert spent
    assert all(how == {"orifice": orifice} for how in spent)


@pytest.mark.parametrize("workers", [1, 2, 7])
def test_each_task_sees_its_own_work_and_all_of_it_counts(workers):
    begun = used_s()
    with ThreadPoolExecutor(workers) as pool:
        parallel = counted(pool.map)

        def task(rows):
            spend(0.0, rows)
            inner = parallel(lambda more: (spend(0.0, more), used_s())[1], [rows, rows])
            return used_s(), inner

        seen = parallel(task, range(0, 9_000_000, 1_000_000))
    simulation_s = [
        1e-9 * (WORK.simulation_ns + rows * WORK.row_ns) for rows in range(0, 9_000_000, 1_000_000)
    ]
    assert [used - begun for used, _ in seen] == pytest.approx([3.0 * each for each in simulation_s])
    for (_, inner), each in zip(seen, simulation_s, strict=True):
        assert [one - begun for one in inner] == pytest.approx([2.0 * each, 2.0 * each])
    assert used_s() - begun == pytest.approx(3.0 * sum(simulation_s))


def test_trials_within_a_trial_take_no_core_from_others():
    with ThreadPoolExecutor(4) as pool:
        parallel = counted(pool.map)

        def threads(count):
            return set(parallel(lambda _: get_ident(), range(count)))

        assert get_ident() not in threads(9)
        assert [*threads(1), *parallel(threads, [1])[0]] == [get_ident()] * 2
        for own, within in parallel(lambda _: (get_ident(), threads(9)), range(9)):
            assert within == {own}
        (within,) = parallel(threads, [9])
        assert get_ident() not in within


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


BRIEFLY = 0.04
"""Of the work of a search, in place of that of `--effort quick`: the budget ends it as well, but sooner."""
THERE = (
    "from seod.cli import main; from seod.diagnose.search.budget import EFFORTS; "
    f"EFFORTS['quick'] = {BRIEFLY}; main()"
)


def command_of(path):
    return ["diagnose", str(path), "--json", "--effort", "quick"]


@pytest.fixture(scope="module")
def answer(record):
    """What the command prints on a number of cores, in this process."""

    @cache
    def on(cores):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(pipeline, "processors", lambda: cores)
            patch.setitem(EFFORTS, "quick", BRIEFLY)
            done = CliRunner().invoke(app, command_of(record))
        assert done.exit_code == 0, done.output
        return done.stdout

    return on


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_on_one_core_and_on_many_the_answer_is_the_same_to_the_byte(answer):
    assert answer(1) == answer(6)
    assert "--effort thorough" in answer(1)  # else the budget decided nothing


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_another_process_gives_the_same_bytes_whatever_its_hash_seed_and_threads(record, answer):
    done = subprocess.run(
        [sys.executable, "-c", THERE, *command_of(record)],
        env=os.environ | {"PYTHONHASHSEED": "77", "OPENBLAS_NUM_THREADS": "2"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout == answer(1)
