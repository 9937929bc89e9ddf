"""Windows of a recording, beside whole runs of the kernel and beside each other."""

from __future__ import annotations

import numpy as np
import pytest
from kernel_cases import NONE, apart, follow, record

from sim.state import new_state
from sim.windows import INSIDE, START, follow_windows

T = np.arange(0.0, 1.0, 0.0005)
LATE = 2e-4
U = np.repeat(np.random.default_rng(5).choice([-1.0, -0.4, 0.3, 0.8], 50), 40)
CASES = {
    "a spool's lag": ("valve_lag", "coulomb_friction"),
    "play of the valve": ("valve_hysteresis", "valve_deadband"),
    "a spool of limited speed": ("valve_rate_limit",),
    "a delay": ("transport_delay", "backlash"),
    "an orifice": ("square_root_flow",),
}


def windows(p, t_u, u, first, last, start):
    """Readings of windows, and what is inside."""
    valve = new_state(p)
    y, inside = np.zeros(len(T)), np.zeros((len(T), len(INSIDE)))
    first, last = np.array(first), np.array(last)
    channels = NONE, NONE, NONE
    follow_windows(p, valve, valve.copy(), t_u, u, T, *channels, first, last, start, 1e9, y, inside)
    return y, inside


@pytest.mark.parametrize("names", CASES.values(), ids=CASES)
def test_a_command_that_is_given_again_changes_nothing(names):
    p, at_rest = record(names), np.zeros((1, len(START)))
    at_rest[0, START.index("loose")] = 0.5 * p["backlash_gap"][0]
    again = np.flatnonzero(np.diff(U, prepend=np.nan) != 0.0)
    every, changes = (
        windows(p, T[rows] + LATE, U[rows], [0], [len(T)], at_rest)[0] for rows in (slice(None), again)
    )
    assert len(again) < len(T) / 20
    assert apart(changes, every) < 1e-9
    assert apart(every, follow(p, T + LATE, U, T)[0]) < 1e-6


@pytest.mark.parametrize("names", CASES.values(), ids=CASES)
def test_a_window_goes_on_where_another_ended(names):
    p, half = record(names), len(T) // 2
    y, within = windows(p, T + LATE, U, [0], [len(T)], np.zeros((1, len(START))))
    start = np.zeros((2, len(START)))
    start[1, :3] = within[half, :3]
    start[1, START.index("loose")] = within[half, INSIDE.index("loose")]
    parts = windows(p, T + LATE, U, [0, half], [half, len(T)], start)[0]
    assert apart(parts, y) < 1e-6
