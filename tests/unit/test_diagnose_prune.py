"""Which effects leave a set again."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from seod.diagnose.search import prune
from seod.diagnose.tuning.search import PRUNE


def judged(cost, nrmse=0.5, adequacy=1.0):
    held = SimpleNamespace(nrmse=nrmse, log_error=cost, adequacy=adequacy)
    model = SimpleNamespace(scales=None)
    return SimpleNamespace(found=SimpleNamespace(cost=cost, model=model), held=held)


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
    assert (prune._unidentified(own, {"backlash": rest}, 1.0) == [rest]) is leaves


@pytest.mark.parametrize(
    ("name", "adequacy", "chance", "leaves"),
    [
        pytest.param("backlash", 9.0, 2.0 * PRUNE.by_chance, True, id="by chance"),
        pytest.param("backlash", 9.0, 0.5 * PRUNE.by_chance, False, id="hardly by chance"),
        pytest.param(
            "backlash", 1.0, 2.0 * PRUNE.by_chance, False, id="in one window only, all else is noise"
        ),
    ],
)
def test_where_more_than_noise_is_left_a_cause_may_not_gain_by_chance(
    monkeypatch, name, adequacy, chance, leaves
):
    monkeypatch.setattr(prune, "covariance", lambda _: None)
    monkeypatch.setattr(prune, "_may_be_none", lambda *_: False)
    monkeypatch.setattr(prune, "further_causes", lambda *_: range(7))
    monkeypatch.setattr(prune, "p_value", lambda _fewer, _more, tried: chance * tried / 7.0)
    own, rest = judged(-3.0, 0.1, adequacy), judged(-2.9)
    assert (prune._unidentified(own, {name: rest}, 1.0) == [rest]) is leaves
