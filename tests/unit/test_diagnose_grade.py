"""The grade, and what of the rest counts as unexplained."""

from dataclasses import replace

import pytest

from seod.diagnose.account.grade import graded
from seod.diagnose.result import Account, Unexplained
from seod.diagnose.verdict.unexplained import relevant, systematic_part


def account(systematic, remains=0.2, nrmse=0.1, detectable=0.01):
    parts = 1.0 - remains, systematic, remains - systematic
    return Account(*parts, nrmse, detectable_nrmse=detectable)


@pytest.mark.parametrize(
    ("before", "after", "adequacy", "parts", "grade"),
    [
        (1.6, 1.2, 9.0, account(0.1), "useless"),
        (0.4, 0.4, 9.0, account(0.1), "useless"),
        (0.4, 0.2, 9.0, account(0.1), "partly"),
        (0.4, 0.2, 9.0, account(0.0, nrmse=0.0), "down_to_noise"),
        (0.4, 0.2, 9.0, replace(account(0.0, nrmse=0.0), asked=False), "partly"),
        (0.4, 0.2, 9.0, account(0.0, nrmse=0.0, detectable=0.15), "partly"),
        (0.4, 0.2, 9.0, account(0.0, nrmse=0.0, detectable=float("inf")), "partly"),
        (0.4, 0.04, 9.0, account(0.0, nrmse=0.0, detectable=0.03), "partly"),
        (0.4, 0.02, 9.0, account(0.0, nrmse=0.0, detectable=0.03), "good_for_design"),
        (0.4, 0.4, 9.0, account(0.0, nrmse=0.0), "down_to_noise"),
        (0.2, 0.4, 9.0, account(0.0, nrmse=0.0), "useless"),
        (0.4, 0.2, 1.1, account(0.0, nrmse=0.0), "down_to_noise"),
        (0.4, 0.2, 1.1, account(0.0, nrmse=0.0, detectable=float("inf")), "down_to_noise"),
        (0.4, 0.04, 9.0, account(0.01, nrmse=0.015), "good_for_design"),
        (0.4, 0.04, 9.0, account(0.01, nrmse=0.025), "partly"),
        (0.04, 0.04, 9.0, account(0.01, nrmse=0.015), "good_for_design"),
        (0.4, 0.04, 9.0, None, "good_for_design"),
        (float("nan"), float("inf"), 9.0, None, "useless"),
    ],
)
def test_a_model_is_graded(before, after, adequacy, parts, grade):
    nothing = after <= 0.04 and parts is None
    parts = account(0.0, nrmse=0.01) if nothing else parts
    assert graded(before, after, adequacy, parts) == grade


def test_eq_1_where_it_is_right_is_not_useless():
    """Nothing is named, nothing is left but noise of which too few rows tell whether it is."""
    untold = account(0.0, nrmse=0.0, detectable=float("inf"))
    assert graded(0.08, 0.08, 9.0, untold, clean=True) == "partly"
    assert graded(0.08, 0.08, 9.0, untold) == "useless"
    assert graded(1.2, 1.2, 9.0, untold, clean=True) == "useless"


@pytest.mark.parametrize(("relevance", "fraction"), [(0.05, 0.0), (0.02, 0.03 / 0.9), (0.0, 0.03 / 0.9)])
def test_unexplained_is_what_is_systematic_and_relevant(relevance, fraction):
    left = Unexplained(0.8, ("velocity",), {"velocity": 0.4})
    told = Account(0.87, 0.03, 0.1, 0.03)
    found = systematic_part(left, told, 0.1, relevance, named=True)
    assert found.fraction == pytest.approx(fraction)
    assert bool(found.correlates_with) == (fraction > 0.0)
    for unasked in (None, replace(told, asked=False)):
        assert systematic_part(left, unasked, 0.1, relevance, named=True) == left
        assert systematic_part(left, unasked, 0.01, 0.02, named=True).fraction == 0.0
    assert systematic_part(Unexplained(0.0), told, 0.1, 0.0, named=True).fraction == 0.0
    assert relevant(left, 0.03, relevance) == (left if relevance < 0.03 else Unexplained(0.0))


def test_what_simulates_no_better_than_a_mean_leaves_no_noise():
    left, noise_alone = Unexplained(0.8), Account(0.2, 0.0, 0.8, 0.0)
    assert systematic_part(left, noise_alone, 0.99, 0.02, named=True).fraction == 0.0
    assert systematic_part(left, noise_alone, 1.0, 0.02, named=True) == left


@pytest.mark.parametrize(
    ("named", "rest", "detectable", "fraction"),
    [
        (False, 0.9, float("inf"), 0.8),
        (False, 0.06, 0.07, 0.8),
        (False, 0.06, 0.06, 0.0),
        (False, 0.04, float("inf"), 0.0),
        (True, 0.9, float("inf"), 0.0),
    ],
)
def test_eq_1_is_right_only_where_something_else_would_have_shown(named, rest, detectable, fraction):
    told = replace(Account(0.2, 0.0, 0.8, 0.0), detectable_nrmse=detectable)
    assert systematic_part(Unexplained(0.8), told, rest, 0.02, named=named).fraction == fraction
