"""Excitation signals: their spectra, courses and bounds; commands from files, sound and not."""

import gzip
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.excitation import multisine, multisine_orders, read_input, sine, steps, sweep

RATE = 1000.0


def ticks(seconds):
    return np.arange(round(seconds * RATE)) / RATE


def seeded(seed=1):
    return np.random.default_rng(seed)


def test_a_multisine_has_its_lines_and_no_others():
    t = ticks(8.0)
    u = multisine(t, 0.7, (0.5, 20.0), period=4.0, lines=9, random=seeded())
    assert np.abs(u[:4000]).max() == pytest.approx(0.7, rel=1e-12)
    np.testing.assert_array_equal(u[:4000], u[4000:])
    spectrum = np.abs(np.fft.rfft(u[:4000]))
    there = np.flatnonzero(spectrum > 1e-9 * spectrum.max())
    np.testing.assert_array_equal(there, multisine_orders((0.5, 20.0), 4.0, 9))
    assert there[0] == 2
    assert there[-1] == 80
    assert spectrum[there] == pytest.approx(spectrum.max())


def test_seeds_make_the_phases():
    def one(seed):
        return multisine(ticks(2.0), 1.0, (1.0, 50.0), 2.0, None, seeded(seed))

    np.testing.assert_array_equal(one(3), one(3))
    assert not np.allclose(one(3), one(4), atol=0.1)


@pytest.mark.parametrize(
    ("band", "says"), [((0.1, 0.2), "longer period"), ((1.0, 500.0), "half the rate, 500 Hz")]
)
def test_a_multisine_without_lines_or_beyond_the_rate_is_refused(band, says):
    with pytest.raises(ValueError, match=says):
        multisine(ticks(2.0), 1.0, band, 2.0, None, seeded())


@pytest.mark.parametrize("linear", [False, True])
def test_a_sweep_goes_through_its_band(linear):
    t = ticks(20.0)
    share = t / t[-1]
    frequency = 2.0 + 38.0 * share if linear else 2.0 * 20.0**share
    phase = np.concatenate(([0.0], np.cumsum(np.pi / RATE * (frequency[1:] + frequency[:-1]))))
    np.testing.assert_allclose(sweep(t, 0.5, (2.0, 40.0), linear), 0.5 * np.sin(phase), atol=1e-3)


def test_a_sweep_of_one_frequency_is_a_sine():
    t = 3.0 + ticks(2.0)
    np.testing.assert_allclose(sweep(t, 2.0, (5.0, 5.0)), sine(t, 2.0, 5.0), atol=1e-9)
    assert sine(t, 2.0, 5.0)[50] == pytest.approx(2.0)


def test_steps_come_in_mirrored_pairs():
    u = steps(ticks(100.0), 0.8, 2.0, seeded())
    edges = np.flatnonzero(np.diff(u)) + 1
    levels, lengths = u[edges[:-1]], np.diff(edges) / RATE
    pairs = (len(levels) - 1) // 2  # the first pair has lost its first step here
    np.testing.assert_array_equal(levels[1::2][:pairs], -levels[2::2][:pairs])
    np.testing.assert_allclose(lengths[1::2][:pairs], lengths[2::2][:pairs], atol=1.01 / RATE)
    assert np.abs(u).max() <= 0.8
    assert np.abs(np.cumsum(u)).max() / RATE < 0.8 * 0.375 + 0.01  # the position comes back after each pair
    assert len(edges) == pytest.approx(400, rel=0.1)
    assert levels.std() == pytest.approx(0.8 / math.sqrt(3.0), rel=0.1)


def test_a_command_from_a_file(tmp_path):
    path = tmp_path / "in.csv"
    path.write_text("\ufeffps,note, u ,t\n7e6,a,0.5,0\n7.5e6,b,-0.5,0.25\n")
    found = read_input(path)
    assert found.t.tolist() == [0.0, 0.25]
    assert found.u.tolist() == [0.5, -0.5]
    assert found.ps is not None
    assert found.ps.tolist() == [7e6, 7.5e6]
    assert found.temperature is None
    packed = tmp_path / "in.csv.gz"
    packed.write_bytes(gzip.compress(path.read_bytes()))
    assert read_input(packed).u.tolist() == [0.5, -0.5]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "in.csv:1: no column t, u; the header has nothing"),
        ("time,u\n0,1\n", "in.csv:1: no column t; the header has time, u"),
        ("t,u\n0,1\n1,one\n", "in.csv:3: u: 'one' is no number"),
        ("t,u\n0,1\n1\n", "in.csv:3: u: '' is no number"),
        ("t,u\n0,1\n1,inf\n", "in.csv:3: u: 'inf' is no number"),
        ("t,u\n0,1\n2,1\n2,1\n", "t must ascend, and does not after t = 2"),
        ("t,u\n0,1\n", "has 1 rows"),
    ],
)
def test_what_is_wrong_with_a_file_is_told_with_its_place(tmp_path, text, says):
    path = tmp_path / "in.csv"
    path.write_text(text)
    with pytest.raises(ValueError, match=r"in\.csv") as told:
        read_input(path)
    assert says in str(told.value)


@given(
    st.one_of(
        st.binary(max_size=60),
        st.lists(st.sampled_from(["t", "u", ",", "\n", "1", '"', "\0"])).map(
            lambda words: "".join(words).encode()
        ),
    ),
    st.sampled_from(["in.csv", "in.csv.gz"]),
)
def test_any_bytes_are_a_command_or_a_clear_refusal(tmp_path_factory, data, name):
    path = tmp_path_factory.mktemp("any") / name
    path.write_bytes(data)
    try:
        found = read_input(path)
    except ValueError as error:
        told = str(error)
    else:
        told = str(path)
        assert np.all(np.diff(found.t) > 0.0)
        assert np.isfinite(found.u).all()
    assert str(path) in told
