"""Latencies: percentiles, LinuxCNC's bands, the histogram, what to change, and one short measurement."""

from __future__ import annotations

import json
import subprocess
import sys
from collections import Counter
from typing import TYPE_CHECKING

import pytest

from seod.latency import measure
from seod.latency.machine import Machine, read_machine
from seod.latency.measure import MeasureError, make_loop, run_cyclictest
from seod.latency.report import Latencies, Report, band, count_seconds, histogram, parse_cyclictest
from seod.loop.pacer import TimerPacer
from seod.processes.ring import AxisState

if TYPE_CHECKING:
    from pathlib import Path

CYCLICTEST = """# /dev/cpu_dma_latency set to 0us
# Histogram
000000 000000
000001 000003
000002 000096
# Total: 000000099
# Max Latencies: 00812
# Histogram Overflows: 00001
# Thread 0: 00044
"""

TUNED = Machine("6.1-rt", "a processor", 4, False, True, ("performance",) * 4, "2-3", -1, 1_000_000)


def of(**counts: int) -> Latencies:
    return Latencies("x", Counter({int(us[1:]): n for us, n in counts.items()}))


def test_percentiles_count_wake_ups_not_bins() -> None:
    latencies = of(_3=980, _15=15, _64=4, _900=1)
    assert [latencies.quantile(f) for f in (0.5, 0.98, 0.99, 0.999, 1.0)] == [3, 3, 15, 64, 900]
    assert (latencies.total, latencies.worst) == (1000, 900)
    assert latencies.late(500.0) == 1
    assert latencies.late(64.0) == 5


def test_nothing_measured_is_no_error() -> None:
    assert (Latencies("x").worst, Latencies("x").quantile(0.5)) == (0, 0)
    assert histogram(Latencies("a"), Latencies("b")).count("\n") <= 1


def test_seconds_are_rounded_down_and_never_negative() -> None:
    assert count_seconds("x", [3.99e-6, 3.01e-6, -1e-7, 1.5e-3]).counts == {3: 2, 0: 1, 1500: 1}


def test_sums_keep_all_wake_ups() -> None:
    assert (of(_3=2, _7=1) + of(_3=1)).counts == {3: 3, 7: 1}


def test_cyclictest_output_with_what_lies_beyond_its_histogram() -> None:
    assert parse_cyclictest(CYCLICTEST).counts == {1: 3, 2: 96, 812: 1}
    with pytest.raises(ValueError, match="no histogram"):
        parse_cyclictest("Unable to change scheduling policy!")


@pytest.mark.parametrize(
    ("worst", "verdict"),
    [
        *((us, "very good") for us in (0, 19)),
        *((us, "good") for us in (20, 49)),
        *((us, "acceptable") for us in (50, 499)),
        *((us, "not good enough") for us in (500, 10**6)),
    ],
)
def test_bands(worst: int, verdict: str) -> None:
    assert band(worst)[0] == verdict


def test_histogram_shows_a_single_late_tick_and_empty_octaves() -> None:
    lines = histogram(of(_0=5, _3=1000), of(_3=999, _9=1)).splitlines()[1:]
    assert [line.split()[:3] for line in lines] == [[a, "-", b] for a, b in ("01", "12", "24", "48")] + [
        ["8", "-", "16"]
    ]
    assert lines[2].split()[3::2] == ["1000", "999"]
    assert lines[3].split()[3:] == ["0", "0"]
    assert lines[4].split()[3:] == ["0", "1", "##"]
    assert len(lines[2]) <= 100


def test_a_tuned_machine_needs_only_the_right_processor() -> None:
    (advice,) = TUNED.advice()
    assert "`loop: {cpu: 2}`" in advice


def test_each_shortcoming_comes_with_its_command() -> None:
    poor = Machine("6.1", "a processor", 2, True, False, ("powersave", "performance"), "", 950_000, 1_000_000)
    advice = " ".join(poor.advice())
    for words in (
        "virtual machine",
        "linux-image-rt-amd64",
        "isolcpus=1 ",
        "governor is powersave:",
        "scaling_governor",
        "used 95 % of a second",
        "sysctl -w kernel.sched_rt_runtime_us=-1",
    ):
        assert words in advice
    alone = Machine("6.1", "a processor", 1, False, True, (), "", None, None)
    assert alone.advice() == []


def test_the_machine_is_read_from_the_kernel_s_files(tmp_path: Path) -> None:
    files = {
        "proc/cpuinfo": "processor\t: 0\nmodel name\t: Some CPU\nflags\t: fpu hypervisor\n\nprocessor\t: 1\n",
        "proc/sys/kernel/osrelease": "6.1.0-rt\n",
        "proc/sys/kernel/sched_rt_runtime_us": "-1\n",
        "proc/sys/kernel/sched_rt_period_us": "1000000\n",
        "sys/kernel/realtime": "1\n",
        "sys/devices/system/cpu/isolated": "1\n",
        "sys/devices/system/cpu/cpu0/cpufreq/scaling_governor": "powersave\n",
    }
    for name, text in files.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    assert read_machine(tmp_path) == Machine(
        "6.1.0-rt", "Some CPU", 2, True, True, ("powersave",), "1", -1, 1_000_000
    )
    nothing = read_machine(tmp_path / "nowhere")
    assert (nothing.kernel, nothing.cpus, nothing.preempt_rt, nothing.rt_runtime_us) == (
        "unknown",
        1,
        False,
        None,
    )


def test_the_report_judges_by_the_worst_and_passes_refusals_on() -> None:
    report = Report(
        of(_3=99, _30=1), of(_3=99, _600=1), 2000.0, ["SCHED_FIFO refused: ..."], TUNED, "no rt-tests"
    )
    text = report.as_text()
    assert "the machine is good and the loop not good enough" in text
    assert "1 of 100 ticks began more than a period (500 us) late" in text
    assert "no rt-tests" in text
    assert text.index("- SCHED_FIFO refused") < text.index("- Processors 2-3")
    answer = json.loads(json.dumps(report.as_json()))
    assert answer["verdict"] == {"machine": "good", "loop": "not good enough"}
    assert answer["loop"]["counts"] == [[3, 99], [600, 1]]
    assert (answer["late_ticks"], answer["realtime"]["ok"]) == (1, False)


def test_no_cyclictest_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(measure.shutil, "which", lambda _: None)
    with pytest.raises(MeasureError, match="apt-get install rt-tests"):
        run_cyclictest(0.1, 2000.0)


def test_a_refused_cyclictest_gives_its_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(measure.shutil, "which", lambda _: "/usr/bin/false")
    with pytest.raises(MeasureError, match="cyclictest failed"):
        run_cyclictest(0.1, 2000.0)


@pytest.mark.parametrize("axes", [1, 3])
def test_the_built_in_rig_is_excited_from_the_first_tick(axes: int) -> None:
    loop = make_loop(axes)
    assert isinstance(loop.pacer, TimerPacer)
    start = loop.pacer.now()
    for k in range(20):
        loop.pacer.lateness = 0.0
        loop.tick(start + k * 5e-4)
    assert [axis.course.state for axis in loop.axes] == [AxisState.EXCITING] * axes
    loop.driver.close()
    loop.shared.close()


@pytest.mark.processes
def test_a_short_measurement() -> None:
    command = [sys.executable, "-m", "seod.cli", "latency", "--for", "1", "--json"]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60)
    answer = json.loads(done.stdout)
    assert answer["loop"]["samples"] > 100
    assert answer["machine"]["samples"] > 100
    assert answer["machine"]["source"] in {"cyclictest", "bare loop"}
    assert (answer["note"] is None) == (answer["machine"]["source"] == "cyclictest")
    assert 0 <= answer["loop"]["p50_us"] <= answer["loop"]["p99_us"] <= answer["loop"]["max_us"]
