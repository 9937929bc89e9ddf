"""`/metrics`: what Prometheus may know of the rig. Names, units and meanings: docs/metrics.md."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from prometheus_client.core import (
    CounterMetricFamily,
    GaugeMetricFamily,
    HistogramMetricFamily,
    InfoMetricFamily,
    StateSetMetricFamily,
)
from prometheus_client.registry import Collector

from seod import __version__
from seod.estimate.base import QUALITIES
from seod.panel.disk import disk_of
from seod.processes.ring import AxisState, Word, bin_edges_us

if TYPE_CHECKING:
    from collections.abc import Iterator

    from prometheus_client import Metric

    from seod.panel.panel import Panel

ESTIMATES: Final = {
    "zeta": ("seod_zeta", "Damping ratio"),
    "zeta_sd": ("seod_zeta_sd", "Standard deviation of zeta"),
    "omega_n": ("seod_omega_n_radians_per_second", "Undamped natural frequency"),
    "omega_n_sd": ("seod_omega_n_sd_radians_per_second", "Standard deviation of omega_n"),
    "K_L": ("seod_gain", "Gain K_L in force or estimated, in SI units of the axis"),
    "K_L_sd": ("seod_gain_sd", "Standard deviation of K_L, where it is estimated"),
    "frequency": ("seod_limit_cycle_radians_per_second", "Frequency of the limit cycle"),
    "amplitude": ("seod_limit_cycle_amplitude", "Amplitude of the relay's input, in SI units of the axis"),
    "ps": ("seod_supply_pressure_pascals", "Supply pressure"),
    "temperature": ("seod_temperature_kelvin", "Temperature of the oil"),
}
"""Fields of an estimate, as gauges of each axis."""
CLIENTS: Final = {
    "connected": ("seod_clients", "Clients of the gateway with a seat"),
    "waiting": ("seod_clients_waiting", "Connections without a seat"),
}


class RigCollector(Collector):
    """Collects from the panel as it is asked.

    Args:
        panel: Knows the newest of everything.
    """

    def __init__(self, panel: Panel) -> None:
        self._panel = panel

    def collect(self) -> Iterator[Metric]:
        """All of them."""
        yield from self._rig()
        yield from self._axes()
        yield from self._estimates()
        yield from self._models()
        yield from self._loop()
        yield from self._lateness()
        yield from self._clients()
        yield from self._recorder()

    def _rig(self) -> Iterator[Metric]:
        config = self._panel.config
        about = InfoMetricFamily("seod", "Of the daemon")
        simulated = str(config.simulation is not None).lower()
        about.add_metric([], {"version": __version__, "rig": config.rig, "simulated": simulated})
        yield about
        yield _gauge("seod_rows_age_seconds", "Time since the loop's newest row", self._panel.rows_age_s)
        yield _gauge("seod_gateway_up", "Whether the panel reaches the gateway", self._panel.house.connected)
        yield _gauge("seod_pages", "Pages of the panel that are open", len(self._panel.pages))

    def _axes(self) -> Iterator[Metric]:
        states = StateSetMetricFamily("seod_state", "State of an axis", labels=["axis"])
        faults = GaugeMetricFamily("seod_fault", "1 while an axis is in fault", labels=["axis", "code"])
        for name, history in self._panel.histories.items():
            states.add_metric([name], {each.name.lower(): each == history.state for each in AxisState})
            fault = self._panel.house.faults.get(name)
            if fault is not None:
                faults.add_metric([name, fault["code"]], 1.0)
        yield states
        yield faults

    def _estimates(self) -> Iterator[Metric]:
        newest = self._panel.house.estimates
        for field, (name, what) in ESTIMATES.items():
            gauge = GaugeMetricFamily(name, what, labels=["axis"])
            for axis, estimate in newest.items():
                if estimate[field] is not None:
                    gauge.add_metric([axis], estimate[field])
            yield gauge
        qualities = StateSetMetricFamily("seod_quality", "Quality of the newest estimate", labels=["axis"])
        for axis, estimate in newest.items():
            qualities.add_metric([axis], {each: each == estimate["quality"] for each in QUALITIES})
        yield qualities

    def _models(self) -> Iterator[Metric]:
        error = GaugeMetricFamily(
            "seod_model_error_ratio", "Error of the model over the movement", labels=["axis"]
        )
        left = GaugeMetricFamily("seod_model_left", "1 while a rig has left its model", labels=["axis"])
        for axis, newest in self._panel.house.model_errors.items():
            if newest["nrmse"] is not None:
                error.add_metric([axis], newest["nrmse"])
            left.add_metric([axis], float(newest["left"]))
        yield error
        yield left

    def _loop(self) -> Iterator[Metric]:
        words, health = self._panel.shared.words, self._panel.house.health
        yield _counter("seod_ticks", "Ticks of the loop", words[Word.TICKS])
        yield _counter("seod_overruns", "Ticks that began more than a period late", words[Word.OVERRUNS])
        yield _counter("seod_rows_lost", "Rows that nobody could take in time", health.get("rows_lost", 0))
        yield _counter("seod_events_lost", "Likewise events", health.get("events_lost", 0))
        realtime = health.get("realtime", {}).get("ok", False)
        yield _gauge("seod_realtime", "Whether the loop has its real-time priority", realtime)
        counters = CounterMetricFamily("seod_driver", "The driver's counters: bus, line", labels=["counter"])
        for name, value in health.get("counters", {}).items():
            counters.add_metric([name], value)
        yield counters

    def _lateness(self) -> Iterator[Metric]:
        for name, what, bins in (
            ("seod_lateness_seconds", "Lateness of ticks", self._panel.shared.lateness),
            ("seod_execution_seconds", "Time of ticks, all but waiting", self._panel.shared.execution),
        ):
            histogram = HistogramMetricFamily(name, what)
            histogram.add_metric([], buckets(bins.tolist()), sum_value=None)
            yield histogram

    def _clients(self) -> Iterator[Metric]:
        clients = self._panel.house.health.get("clients", {})
        for field, (name, what) in CLIENTS.items():
            yield _gauge(name, what, clients.get(field, 0))
        turned_away = clients.get("turned_away", 0)
        yield _counter("seod_clients_turned_away", "Connections that were closed without a seat", turned_away)
        dropped = sum(clients.get("dropped", {}).values())
        yield _gauge(
            "seod_notifications_dropped", "Notifications lost by clients that are connected", dropped
        )

    def _recorder(self) -> Iterator[Metric]:
        recorder: dict[str, Any] | None = self._panel.house.health.get("recorder")
        yield _gauge("seod_recording", "Whether something is recorded", recorder is not None)
        told = recorder or {}
        yield _gauge("seod_recorder_error", "Whether the recorder has a problem", bool(told.get("error")))
        yield _counter("seod_recorder_rows", "Rows in the recording", told.get("rows", 0))
        yield _counter("seod_recorder_rows_lost", "Rows that the recorder lost", told.get("lost", 0))
        disk = disk_of(self._panel)
        if disk is not None:
            yield _gauge("seod_disk_free_bytes", "Free on the disk of the recordings", disk.free)
            yield _gauge("seod_disk_size_bytes", "Size of that disk", disk.size)


def buckets(bins: list[int]) -> list[tuple[str, float]]:
    """Cumulated counts by their upper edges [s], as Prometheus has histograms."""
    edges = [*(repr(edge * 1e-6) for edge in bin_edges_us()), "+Inf"]
    out, reached = [], 0
    for edge, count in zip(edges, bins, strict=True):
        reached += count
        out.append((edge, float(reached)))
    return out


def _gauge(name: str, what: str, value: float) -> GaugeMetricFamily:
    return GaugeMetricFamily(name, what, value=float(value))


def _counter(name: str, what: str, value: float) -> CounterMetricFamily:
    return CounterMetricFamily(name, what, value=float(value))
