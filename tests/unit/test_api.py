"""The Python interface: data of any form, answers of one kind, commands over the same, all in memory."""

from __future__ import annotations

import inspect
import io
import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import polars as pl
import pytest
from diagnosis_example import example

import seod
import seod.diagnose.command as command_module
from seod.cli import app
from seod.diagnose.verdict.bootstrap import with_intervals
from seod.machine import limits
from tests.command_line import CliRunner

K_L, OMEGA_N, ZETA = 12.0, 60.0, 0.4
TICK = 1e-3


def truth(n: int = 3000) -> dict[str, np.ndarray]:
    """Eq. 1 by its exact step response, written apart from every model of the program: steps of +-1 V."""
    t = np.arange(n) * TICK
    u = np.where((np.arange(n) // 120) % 2 == 0, 1.0, -1.0)
    damped = OMEGA_N * np.sqrt(1.0 - ZETA**2)
    y = np.zeros(n)
    for k in np.flatnonzero(np.diff(np.concatenate(([0.0], u)))):
        s = np.maximum(t - t[k], 0.0)
        step = u[k] - (u[k - 1] if k else 0.0)
        decay = np.exp(-ZETA * OMEGA_N * s)
        # integral of 1 - e^(-zeta wn s) (cos wd s + zeta wn / wd sin wd s)
        cosine, sine = np.cos(damped * s), np.sin(damped * s)
        free = 2.0 * ZETA / OMEGA_N * (1.0 - decay * cosine)
        free += (1.0 - 2.0 * ZETA**2) / damped * decay * sine
        y += K_L * step * (s - free)
    return {"t": t, "u": u, "y": y + np.random.default_rng(3).normal(scale=1e-3, size=n)}


@pytest.fixture(scope="module")
def columns():
    return truth()


FORMS = {
    "arrays": lambda c: {**c},
    "mapping": lambda c: {"data": {name: x.tolist() for name, x in c.items()}},
    "pandas": lambda c: {"data": pd.DataFrame(c)},
    "pandas, time as index": lambda c: {"data": pd.DataFrame(c).set_index("t")},
    "polars": lambda c: {"data": pl.DataFrame(c)},
    "polars, other names and units": lambda c: {
        "data": pl.DataFrame({"time": c["t"] * 1e3, "cmd": c["u"] * 1e3, "pos [deg]": np.degrees(c["y"])}),
        "columns": "t=time,u=cmd,y=pos",
        "units": {"t": "ms", "u": "mV"},
    },
    "times of day": lambda c: {
        "data": pd.DataFrame(
            {**c, "t": pd.Timestamp("2026-01-01") + pd.to_timedelta(np.rint(c["t"] * 1e6), unit="us")}
        )
    },
    "recording": lambda c: {"data": seod.read(**c)},
}


@pytest.mark.parametrize("form", FORMS)
def test_data_of_any_form_give_the_truth(columns, form):
    given = FORMS[form](columns)
    data = given.pop("data", None)
    found = seod.identify(data, **given)
    assert found.quality == "ok"
    for value, true in ((found.K_L, K_L), (found.omega_n, OMEGA_N), (found.zeta, ZETA)):
        assert abs(value.value - true) < 5.0 * value.sd < 0.02 * true
    assert found.delay.value == pytest.approx(0.0, abs=1e-4)
    unit = "rad" if form.startswith("polars, other") else "unit"
    assert found.to_dict()["K_L"]["unit"] == f"{unit}/s/V"


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({}, "give a path, a table, or the arrays"),
        ({"t": [0.0, 1.0], "u": [0.0]}, "different lengths: t 2, u 1"),
        ({"t": [0.0], "u": [0.0]}, "no column 'y'"),
        ({"data": 3}, "int is no measured data"),
        ({"data": pd.DataFrame({"t": [], "u": [], "y": []})}, "has no rows"),
        ({"data": {"t": [[0.0]], "u": [0.0], "y": [0.0]}}, "has 2 dimensions"),
        ({"data": {"t": ["a", "b"], "u": [0, 1], "y": [0, 1]}}, "holds text"),
        ({"data": "nowhere.csv"}, "nowhere.csv"),
        ({"data": {"t": [0, 1], "u": [0, 1], "y": [0, 1]}, "units": "y=parsec"}, "'parsec' is not known"),
    ],
)
def test_data_that_are_none_are_refused_with_the_reason(given, said):
    with pytest.raises(seod.ReadError, match=said):
        seod.read(given.get("data"), **{k: v for k, v in given.items() if k != "data"})


def test_both_data_and_arrays_are_one_too_many(columns):
    with pytest.raises(seod.ReadError, match="not both"):
        seod.identify(columns, **columns)


def test_a_recording_is_shown_in_all_ways(columns):
    recording = seod.read(**columns, units="y=mm")
    assert recording.units["y"] == "m"
    assert "3000 rows" in str(recording)
    assert "1000 Hz" in repr(recording)
    assert list(recording.to_frame().columns) == ["t", "u", "y"]
    assert recording.to_dict()["columns"]["y"]["unit"] == "m"
    assert "<svg" in recording._repr_html_()
    assert recording.plot().axes[1].get_ylabel() == "y [m]"
    part = seod.read(recording, between=(1.0, 2.0))
    assert (part.t[0], part.t[-1]) == (1.0, 2.0)


def test_an_identification_is_shown_in_all_ways(columns):
    found = seod.identify(**columns, units="y=mm", gain="12 mm/s/V", delay="0 ms")
    assert found.K_L.sd == 0.0
    assert found.K_L.value == pytest.approx(0.012)
    assert "given" in str(found)
    assert "m/s/V" in str(found)
    frame = found.to_frame().set_index("name")
    assert frame.loc["omega_n", "unit"] == "rad/s"
    json.dumps(found.to_dict(), allow_nan=False)
    page = found.to_html()
    assert "<svg" in page
    assert "<script" not in page
    assert not any(word in page for word in ('src="http', 'href="http'))


@pytest.mark.parametrize(
    ("option", "said"),
    [
        ({"gain": 0}, "gain: must be a number other than 0"),
        ({"gain": "3 V"}, "wrong unit 'V'"),
        ({"delay": "-1 ms"}, "0 or more"),
        ({"between": "3:1"}, "two rising numbers"),
    ],
)
def test_wrong_options_name_themselves(columns, option, said):
    with pytest.raises(ValueError, match=said):
        seod.identify(**columns, **option)


def test_what_is_not_to_be_identified_is_said_without_an_exception(columns):
    still = seod.identify(t=columns["t"], u=columns["u"] * 0.0, y=columns["y"])
    assert still.quality == "no_oscillation"
    assert np.isnan(still.omega_n.value)
    assert not still.drawable
    assert "<svg" not in still._repr_html_()


def test_a_relays_estimators_take_data_in_memory():
    made = seod.simulate(seod.RigFile.shipped(), duration=1.0, seed=2)
    found = seod.identify(made, method="wave", gain=17.0)
    assert found.to_dict()["method"] == "wave"
    assert found.omega_n.value == pytest.approx(117.0, rel=0.01)


def test_a_simulation_is_data_and_the_command_writes_the_same(tmp_path):
    rig = seod.RigFile.shipped()
    steps: list[tuple[str, float]] = []
    made = seod.simulate(
        rig,
        effect={"coulomb_friction": {"level": 200.0}},
        duration="2 s",
        amplitude="400 mV",
        seed=5,
        progress=lambda what, part: steps.append((what, part)),
    )
    assert steps[-1] == ("simulating", 1.0)
    assert made.truth["effects"]["coulomb_friction"] == {"level": 200.0}
    assert np.abs(made.recording.u).max() == 0.4
    out = tmp_path / "run.csv"
    words = ["--effect", "coulomb_friction.level=200", "--duration", "2", "--amplitude", "0.4", "--seed", "5"]
    done = CliRunner().invoke(app, ["simulate", str(rig.path), "--out", str(out), *words])
    assert json.loads(done.stdout) == {"file": str(out), **made.to_dict()}
    again = seod.read(out)
    assert again.units["y"] == "rad"
    for name in ("t", "u", "y", "t_u"):
        assert np.array_equal(getattr(again, name), getattr(made.recording, name))
    assert made.save(tmp_path / "own.csv").read_bytes() == out.read_bytes()


@pytest.mark.slow
def test_a_command_in_memory_is_followed():
    t = np.arange(2000) / 2000.0
    made = seod.simulate(
        seod.RigFile.shipped(), excitation="file", input=pd.DataFrame({"t": t, "u": 0.1 * np.sin(30.0 * t)})
    )
    assert np.array_equal(made.recording.u, 0.1 * np.sin(30.0 * t))
    with pytest.raises(ValueError, match="no column u"):
        seod.simulate(seod.RigFile.shipped(), excitation="file", input={"t": t})


def test_a_rig_file_with_other_values_keeps_its_comments(tmp_path):
    rig = seod.RigFile.shipped()
    other = rig.with_values({"axes.motor.relay.e_a": "250 mV"})
    assert other.axes["motor"].relay.e_a == 0.25
    assert rig.axes["motor"].relay.e_a == 0.5
    assert other.text.count("#") == rig.text.count("#")
    assert seod.RigFile(other.save(tmp_path / "other.yaml")).to_dict() == other.to_dict()
    assert "verdict: ok" in rig.summary()
    with pytest.raises(seod.ConfigErrors, match="e_a"):
        rig.with_values({"axes.motor.relay.e_a": "250 mm"})
    assert seod.simulate(other, duration=0.5).recording.u.max() == 0.25


def test_a_response_of_data_in_memory(columns):
    noise = np.random.default_rng(1).choice([-1.0, 1.0], 3000 // 6).repeat(6)
    made = seod.simulate(
        seod.RigFile.shipped(),
        excitation="file",
        input={"t": columns["t"], "u": np.resize(0.1 * noise, 3000)},
    )
    found = seod.response(made)
    assert found.omega_n == pytest.approx(117.0, rel=0.02)
    assert found.gain_unit == "rad/s/V"
    assert found.to_dict()["units"]["K_L"] == "rad/s/V"
    assert set(found.to_frame().columns) >= {"omega", "gain", "phase"}
    assert len(found.plot().axes) == 2
    for given, said in (({}, "give recordings"), ({"config": "rig.yaml", "units": "y=mm"}, "rig.yaml")):
        with pytest.raises((ValueError, seod.ConfigErrors), match=said):
            seod.response(**given)
    with pytest.raises(ValueError, match="--amplitude: for a rig that is excited"):
        seod.response(made, amplitude=1.0)


@pytest.fixture
def asked(monkeypatch):
    """The diagnosis stood in for; what it was asked."""
    calls = []

    def diagnose(recordings, holdout, options, progress):
        progress("looking", 0.5)
        calls.append((recordings, holdout, options))
        return example()

    monkeypatch.setattr(command_module, "diagnose", diagnose)
    return calls


def test_a_diagnosis_is_shown_in_all_ways_and_asks_what_was_given(asked, columns, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    bar = Bar()
    found = seod.diagnose(pl.DataFrame(columns), units="y=rad", effort="quick", gain=3, progress=bar)
    assert (bar.n, bar.said) == (0.5 * bar.total, ["looking"])
    ((recordings, holdout, options),) = asked
    assert (len(recordings[0].t), holdout, options.effort, options.gain) == (3000, [], "quick", 3.0)
    assert list(tmp_path.iterdir()) == []  # nothing went through the disk
    assert found.verdict == "effects"
    assert found.to_frame().loc[0, "cause"] == "coulomb_friction"
    assert found.to_dict()["units"] == {"y": "rad", "K_L": "rad/s/V", "omega_n": "rad/s", "zeta": "1"}
    assert str(found).startswith("The baseline misses coulomb_friction")
    assert found.command() == ""
    assert len(found.plot().axes) == 2
    assert found.rig_file().config.simulation.plants["plant"].effects["coulomb_friction"]
    assert found.extended.holdout_ci95 == with_intervals(example()).extended.holdout_ci95


def test_a_diagnosis_of_files_tells_the_command(asked, tmp_path):
    seod.simulate(seod.RigFile.shipped(), duration=0.5).save(tmp_path / "a.csv")
    found = seod.diagnose(tmp_path / "a.csv", hold="first", between="0.1:0.4")
    told = f"seod diagnose {tmp_path / 'a.csv'} --hold first --between 0.1:0.4"
    assert found.command() == told
    assert found.command(Path("out")) == f"seod diagnose {tmp_path / 'a.csv'} --out out --hold first " + (
        "--between 0.1:0.4"
    )


class Bar:
    """As much of tqdm as is asked for."""

    def __init__(self) -> None:
        self.n, self.total, self.said = 0.0, 200.0, []

    def update(self, n: float) -> None:
        self.n += n

    def set_description(self, desc: str) -> None:
        self.said.append(desc)


def test_tqdm_itself_is_taken(columns, monkeypatch):
    from tqdm import tqdm

    monkeypatch.setattr(tqdm, "monitor_interval", 0)  # no thread
    with tqdm(total=100, file=io.StringIO()) as bar:
        seod.identify(**columns, gain=12.0, progress=bar)
        assert bar.n == pytest.approx(100.0)


OPTIONS = {
    "identify": seod.identify,
    "diagnose": seod.diagnose,
    "response": seod.response,
    "simulate": seod.simulate,
}
SHELL = {"paths", "path", "as_json", "plot", "out"}
"""What only a command has: where files are, and what is printed or written."""
ARRAYS = {"data", "t", "u", "y", "t_u", "ps", "temperature", "f", "progress"}


@pytest.mark.parametrize("name", OPTIONS)
def test_options_have_the_same_names_as_on_the_command_line(name):
    (command,) = [each for each in app.registered_commands if each.callback.__name__ == name]
    typed = {each.rstrip("_") for each in inspect.signature(command.callback).parameters} - SHELL
    function = OPTIONS[name]
    offered = set(inspect.signature(function).parameters)
    assert offered - ARRAYS - {"config"} == typed - {"config"}


def test_stub_and_table_offer_the_same():
    stub = Path(seod.__file__).with_suffix(".pyi").read_text()
    told = {
        name: module for module, name in re.findall(r"^from (\S+) import \w+ as (\w+)$", stub, re.MULTILINE)
    }
    assert told == seod._OFFERED
    for name in told:
        assert getattr(seod, name) is not None
    assert callable(seod.identify)
    assert set(told) <= set(dir(seod))
    with pytest.raises(AttributeError, match="nothing_such"):
        seod.nothing_such  # noqa: B018


def test_a_room_of_a_functions_name_is_still_a_package():
    import seod.identify.answer

    assert seod.identify.answer.identify is not None
    assert inspect.signature(seod.identify).parameters["gain"]
    with pytest.raises(AttributeError, match="nothing"):
        seod.identify.nothing  # noqa: B018


def test_importing_seod_loads_nothing_heavy():
    heavy = {"numpy", "scipy", "pydantic", "matplotlib", "numba"}
    code = f"import seod, sys; print(sorted({heavy} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


NOT_ELSEWHERE = (
    "fcntl",
    "termios",
    "resource",
    "pwd",
    "grp",
    "pty",
    "tty",
    "syslog",
    "readline",
    "crypt",
    "spwd",
)
"""Modules that Windows has not."""
WITHOUT = """
import builtins, os, signal, sys

OWN = ("seod", "drivers", "sim")
usual = builtins.__import__

def guarded(name, globals=None, locals=None, fromlist=(), level=0):
    by = (globals or {}).get("__name__", "").partition(".")[0]
    if by in OWN and level == 0 and name.partition(".")[0] in %r:
        print("asked for", name, "by", (globals or {}).get("__name__"), file=sys.stderr)
        raise ImportError(f"no module named {name!r} on this system")
    return usual(name, globals, locals, fromlist, level)

builtins.__import__ = guarded
import numpy, scipy, scipy.optimize, scipy.signal, pandas, matplotlib.figure, numba, pydantic
import multiprocessing.context, concurrent.futures, asammdf, pyarrow.parquet
import cantools, can, serial  # what they do is theirs
for name in ("sched_getaffinity", "sched_setaffinity", "memfd_create", "fork", "sysconf",
             "sched_setscheduler", "O_CLOEXEC", "O_DIRECTORY", "geteuid", "getuid",
             "pidfd_open", "eventfd", "fchmod"):
    if hasattr(os, name):
        delattr(os, name)
for name in ("SIGXCPU", "SIGALRM", "SIGKILL", "SIGHUP", "setitimer", "pthread_sigmask"):
    if hasattr(signal, name):
        delattr(signal, name)
"""
ANALYST = """
import seod, pathlib
rig = seod.RigFile.shipped()
made = seod.simulate(rig, duration=1.5, effect={"coulomb_friction.level": 400}, seed=1)
made.save("run.csv")
kind = {"excitation": "multisine", "period": 0.5, "lines": 20}
sweep = seod.simulate(rig, amplitude=0.2, duration=2.0, **kind)
import pandas
pandas.read_csv("run.csv").rename(columns={"y [rad]": "y"}).to_parquet("run.parquet")
import scipy.io
scipy.io.savemat("run.mat", {name: x for name, x in made.to_columns().items()})
for path in ("run.csv", "run.parquet", "run.mat"):
    assert len(seod.read(path).t) == len(made.recording.t), path
live = seod.identify("run.csv", method="wave", gain=17.0)
assert live.to_dict()["method"] == "wave", live
assert seod.identify(made, config=rig).to_html()
assert seod.response(sweep).plot() is not None
from typer.testing import CliRunner
from seod.cli import app
sweep.save("sweep.csv")
simulated = ["simulate", str(rig.path), "--out", "b.csv", "--duration", "0.2"]
responded = ["response", "sweep.csv", "--period", "0.5", "--plot", "bode.png"]
diagnosed = ["diagnose", "sweep.csv", "--effort", "quick", "--between", "0:1", "--out", "named"]
for words in (["info", "run.csv"], ["identify", "run.csv"], simulated, responded, diagnosed):
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, (words, done.output)
assert pathlib.Path("bode.png").stat().st_size > 10000
assert pathlib.Path("named/report.html").stat().st_size > 10000
found = seod.diagnose("run.csv", effort="quick", between="0:1")
found.save("found")
assert pathlib.Path("found/report.html").stat().st_size > 10000
print("done", found.verdict)
"""


@pytest.mark.slow
@pytest.mark.timeout(400)
def test_the_analysts_half_needs_nothing_that_only_linux_has(tmp_path):
    program = WITHOUT % (NOT_ELSEWHERE,) + ANALYST
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.stdout.startswith("done"), done.stderr[-3000:]
    asked_for = {line for line in done.stderr.splitlines() if line.startswith("asked for")}
    assert asked_for <= {"asked for resource by seod.machine.limits"}


def test_the_daemon_says_that_it_needs_linux(monkeypatch):
    monkeypatch.setattr(limits, "PLATFORM", "win32")
    told = (
        "seod: this needs Linux, and here is win32: identify, diagnose, response of recordings and simulate "
    )
    for words in (["run"], ["rig"], ["calibrate"], ["response", "--config"]):
        done = CliRunner().invoke(app, [*words, str(seod.RigFile.shipped().path)])
        assert (done.exit_code, done.stderr) == (1, f"{told}run anywhere\n")
