"""A loop on a virtual rig and simulated time: the unit tests' test bench."""

from __future__ import annotations

from typing import Any

from drivers.virtual import VirtualDriver, VirtualOptions
from seod.config.channels import input_channels, neutral_values, output_channels
from seod.config.model import RigConfig
from seod.loop.pacer import SimulatedPacer
from seod.loop.tick import Loop
from seod.processes.ring import AXIS_FIELDS, AxisState, Shared, Word
from sim.config import SimulationConfig

PERIOD = 5e-4


def merge(base: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    merged = dict(base)
    for key, value in changes.items():
        old = merged.get(key)
        merged[key] = merge(old, value) if isinstance(value, dict) and isinstance(old, dict) else value
    return merged


RIG: dict[str, Any] = {
    "version": 1,
    "rig": "bench",
    "driver": {"kind": "virtual", "realtime": False},
    "sensors": {"angle": {"channel": "motor.angle", "unit": "rad"}},
    "outputs": {"valve": {"channel": "motor.valve"}},
    "axes": {
        "motor": {
            "sensor": "angle",
            "output": "valve",
            "K_L": 17.0,
            "relay": {"e_a": 0.5},
            "limits": {
                "output": 2.0,
                "travel": (-2.0, 2.0),
                "speed": 200.0,
                "amplitude": 0.6,
                "excitation": 60.0,
            },
            "polarity": {"movement": 0.01},
        }
    },
    "guard": {"rig_watchdog": 0.02},
    "simulation": {
        "plants": {
            "motor": {
                "input": "motor.valve",
                "output": "motor.angle",
                "K_L": 17.0,
                "omega_n": 117.0,
                "zeta": 0.21,
                "noise": 1e-4,
            }
        },
        "constants": {"estop": 1.0},
    },
}


class Bench:
    """Drives a loop by hand and reads what it publishes, as the gateway would."""

    def __init__(self, changes: dict[str, Any] | None = None, rig: dict[str, Any] = RIG) -> None:
        self.config = RigConfig.model_validate(merge(rig, changes or {}))
        self.shared = Shared(len(self.config.axes), 1 << 16)
        self.pacer = SimulatedPacer(1.0 / self.config.loop.rate_hz, self.shared)
        self.pacer.start = 1000.0  # the same numbers in each run
        self.driver = self.make_driver()
        self.driver.open(
            input_channels(self.config), output_channels(self.config), neutral_values(self.config)
        )
        self.driver.start()
        self.fenced = 0
        self.loop = Loop(self.config, self.driver, self.shared, self.pacer, 1, self.on_fence)
        self.events: list[dict[str, Any]] = []
        self.ids = 0

    def make_driver(self) -> VirtualDriver:
        simulation = SimulationConfig.model_validate(self.config.simulation)
        options = VirtualOptions(kind="virtual", realtime=False, simulation=simulation)
        return VirtualDriver(options, self.pacer.now)

    def on_fence(self) -> None:
        self.fenced += 1
        raise SystemExit(3)

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / self.pacer.period)):
            t = self.pacer.next()
            self.loop.tick(t)
            self.loop.meter.note(t, self.pacer, self.loop.samples)
            self.shared.words[Word.CONSUMED] = self.shared.row_ring.head[0]

    def call(self, op: str, axis: int | None = None, **values: Any) -> str | None:
        if op == "estop":
            return self.estop()
        self.ids += 1
        self.shared.commands.put({"id": self.ids, "op": op, "axis": axis, "values": values})
        self.run(self.pacer.period)
        reply = next(e for e in self.take("reply") if e["id"] == self.ids)
        error: str | None = reply["error"]
        return error

    def estop(self) -> str | None:
        """An e-stop by a client; returns what was wrong with it."""
        words = self.shared.words
        words[Word.ESTOPS] += 1
        self.run(self.pacer.period)
        return None if words[Word.ESTOPS_OBEYED] == words[Word.ESTOPS] else "not obeyed"

    def take(self, kind: str | None = None) -> list[dict[str, Any]]:
        self.events += self.shared.events.take()
        return [e for e in self.events if kind is None or e["event"] == kind]

    @property
    def state(self) -> AxisState:
        return self.loop.axes[0].course.state

    @property
    def volts(self) -> float:
        assert self.driver.rig is not None
        return self.driver.rig.state(self.pacer.now())["motor"]["voltage"]

    def rows(self) -> list[dict[str, float]]:
        """New rows with the values of the first axis."""
        return [{"tick": tick, "tick_time": t, **axes[0]} for tick, t, axes in self.axis_rows()]

    def axis_rows(self) -> list[tuple[int, float, list[dict[str, float]]]]:
        """New rows: tick, tick time [s] and the named values of each axis."""
        names = (*AXIS_FIELDS, "state", "flags")
        width = len(names)
        out = []
        for tick, t, *flat in self._new_rows():
            cuts = range(0, width * len(self.loop.axes), width)
            out.append((tick, t, [dict(zip(names, flat[at : at + width], strict=True)) for at in cuts]))
        return out

    def _new_rows(self) -> list[tuple[Any, ...]]:
        ring = self.shared.row_ring
        tail, head = ring.pending()
        ring.tail = head
        offsets = [(entry % ring.slots) * ring.slot_bytes for entry in range(tail, head)]
        return [self.shared.row_struct.unpack_from(ring.data, at) for at in offsets]

    def faults(self) -> list[str]:
        return [e["code"] for e in self.take("fault")]

    def close(self) -> None:
        self.driver.close()
        self.shared.close()


def axis(**changes: Any) -> dict[str, Any]:
    return {"axes": {"motor": changes}}
