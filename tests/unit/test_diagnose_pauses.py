"""A recording that pauses is several; what the machine did meanwhile changes no answer."""

from dataclasses import replace

import numpy as np
import pytest
from diagnose_truth import OMEGA_N, linear, multisine, recording

from seod.api.identification import identify
from seod.data.pauses import between_pauses
from seod.diagnose.pipeline import diagnose
from seod.diagnose.record.fourth_differences import slopes
from seod.diagnose.result import DiagnoseError

PAUSES = (0.5, 300.0, 1e6, 1e15)


def with_pauses(one, *pauses):
    """Pauses [s] before rows: (row, how long)."""
    t = one.t.copy()
    for row, seconds in pauses:
        t[row:] += seconds
    return replace(one, t=t, ps=np.arange(len(t), dtype=float))


def moving(n=2000):
    u = multisine(n)
    return recording(u, linear(u))


@pytest.mark.parametrize("seconds", PAUSES[:3])
def test_its_parts_are_recordings_with_all_their_columns(seconds):
    one = with_pauses(moving(), (900, seconds))
    (first, second), said = between_pauses([one], 200)
    assert [len(first.t), len(second.t)] == [900, 1100]
    for name in ("t", "u", "y", "ps", "rows"):
        np.testing.assert_array_equal(
            np.concatenate([getattr(first, name), getattr(second, name)]), getattr(one, name)
        )
    assert (first.t_u, first.f) == (None, None)
    assert f"pauses once, {one.t[900] - one.t[899]:.3g} s" in said[0]
    assert "2 recordings" in said[0]


def test_where_rows_were_left_out_a_clock_was_set_back():
    """Times go on as if nothing were missing: a friction was not found, and K_L was wrong by a quarter."""
    one = moving()
    one = replace(one, rows=np.r_[np.arange(900), 1900 + np.arange(1100)])
    parts, said = between_pauses([one], 200)
    assert [len(part.t) for part in parts] == [900, 1100]
    assert "leaves out more than 100 rows once, as of a clock set back" in said[0]
    both = replace(with_pauses(one, (1500, 3.0)))
    parts, said = between_pauses([both], 200)
    assert [len(part.t) for part in parts] == [900, 600, 500]
    assert "pauses once, 3" in said[0]


def test_lost_samples_and_steady_rows_are_no_pause():
    steady, lost = moving(), with_pauses(moving(), (900, 0.09))
    assert between_pauses([steady, lost], 200) == ([steady, lost], ())


def test_parts_that_tell_nothing_are_left_out_and_counted():
    one = with_pauses(moving(), (50, 3.0), (1500, 3.0))
    one.u[1500:] = 1.0
    parts, said = between_pauses([one], 200)
    assert [len(part.t) for part in parts] == [1450]
    assert "1 recording, without 550 rows" in said[0]


def test_a_logger_that_writes_what_changes_alone_does_not_pause():
    one = with_pauses(moving(), *((row, 1.0) for row in range(100, 2000, 100)))
    assert between_pauses([one], 200) == ([one], ())


@pytest.mark.parametrize("row", [5, 900, 1996])
def test_slopes_beside_a_pause_are_of_its_own_side(row):
    one = with_pauses(moving(), (row, 1e6))
    y = 3.0 + 2.0 * one.t
    y[row:] = 7.0
    found = slopes(one.t, y)
    np.testing.assert_allclose(found[: row - 1], 2.0, rtol=1e-6)
    np.testing.assert_allclose(found[row + 1 :], 0.0, atol=1e-6)


def test_a_recording_that_is_all_pauses_is_refused_with_a_sentence():
    one = with_pauses(moving(), *((row, 1e8) for row in range(100, 2000, 100)))
    with pytest.raises(DiagnoseError, match=r"run.csv: is 1.9e\+09 s long and has 2000 rows, 0.001 s apart"):
        diagnose([one])


@pytest.mark.parametrize("seconds", PAUSES[:3])
def test_identified_as_without_a_pause(seconds):
    one = with_pauses(moving(4000), (1700, seconds))
    one.y[1700:] += 5.0 * np.std(one.y)
    found = identify(t=one.t, u=one.u, y=one.y)
    assert found.quality == "ok"
    assert found.omega_n.value == pytest.approx(OMEGA_N, rel=0.01)
    assert "pauses once" in found.summary()


@pytest.mark.computes
@pytest.mark.parametrize("seconds", PAUSES)
def test_a_pause_changes_no_name(seconds):
    """The valve overlaps by 0.3 V; over the pause the load was moved elsewhere by hand."""
    u = multisine(12000)
    y = linear(np.sign(u) * np.maximum(np.abs(u) - 0.3, 0.0))
    one = recording(u, y)
    one.y[7000:] += 5.0 * np.std(y)
    answer = diagnose([with_pauses(one, (7000, seconds))])
    assert [effect.name for effect in answer.effects] == ["valve_deadband"]
    assert answer.verdict == "effects"
    low, high = answer.effects[0].parameters["half_width"].ci95
    assert low < 0.3 < high
