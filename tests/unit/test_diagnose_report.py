"""The page: well-formed, complete, self-contained, and it says what the diagnosis says."""

from __future__ import annotations

import json
import math
import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from diagnosis_example import FRICTION, example

from seod.data import Recording
from seod.diagnose.report.chart import AFTER, BEFORE, MEASURED, Chart, Curve, Map, thinned, wrapped
from seod.diagnose.report.fields import _band
from seod.diagnose.report.files import facts
from seod.diagnose.report.over_time import wholes
from seod.diagnose.report.page import page
from seod.diagnose.report.pictures import Pictures
from seod.diagnose.report.tables import effects, figures
from seod.diagnose.report.text import as_text
from seod.diagnose.report.units import Units
from seod.diagnose.report.words import (
    GRADES,
    consequences,
    free_run_names,
    headline,
    percent,
    percent_of,
    told_runs,
)
from seod.diagnose.result import Common, FreeRun, Gain, Parameter, Unexplained
from seod.diagnose.show.maps import Binned
from seod.diagnose.verdict.bootstrap import with_intervals
from seod.diagnose.verdict.remarks import DRIFTS
from seod.diagnose.verdict.unexplained import _shares
from seod.plots.style import style


@pytest.fixture(scope="module")
def found():
    return with_intervals(example())


@pytest.fixture(scope="module")
def html(found):
    return page(found, "rad", ["run <1>.csv"])


class Nesting(HTMLParser):
    """Fails where tags do not match."""

    def __init__(self):
        super().__init__()
        self.open = []

    def handle_starttag(self, tag, _attributes):
        if tag not in ("meta", "br"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def pictures(html):
    return re.findall(r"<svg.*?</svg>", html, re.DOTALL)


@pytest.mark.slow
def test_it_is_well_formed_and_needs_nothing_from_outside(html):
    parser = Nesting()
    parser.feed(html)
    assert parser.open == []
    for picture in pictures(html):
        ET.fromstring(picture)
    assert not re.search(r'(src|href)="(?!#|data:)|url\([^#]|@import|<script', html)
    used = set(re.findall(r'(?:href="|url\()#([\w-]+)', html))
    assert used <= set(re.findall(r' id="([\w-]+)"', html))
    assert "run &lt;1&gt;.csv" in html


@pytest.mark.slow
def test_numbers_are_numbers(html):
    assert not re.search(r"[ \"(]-?(nan|inf)", " ".join(pictures(html)))


@pytest.mark.slow
def test_it_says_what_was_found(html, found):
    assert headline(found).replace("<", "&lt;") in html
    assert "level = 250.0 ± 5.0 rad/s^2" in html
    assert "cannot be told from load_spring" in html
    assert "seod simulate x" in html
    assert "zeta 50 % too high (0.6 instead of 0.4), omega_n right" in html
    assert html.count("<svg") == 13  # the command is not periodic: no harmonics, no phase


@pytest.mark.slow
def test_a_clean_record_shows_one_model_and_no_causes():
    clean = example(found=False)
    html = page(clean, "rad", ["a.csv"])
    assert "Clean" in html
    assert "Causes, each" not in html
    assert "<th>extended</th>" not in html
    assert "extended" not in as_text(clean, "rad")
    assert not any(AFTER in picture for picture in pictures(html))


def test_of_many_recordings_the_runs_of_those_held_out_are_shown(found):
    runs = tuple(FreeRun(1.0 + k, 0.5 + k, unseen=k > 4) for k in range(6))
    models = {of: replace(getattr(found, of), free_runs=runs) for of in ("baseline", "extended")}
    many = replace(found, whole=found.whole * 6, **models)
    assert told_runs(many) == [0, 1, 2, 5]
    assert list(free_run_names(many, "mm")) == [0, 1, 2, 5]
    assert "whole run 6, held out [mm]" in as_text(many, "mm")
    assert len(wholes(Pictures(many, "mm"))) == 4


@pytest.mark.parametrize(
    ("part", "told"), [(0.0, "0 %"), (0.0006, "0.06 %"), (0.0041, "0.4 %"), (0.012, "1 %"), (1.0, "100 %")]
)
def test_a_share_that_is_there_is_never_0(part, told):
    assert percent_of(part) == told


def test_what_is_unexplained_is_not_sold_as_explained(found):
    rest = replace(found, verdict="unexplained", unexplained=Unexplained(0.3, ("velocity", "time")))
    assert "but that is not all" in headline(rest)
    told = "30 % of the baseline's squared error above the noise; it goes with the velocity, the time"
    assert told in as_text(rest, "rad")
    assert "none of the known causes" in headline(replace(rest, effects=()))


def test_what_the_rest_goes_with_is_told_in_words(found):
    """Not by the names of the answer as JSON; a drive that no pressure moves has no load pressure."""
    names = tuple(_shares(_held(found)))
    rest = replace(found, verdict="unexplained", unexplained=Unexplained(0.3, names))
    (told,) = [each for each in consequences(rest) if "it goes with" in each]
    assert set(told.partition("it goes with ")[2].rstrip(".").split(", ")) == {
        "the command",
        "the load force",
        "the velocity",
        "the position",
        "the time",
        "the supply pressure",
        "the measured disturbance",
    }
    supplied = tuple(replace(w, ps=np.ones(len(w.t))) for w in found.windows)
    (told,) = [each for each in consequences(replace(rest, windows=supplied)) if "it goes with" in each]
    assert "the load pressure" in told


def _held(found):
    """As much of a simulation of the windows held out as is asked for what the rest depends on."""
    n = sum(len(w.t) for w in found.windows)
    signals = np.random.default_rng(1).normal(size=(n, 5))
    series = [SimpleNamespace(supply=np.ones(n), force=np.ones(n))]
    cut = SimpleNamespace(series=series, gathered=lambda _: signals[:, 0])
    return SimpleNamespace(scored=np.ones(n, bool), error=signals[:, 1], cut=cut, states=signals)


@pytest.mark.parametrize("grade", GRADES)
def test_the_grade_is_told_without_an_account_too(found, grade):
    assert found.account is None
    told = f"Grade: {grade.replace('_', ' ')}: {GRADES[grade]}."
    assert next(consequences(replace(found, grade=grade))) == told
    assert f"! {told}" in as_text(replace(found, grade=grade), "rad")


def test_defects_of_the_record_are_not_sold_as_the_models(found):
    outliers = replace(found.effects[0], name="outliers")
    only = replace(found, effects=(outliers,))
    assert headline(only).startswith("The recording has outliers; but for that the baseline explains it")
    rest = replace(only, verdict="unexplained")
    assert headline(rest).startswith("Unexplained: the baseline misses something")
    both = replace(found, effects=(*found.effects, outliers))
    assert headline(both).startswith("The baseline misses coulomb_friction: held-out")
    assert all(headline(each).endswith("the recording has outliers.") for each in (rest, both))


COMMON = Common(K_L=16.0, omega_n=61.0, zeta=0.41, offset=-0.125, delay=0.0305, holdout_nrmse=0.0321)


def cells(html):
    """Of the table of figures, row by row."""
    (of,) = re.findall(r'<table class="figures">(.*?)</table>', html, re.DOTALL)
    rows = [re.findall(r"<t[hd]>(.*?)</t[hd]>", row) for row in re.findall(r"<tr>(.*?)</tr>", of)]
    return {row[0]: row[1:] for row in rows}


@pytest.mark.parametrize("better", [0.5, 1.5])
def test_the_baseline_with_offset_and_delay_is_shown_with_both(found, better):
    common = replace(COMMON, holdout_nrmse=better * found.baseline.holdout_nrmse)
    more = replace(found, baseline=replace(found.baseline, common=common))
    rows = cells(figures(more, "rad"))
    assert rows[""] == ["baseline", "baseline with offset and delay", "extended"]
    assert {len(row) for row in rows.values()} == {3}
    assert rows["held-out error (NRMSE)"][1] == f"<b>{percent(common.holdout_nrmse)}</b>"
    assert [rows[name][1] for name in ("omega_n [rad/s]", "zeta", "K_L [rad/s/V]")] == [
        "61.000",
        "0.41000",
        "16.000",
    ]
    assert rows["offset of u [V]"] == ["", "-0.125", ""]
    assert rows["delay [ms]"] == ["", "30.5", ""]
    lines = [line.strip() for line in as_text(more, "rad").splitlines()]
    at = next(k for k, line in enumerate(lines) if line.startswith("with offset"))
    assert [line.partition("   ")[0] for line in lines[at : at + 3]] == [
        "with offset",
        "-0.125 V",
        "and delay 30.5 ms",
    ]
    assert percent(common.holdout_nrmse) in lines[at]


def test_an_offset_of_a_speed_is_told_in_its_unit_too(found):
    more = replace(found, output="velocity", baseline=replace(found.baseline, common=COMMON))
    assert cells(figures(more, "rad/s"))["offset of y [rad/s]"] == ["", "-2", ""]
    assert "(-2 rad/s of y)" in as_text(more, "rad/s")
    lost = replace(more, baseline=replace(found.baseline, common=replace(COMMON, offset=np.nan)))
    assert cells(figures(lost, "rad/s"))["offset of u [V]"] == ["", "-", ""]


def test_an_offset_or_delay_that_is_next_to_nothing_is_0(found):
    common = replace(COMMON, offset=-1e-6, delay=1e-8)
    rows = cells(figures(replace(found, baseline=replace(found.baseline, common=common)), "rad"))
    assert (rows["offset of u [V]"][1], rows["delay [ms]"][1]) == ("0", "0")


def test_one_model_with_offset_and_delay_has_a_column_for_each():
    clean = example(found=False)
    clean = replace(clean, baseline=replace(clean.baseline, common=COMMON))
    assert {len(row) for row in cells(figures(clean, "rad")).values()} == {2}
    assert "with offset and delay" not in figures(example(found=False), "rad")


def test_a_first_order_lag_is_not_given_a_zeta(found):
    score = replace(found.extended, omega_n=100.0, zeta=20.0, sd={"zeta": 700.0, "omega_n": 3500.0})
    told = " ".join(consequences(replace(found, extended=score)))
    assert "omega_n / (2 zeta) 1900 % too high (50 instead of 2.5)" in told
    assert "Of the extended model only omega_n / (2 zeta) is told" in told
    assert "zeta 5" not in told
    unsure = replace(score, zeta=0.5)
    assert "only omega_n" not in " ".join(consequences(replace(found, extended=unsure)))


def test_defects_of_a_record_leave_the_plant_as_it_is(found):
    same = replace(found, extended=replace(found.baseline, effects=FRICTION))
    assert not any("Without them" in each for each in consequences(same))


def test_each_cause_is_told_in_a_sentence(found):
    told = list(consequences(found))
    assert sum(each.startswith("coulomb_friction: Seals or bearings rub") for each in told) == 1


def test_friction_that_gives_way_says_by_how_much(found):
    bristles = {"coulomb_friction": {"level": 400.0}, "lugre_friction": {"stiffness": 1e5, "damping": 150.0}}
    told = " ".join(consequences(replace(found, extended=replace(found.extended, effects=bristles))))
    assert "gives way by 0.004 " in told
    assert not any("gives way" in each for each in consequences(found))


def test_the_terminal_gets_the_same(found):
    text = as_text(found, "rad")
    for each in ("coulomb_friction", "250.0 ± 5.0 rad/s^2", "0.4", "! Next experiment", "seod simulate x"):
        assert each in text
    low, high = (100.0 * end for end in found.baseline.holdout_ci95)
    assert f"[{low:.3g}, {high:.3g}]" in text
    json.dumps(found.as_json(), allow_nan=False)


def test_the_only_cause_has_all_of_the_share(found):
    assert found.share(found.effects[0]) == pytest.approx(1.0, abs=0.01)


def test_a_share_is_of_the_movement_where_the_baseline_errs_by_more(found):
    far, floor = replace(found.baseline, holdout_nrmse=40.0), found.noise_floor_nrmse
    gain = Gain(math.sqrt(0.21 + 0.25), 0.5)
    effect = replace(found.effects[0], gain=gain)
    assert replace(found, baseline=far).share(effect) == pytest.approx(0.21 / (1.0 - floor**2))


def test_numbers_by_a_held_out_recording_stand_beside_those_that_are_told(found):
    there = {"level": Parameter(300.0, "unit/s^2", (290.0, 310.0))}
    again = replace(found, effects=(replace(found.effects[0], holdout=(there, {})),))
    assert "held out" not in as_text(found, "rad")
    text = as_text(again, "rad")
    assert "held out 2" in text
    assert "300 ± 10 rad/s^2" in text
    page = effects(again, "rad")
    assert "fitted to the held-out recording" in page
    assert "level = 300 ± 10 rad/s^2" in page
    assert "fitted to" not in effects(found, "rad")


@pytest.mark.slow
def test_a_simulation_that_left_the_recording_is_not_drawn_over_it(found):
    gone = replace(found, baseline=replace(found.baseline, diverged=True))
    html = page(gone, "rad", ["a.csv"])
    assert "leaves the recording" in html
    assert "error of the baseline" not in next(p for p in pictures(html) if "in one simulation" in p)


@pytest.mark.slow
def test_a_command_that_repeats_itself_shows_harmonics_and_phase(found):
    """Errors of odd and even harmonics, of 3 and 1 % of the measurement's fundamental."""
    turn = 2.0 * np.pi * np.arange(2000) / 125.0
    error = 0.03 * np.sin(3.0 * turn) + 0.01 * np.sin(2.0 * turn)
    y = np.sin(turn)
    windows = [
        replace(w, u=np.sign(y), y=y, y_baseline=y - error, y_extended=y - 0.1 * error) for w in found.windows
    ]
    html = page(replace(found, windows=tuple(windows)), "rad", ["a.csv"])
    assert html.count("<svg") == 15
    assert "baseline: odd 3 %, even 1 %" in html
    assert "extended: odd 0.3 %, even 0.1 %" in html


def test_two_voltages_are_two_points_with_bars():
    found = Binned(*(np.array([x, y]) for x, y in ((-0.5, 0.5), (1.0, 2.0), (0.0, 1.0), (2.0, 3.0))))
    points, bars = _band(found, "baseline", AFTER)
    assert points.dots
    np.testing.assert_array_equal(bars.y, [0.0, 2.0, np.nan, 1.0, 3.0, np.nan])


def test_a_dense_line_keeps_its_extremes():
    y = np.random.default_rng(2).normal(size=100_000)
    y[54_321] = 99.0
    x, thin = thinned(np.arange(100_000.0), y)
    assert len(thin) <= 1400
    assert (thin.max(), thin.min()) == (99.0, y.min())
    assert np.all(np.diff(x) > 0)


def test_a_gap_breaks_the_line_but_not_the_picture():
    y = np.array([1.0, 2.0, np.nan, 3.0, 4.0])
    x = np.arange(5.0)
    picture = Chart("a<b", "x", "y", [Curve(x, y, colour="#123456"), Curve(x, y - 1, to=y + 1)]).svg()
    assert "nan" not in picture
    assert ">a&lt;b</text>" in picture
    (path,) = re.findall(r'<path d="([^"]*)"[^>]*stroke: #123456', picture)
    assert path.count("M") == 2


LONG = "extended: odd 0.3 %, even 0.1 %, and whatever else there may be to say of it"


def extents(figure):
    """Edges of the picture, and of each of its texts: left, right, bottom, top [pixels]."""
    figure.draw_without_rendering()
    axes = figure.axes[0]
    texts = [axes._left_title, axes.xaxis.label, axes.yaxis.label, *axes.get_legend().get_texts()]
    boxes = [each.get_window_extent() for each in texts if each.get_text()]
    return figure.bbox, boxes


def test_no_text_is_wider_than_its_picture_nor_over_another():
    x = np.arange(5.0)
    title = "Distortion: symmetric causes make odd harmonics, others even ones, in whatever order"
    chart = Chart(title, "x", "y", [Curve(x, x, each) for each in ("measured", LONG[:40], LONG[:50])])
    with style():
        figure = chart.figure()
        page_, boxes = extents(figure)
    assert len(boxes) == 6
    assert " ".join(wrapped(title, chart.width)) == title
    for box in boxes:
        assert page_.x0 <= box.x0 < box.x1 <= page_.x1
        assert page_.y0 <= box.y0 < box.y1 <= page_.y1
    for k, box in enumerate(boxes):
        assert not any(box.overlaps(other) for other in boxes[:k])
    assert figure.get_figheight() * 96.0 > chart.height


def test_a_short_title_takes_no_room_from_its_picture():
    x = np.arange(5.0)
    short = Chart("short", "x", "y", [Curve(x, x, "measured")])
    assert (short.figure().get_size_inches() * 96.0).tolist() == pytest.approx([460.0, 250.0])
    assert wrapped("short", 460.0) == ["short"]


def test_ink_follows_the_page_so_that_a_dark_one_can_be_read():
    x = np.arange(5.0)
    picture = Chart("t", "x", "y", [Curve(x, x, "measured"), Curve(x, -x, "baseline", BEFORE)]).svg()
    assert MEASURED not in picture
    assert "currentColor" in picture
    assert BEFORE in picture
    assert picture == Chart("t", "x", "y", [Curve(x, x, "measured"), Curve(x, -x, "baseline", BEFORE)]).svg()


@pytest.mark.slow
def test_a_narrow_page_scrolls_what_is_wide(html):
    assert 'name="viewport" content="width=device-width' in html
    assert html.count('<div class="scroll"><table') == html.count("<table") == 3
    wide = [each for each in pictures(html) if float(re.search(r'viewBox="0 0 ([0-9.]+)', each)[1]) > 600.0]
    assert html.count('<div class="scroll wide"><svg') == len(wide) == 3


@pytest.mark.slow
def test_the_page_says_what_it_was_made_of(found):
    recording = recorded(np.arange(1500) / 500.0)
    command = "seod diagnose 'a <b>.csv' --units y=mm"
    told = page(found, "m", ["a.csv"], facts([recording], command))
    assert re.search(r"<dd>\d{4}-\d\d-\d\d \d\d:\d\d UTC by seod \d", told)
    assert "<dd>seod diagnose &#x27;a &lt;b&gt;.csv&#x27; --units y=mm</dd>" in told
    assert "<dd>a.csv: 2.998 s at 500 Hz, 1500 rows</dd>" in told
    assert "<dl>" not in page(found, "m", ["a.csv"])


def recorded(t):
    none = {"t_u": None, "ps": None, "temperature": None, "names": {}, "units": {}, "problems": ()}
    return Recording((Path("a.csv"),), t, t, t, rows=np.arange(len(t)), **none)


@pytest.mark.parametrize(
    ("unit", "output", "told"),
    [
        ("mm", "position", ("mm", "mm", "mm/s", "mm/s^2", "mm/s/V", "mm/s^3")),
        ("rad/s", "velocity", ("rad/s", "rad", "rad/s", "rad/s^2", "rad/s/V", "rad/s^3")),
        ("mm", "velocity", ("mm", "mm·s", "mm", "mm/s", "mm/V", "mm/s^2")),
        ("m/s^2", "velocity", ("m/s^2", "m/s^2·s", "m/s^2", "m/s^3", "m/s^2/V", "m/s^4")),
    ],
)
def test_units_follow_that_of_y(unit, output, told):
    units = Units.of(unit, output)
    assert (units.reading, units.position, units.speed, units.acceleration, units.gain) == told[:5]
    of_table = ("unit (unit/s for a speed)", "unit", "unit/s", "unit/s^2", "1", "V")
    assert tuple(map(units.named, of_table)) == (*told[:4], "", "V")
    assert units.named("unit/s^3") == told[5]
    assert units.named("unit/s^2 for each unit of f") == f"{units.acceleration} for each unit of f"


@pytest.mark.slow
def test_nothing_is_in_nobodys_unit_where_one_is_known(found):
    bristles = {"coulomb_friction": {"level": 400.0}, "lugre_friction": {"stiffness": 1e5, "damping": 150.0}}
    more = replace(found, extended=replace(found.extended, effects=bristles))
    for told in (page(more, "mm", ["a.csv"]), as_text(more, "mm")):
        assert not re.search(r"\bunit\b", re.sub("<style>.*</style>", "", told))
    assert "gives way by 0.004 mm " in as_text(more, "mm")
    assert "[mm/s/V]" in as_text(more, "mm")


def test_a_load_that_drifts_is_told_in_the_unit_of_y(found):
    remark = DRIFTS.format(rate="0.2", without="9", with_it="3")
    drifts = replace(found, remarks=(remark,))
    for unit, rate in (("mm", "0.2 mm/s^3 from"), ("unit", "0.2 unit/s^3 from")):
        told = list(consequences(drifts, unit))
        assert rate in told[-1]
        assert rate in as_text(drifts, unit)
    assert remark in drifts.as_json()["remarks"]


@pytest.mark.slow
def test_a_load_is_under_pressure_only_where_a_supply_pressure_was_recorded(found):
    assert "load pressure" not in page(found, "m", ["a.csv"])
    supplied = tuple(replace(w, ps=np.full(len(w.t), 7e6)) for w in found.windows)
    assert "load pressure, as acceleration [m/s^2]" in page(replace(found, windows=supplied), "m", ["a.csv"])


def test_a_map_leaves_empty_places_empty():
    values = np.array([[1.0, np.nan], [-1.0, 0.0]])
    figure = Map("t", "x", "y", np.arange(3.0), np.arange(3.0), values, 1.0).figure()
    (mesh,) = figure.axes[0].collections
    assert mesh.get_array().mask.ravel().tolist() == [False, True, False, False]
    assert mesh.get_clim() == (-1.0, 1.0)
