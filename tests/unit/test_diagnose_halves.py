"""What happens too rarely to show in windows that are fitted and in others that are held out."""

from dataclasses import replace

import numpy as np
import pytest
from diagnose_truth import RATE, linear, multisine, recording

from seod.diagnose.command import diagnose
from seod.diagnose.conclude import RARE
from seod.diagnose.windows import cut, series

T = np.arange(12000) / RATE
LIMIT = 0.6


def rare(*peaks):
    """Slow commands, above `LIMIT` for a moment at these times, to a valve that goes no further."""
    u = 0.2 * np.sin(2.0 * np.pi * 0.4 * T) + 0.1 * multisine(len(T))
    for at in peaks:
        u = u + 0.8 * np.exp(-(((T - at) / 0.03) ** 2))
    y = linear(np.clip(u, -LIMIT, LIMIT))
    return recording(u, y + np.random.default_rng(2).normal(0.0, 0.002 * np.std(y), len(y)))


def test_windows_are_made_shorter_until_both_halves_show_it():
    told = diagnose([rare(7.7, 8.5)])
    assert [each.name for each in told.effects] == ["valve_saturation"]
    assert told.verdict == "effects"
    assert told.effects[0].parameters["limit"].value == pytest.approx(LIMIT, rel=0.02)
    assert told.remarks == ()


def test_what_happens_once_is_not_told_to_be_nothing():
    slipped = rare()
    slipped = replace(slipped, y=slipped.y + 0.1 * np.ptp(slipped.y) * (T > 7.7))
    told = diagnose([slipped])
    assert told.verdict == "unexplained"
    assert not told.effects
    assert told.unexplained.fraction > 0.5
    assert RARE in told.remarks


@pytest.mark.parametrize(("finer", "count"), [(1.0, 4), (1.25, 5), (1.5, 6), (3.0, 12)])
def test_there_are_so_many_windows_more(finer, count):
    fitted, held = cut([series(rare(7.7))], finer=finer)
    assert len(fitted.windows) + len(held.windows) == count
