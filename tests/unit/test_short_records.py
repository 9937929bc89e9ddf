"""What is said where a recording is short, and where a delay comes out below zero."""

from types import SimpleNamespace

import numpy as np
import pytest

from seod.identify.words import early
from seod.respond.broadband import broadband
from seod.respond.record import RespondError, Segment


def segment(count):
    t = np.arange(count) * 0.01
    return Segment.of("run.csv", t, np.sign(np.sin(5.0 * t)), np.cos(3.0 * t), None)


def test_a_response_says_what_it_needs():
    with pytest.raises(
        RespondError, match=r"has 40 samples .*takes 60 and three periods .*, 512 of any other"
    ):
        segment(40)
    with pytest.raises(
        RespondError, match=r"400 samples are too few: .* takes 512, 5\.12 s at this rate; .*--period"
    ):
        broadband(segment(400))


@pytest.mark.parametrize(
    ("delay", "said"),
    [
        (0.0, []),
        (2e-3, []),
        (-1e-3, ["below zero by no more than it is uncertain"]),
        (-9e-3, ["delay is negative"]),
    ],
)
def test_a_delay_below_zero_is_explained(delay, said):
    found = early(SimpleNamespace(value={"delay": delay}, sd={"delay": 1e-3}))
    assert len(found) == len(said)
    assert all(word in sentence for word, sentence in zip(said, found, strict=True))
