"""The bins of the published histograms."""

from __future__ import annotations

import math

import pytest

from seod.loop.meter import histogram_bin
from seod.processes.ring import HISTOGRAM_BINS, bin_edges_us


@pytest.mark.parametrize(
    ("us", "index"),
    [
        (-3.0, 0),
        (0.0, 0),
        (1.0, 0),
        (1.01, 1),
        (2.0, 4),
        (2.01, 5),
        (1e6, HISTOGRAM_BINS - 1),
        (math.inf, 63),
    ],
)
def test_a_time_falls_into_the_bin_whose_upper_edge_is_the_next(us: float, index: int) -> None:
    assert histogram_bin(us * 1e-6) == index


def test_every_bin_but_the_last_takes_its_own_upper_edge() -> None:
    edges = bin_edges_us()
    assert [histogram_bin(0.999999 * edge * 1e-6) for edge in edges] == list(range(len(edges)))
