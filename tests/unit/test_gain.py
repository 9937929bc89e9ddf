"""K_L as a number, a table and Eq. 9; what a rig file may say about it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError

from seod.config.gain import Gain
from seod.config.gain_in_force import gain_of, gain_range, is_identified, needs_pressure

EQ_9 = {"polynomial": [4.25, 2.72e-6, -0.134e-12], "range": ["5 MPa", "10 MPa"]}
TABLE = {"table": {"ps": ["5 MPa", "7 MPa", 10e6], "K_L": [14.5, 16.7, 18.0]}}


def gain(raw):
    return gain_of(parsed(raw))


def parsed(raw):
    return TypeAdapter(Gain).validate_python(raw, strict=False)


def test_a_number_is_the_same_at_any_pressure():
    assert gain(17)(math.nan) == 17.0
    assert gain(17.0)(8e6) == 17.0


@pytest.mark.parametrize("ps", [5e6, 6.3e6, 8e6, 10e6])
def test_eq_9_is_the_papers(ps):
    assert gain(EQ_9)(ps) == pytest.approx(4.25 + 2.72 * (ps / 1e6) - 0.134 * (ps / 1e6) ** 2, rel=1e-12)


def test_eq_9_is_clamped_to_its_range():
    assert gain(EQ_9)(0.0) == gain(EQ_9)(5e6) == pytest.approx(14.5)
    assert gain(EQ_9)(50e6) == gain(EQ_9)(10e6) == pytest.approx(18.05)


def test_a_table_is_interpolated_and_clamped():
    ps = np.linspace(4e6, 11e6, 57)
    expected = np.interp(ps, [5e6, 7e6, 10e6], [14.5, 16.7, 18.0])
    assert [gain(TABLE)(p) for p in ps] == pytest.approx(list(expected), rel=1e-12)


def test_an_unknown_pressure_is_an_unknown_gain():
    assert math.isnan(gain(EQ_9)(math.nan))
    assert math.isnan(gain(TABLE)(math.nan))


def test_the_range_of_a_gain():
    assert gain_range(parsed(17)) == (17, 17)
    assert gain_range(parsed(TABLE)) == (14.5, 18.0)
    assert gain_range(parsed(EQ_9)) == pytest.approx((14.5, 18.05), rel=1e-3)


@pytest.mark.parametrize(("raw", "guess"), [("identified", 0.0), ({"identified": 15}, 15.0)])
def test_a_gain_to_be_identified_has_a_guess_and_needs_no_pressure(raw, guess):
    assert is_identified(parsed(raw))
    assert not needs_pressure(parsed(raw))
    assert gain_range(parsed(raw)) == (guess, guess)
    assert gain(raw)(math.nan) == guess
    assert not is_identified(parsed(EQ_9))
    assert needs_pressure(parsed(EQ_9))
    again = TypeAdapter(Gain).validate_json(parsed(raw).model_dump_json())
    assert again == parsed(raw)


@pytest.mark.parametrize(
    ("raw", "told"),
    [
        (0, "greater than 0"),
        ("known", "must be a number, or a number with a unit"),
        ({"identified": -1.0}, "greater than or equal to 0"),
        ({"identified": 15.0, **TABLE}, "one of `table`, `polynomial`"),
        ({}, "one of `table`, `polynomial`"),
        ({**EQ_9, **TABLE}, "one of `table`, `polynomial`"),
        ({"polynomial": [17.0]}, "belong together"),
        ({**EQ_9, "range": [10e6, 5e6]}, "lower end"),
        ({"table": {"ps": [5e6, 6e6], "K_L": [14.0, 15.0, 16.0]}}, "one gain for each pressure"),
        ({"table": {"ps": [6e6, 5e6], "K_L": [14.0, 15.0]}}, "ps must ascend"),
        ({"table": {"ps": ["5 V", "6 V"], "K_L": [14.0, 15.0]}}, "wrong unit"),
    ],
)
def test_what_is_no_gain_is_told(raw, told):
    with pytest.raises(ValidationError, match=told):
        parsed(raw)
