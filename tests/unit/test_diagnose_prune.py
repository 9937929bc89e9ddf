"""Which effects leave a set again."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from seod.diagnose.search import prune
from seod.diagnose.tuning.search import PRUNE


def judged(cost, nrmse=0.5, held=None):
    held = SimpleNamespace(nrmse=nrmse, log_error=cost if held is None else held)
    return SimpleNamespace(found=SimpleNamespace(cost=cost), held=held)


@pytest.mark.parametrize(
    ("saves", "leaves"),
    [
        pytest.param(0.9 * PRUNE.surely, True, id="its interval reaches none"),
        pytest.param(1.1 * PRUNE.surely, False, id="it saves too much to be none"),
    ],
)
def test_a_linear_interval_does_not_outweigh_what_an_effect_saves(monkeypatch, saves, leaves):
    monkeypatch.setattr(prune, "covariance", lambda _: None)
    monkeypatch.setattr(prune, "_may_be_none", lambda *_: True)
    own, rest = judged(-3.0, 0.1), judged(-3.0 + saves)
    assert (prune._unidentified(own, {"a": rest}, 1.0) == [rest]) is leaves


@pytest.mark.parametrize(("held", "leaves"), [(0.8, True), (3.0, False)])
def test_what_no_fit_has_seen_speaks_for_an_effect_too(monkeypatch, held, leaves):
    """Of what noise that remembers does not foretell, a fit saves little."""
    monkeypatch.setattr(prune, "covariance", lambda _: None)
    monkeypatch.setattr(prune, "_may_be_none", lambda *_: True)
    own = judged(-3.0, 0.1)
    rest = judged(-3.0 + 0.8 * PRUNE.surely, held=-3.0 + held * PRUNE.surely)
    assert (prune._unidentified(own, {"a": rest}, 1.0) == [rest]) is leaves
