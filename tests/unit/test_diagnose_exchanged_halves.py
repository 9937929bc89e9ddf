"""Where windows held out show what no fit has seen, causes are searched in these."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from seod.diagnose import pipeline
from seod.diagnose.record.windows import Cut, exchanged
from seod.diagnose.result import DiagnoseError


def result(name, most, effects=()):
    return SimpleNamespace(name=name, findings=SimpleNamespace(effects=effects, most=most))


class Setup(SimpleNamespace):
    def _replace(self, **changes):
        return Setup(**vars(self) | changes)


def search_setup():
    budget = SimpleNamespace(anew=lambda: "anew", too_late=lambda: False)
    return Setup(exchanged=False, budget=budget, progress=lambda *_: None)


def searched(monkeypatch, first, second):
    """What is told of two searches, and how each was made; a second one may raise."""
    made = []

    def search(_every, how, _closed):
        made.append(how)
        if isinstance(second, Exception) and how.exchanged:
            raise second
        return second if how.exchanged else first

    monkeypatch.setattr(pipeline, "search_once", search)
    monkeypatch.setattr(pipeline, "most_left", lambda findings: findings.most)
    monkeypatch.setattr(pipeline, "_in_own_windows", lambda result: result.findings)
    answer, how = pipeline._in_either_half(None, search_setup(), None)
    return answer.name, how.exchanged, made


@pytest.mark.parametrize(
    ("second", "taken"),
    [
        pytest.param(result("others", 2.0, ("valve_rate_limit",)), True, id="a cause that leaves less"),
        pytest.param(result("others", 2.0), False, id="no cause"),
        pytest.param(result("others", 90.0, ("load_spring",)), False, id="a cause that leaves as much"),
        pytest.param(DiagnoseError("too short"), False, id="the other half says nothing"),
    ],
)
def test_the_other_half_is_searched_where_it_alone_shows_something(monkeypatch, second, taken):
    monkeypatch.setattr(pipeline, "unseen_by_fits", lambda _: True)
    name, how, made = searched(monkeypatch, result("own", 80.0), second)
    assert (name, how) == (("others", True) if taken else ("own", False))
    assert [one.exchanged for one in made] == [False, True]
    assert made[1].budget == "anew"


def test_where_both_halves_show_the_same_there_is_one_search(monkeypatch):
    monkeypatch.setattr(pipeline, "unseen_by_fits", lambda _: False)
    name, how, made = searched(monkeypatch, result("own", 80.0), result("others", 1.0, ("valve_rate_limit",)))
    assert (name, how, len(made)) == ("own", False, 1)


def recording(rows=1000):
    t = np.arange(rows) * 1e-3
    return SimpleNamespace(t=t, good=np.ones(rows, np.bool_))


def test_halves_change_places_but_for_windows_that_show_no_error():
    one = recording()
    one.good[400:600] = False
    to_fit = Cut([one], ((0, 0, 200), (0, 400, 600)))
    held_out = Cut([one], ((0, 200, 400),))
    fitted, held = exchanged(to_fit, held_out)
    assert fitted is held_out
    assert held.windows == ((0, 0, 200),)


def test_a_half_without_any_is_told():
    one = recording()
    one.good[:] = False
    with pytest.raises(DiagnoseError, match="too short"):
        exchanged(Cut([one], ((0, 0, 200),)), Cut([one], ((0, 200, 400),)))
