"""Parts of `seod simulate`: how its words are read, how its files are written, how it shows progress."""

from __future__ import annotations

import io
import re
import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from seod.api.data import pair
from seod.api.progress import followed
from seod.simulate.csv_file import write_csv
from seod.simulate.options import BELONGS, EXCITATIONS, Options, read_effects
from seod.terminal.progress import bar
from sim.effects import EFFECTS

PLACES = [(effect, each) for effect in EFFECTS.values() for each in effect.parameters]


def test_a_file_that_cannot_be_written_leaves_nothing(tmp_path):
    columns = {"t": np.zeros(3), "u": np.zeros(2)}
    with pytest.raises(ValueError, match="shorter"):
        write_csv(tmp_path / "out.csv", columns)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_long_work_shows_how_far_it_is_and_errors_come_through():
    console = Console(file=io.StringIO(), force_terminal=True, width=80)
    asked = []

    def work():
        while len(asked) < 3:
            time.sleep(0.01)
        return "done"

    def fraction():
        asked.append(0.42)
        return 0.42

    with bar(console) as told:
        assert followed("simulating", work, fraction, told) == "done"
    assert "42%" in console.file.getvalue()

    def fails():
        raise ValueError("in the thread")

    with pytest.raises(ValueError, match="in the thread"):
        followed("simulating", fails, fraction, lambda _what, _part: None)


@given(st.sampled_from(PLACES), st.floats(allow_nan=False))
def test_each_number_of_each_effect_is_read_or_refused_with_its_range(place, value):
    effect, each = place
    word = f"{effect.name}.{each.name}={value!r}"
    if each.low <= value <= each.high:
        assert read_effects([word]) == {effect.name: {each.name: value}}
    else:
        with pytest.raises(ValueError, match=re.escape(word)) as told:
            read_effects([word])
        assert "must be within" in str(told.value)


@given(st.text())
def test_any_other_word_is_refused_with_a_sentence(word):
    with pytest.raises(ValueError, match=r"effect|has no parameter|give a number|must be within"):
        read_effects([word])


def test_the_last_of_two_values_counts():
    assert read_effects(["backlash.gap=1", "backlash.gap=2"]) == {"backlash": {"gap": 2.0}}
    assert read_effects([]) == {}


@given(st.text(max_size=12))
def test_a_band_is_two_frequencies_or_refused(text):
    try:
        low, high = pair(text, "--band", positive=True)
    except ValueError as error:
        told = str(error)
        assert f"--band {text}" in told
    else:
        assert 0.0 < low <= high


@pytest.mark.parametrize("option", list(BELONGS))
def test_an_option_that_does_nothing_is_refused(option):
    for kind in set(EXCITATIONS) - set(BELONGS[option]) - {"file"}:
        with pytest.raises(ValueError, match=f"--{option} belongs to"):
            Options(excitation=kind, **{option: 1})
