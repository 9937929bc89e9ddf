"""Numbers on the command line: each must be one, and one that can be meant."""

from __future__ import annotations

from typing import Annotated, get_args, get_origin, get_type_hints

import pytest
from test_cli import invoke

from seod.cli import app
from seod.files.shipped import configs_dir

VIRTUAL = configs_dir() / "virtual.yaml"


def float_options():
    """Every option of every command that takes a number with a point."""
    for command in app.registered_commands:
        name = command.name or command.callback.__name__
        for parameter, hint in get_type_hints(command.callback, include_extras=True).items():
            kind, *about = get_args(hint) if get_origin(hint) is Annotated else (hint,)
            if about and float in (kind, *get_args(kind)):
                words = [about[0].default, *(about[0].param_decls or ()), f"--{parameter.replace('_', '-')}"]
                yield name, next(word for word in words if str(word).startswith("--"))


OPTIONS = sorted(float_options())


def test_there_are_such_options():
    assert {("simulate", "--duration"), ("run", "--for"), ("ramp", "--from"), ("identify", "--gain")} <= {
        *OPTIONS
    }


@pytest.mark.parametrize("value", ["nan", "inf", "-inf", "1e999"])
@pytest.mark.parametrize(("command", "option"), OPTIONS)
def test_what_is_no_finite_number_is_refused(command, option, value, tmp_path):
    needed = {
        "simulate": [VIRTUAL, "--out", tmp_path / "x.csv"],
        "ramp": ["--from", "1", "--to", "2"],
        "watch": [],
        "latency": [],
    }.get(command, [VIRTUAL])
    code, out, err = invoke(command, *needed, f"{option}={value}")
    assert (code, out) == (2, "")
    assert f"Invalid value for '{option}'" in err
    assert not (tmp_path / "x.csv").exists()


@pytest.mark.parametrize(
    "words",
    [
        "--duration 1e12",
        "--duration 1e8",
        "--amplitude 1e308",
        "--bias -1e308",
        "--noise 1e308",
        "--latency 1e300",
        "--excitation multisine --period 1e300",
        "--excitation multisine --lines 99999999999",
        "--excitation two-phase --cycles 99999999999999999999",
        "--seed 99999999999999999999999999999999999999999999",
    ],
)
def test_absurd_wishes_for_a_simulation_are_refused(words, tmp_path):
    code, out, err = invoke("simulate", VIRTUAL, "--out", tmp_path / "x.csv", *words.split())
    assert code in (1, 2)
    assert out == ""
    assert words.split()[-2] in err
    assert not (tmp_path / "x.csv").exists()


@pytest.mark.parametrize(
    "words",
    [
        ["response", "--config", VIRTUAL, "--amplitude", "1e308"],
        ["response", "--config", VIRTUAL, "--seed", "-1"],
        ["response", "--config", VIRTUAL, "--band", "1:inf"],
        ["response", VIRTUAL, "--between", "nan:3"],
        ["calibrate", VIRTUAL, "--pressures", "1000000000"],
        ["latency", "--for", "1e9"],
        ["run", VIRTUAL, "--for", "1e300"],
        ["ramp", "--from", "0", "--to", "1e308"],
        ["identify", VIRTUAL, "--gain", "0"],
        ["identify", VIRTUAL, "--delay", "1e300"],
        ["set", "e_a=nan"],
        ["set", "K_L=inf"],
    ],
    ids=lambda words: " ".join(map(str, words)),
)
def test_absurd_numbers_of_other_commands_are_refused(words):
    code, out, err = invoke(*words)
    assert code in (1, 2)
    assert out == ""
    assert words[-2].removeprefix("set") in err
    assert "Traceback" not in err
