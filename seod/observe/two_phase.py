"""Chooses the second phase of one axis' relay from its estimates, and puts an identified K_L in force."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

from seod.config.gain_in_force import is_identified
from seod.estimate.plant.free_motion import Dynamics
from seod.estimate.two_phase.relay_run import Drive
from seod.estimate.two_phase.second_phase import HEADROOM, Choice, Reach, Seen, choose

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from seod.estimate.base import Estimate
    from seod.observe.estimation import Axis

MOVED: Final = 0.1
"""Relative change of omega_n or zeta after which the choice is made anew."""
SHARPER: Final = 0.5
"""Likewise where the limits had shortened the lateness, and the deviation of zeta is down to this part."""
FOUND: Final = 0.01
"""Relative deviation of K_L with which it is put in force."""
OTHER: Final = 0.005
"""Relative difference from the K_L in force, and in deviations of it (`SURE`), that is worth a change."""
SURE: Final = 2.0


class TwoPhase:
    """Looks at each estimate of an axis.

    Args:
        axis: The axis.
        post: Sends the loop a command: its name and values.
        warn: Takes a code and a sentence for the clients.
    """

    def __init__(
        self, axis: Axis, post: Callable[[str, dict[str, float]], None], warn: Callable[[str, str], None]
    ) -> None:
        self.axis, self.post, self.warn = axis, post, warn
        self.plan = axis.config.excitation.two_phase
        self.begin()

    def begin(self) -> None:
        """The axis starts, or its settings have changed: nothing is known."""
        self.basis: Estimate | None = None
        self.choice: Choice | None = None
        self.longest = self.plan.shift

    def heard(self, event: dict[str, Any]) -> None:
        """An event of the axis, or the start of a loop."""
        kind = event["event"]
        if kind == "two_phase":
            self._told(event)
        elif kind == "started":
            self.axis.second_phase = None
            self.begin()
        elif kind == "fault" or (kind == "state" and event["state"] == "armed") or _is_other(event):
            self.begin()

    def _told(self, event: dict[str, Any]) -> None:
        """The loop has taken a second phase, or given it up."""
        self.axis.second_phase = event["phase"]
        if event["phase"] is None:
            swung, choice = event["code"] == "swing", self.choice
            self.begin()
            if swung and choice is not None:
                self.longest = 0.5 * choice.shift

    def consider(self, estimate: Estimate, reference: float) -> None:
        """Take an estimate made while the set point is `reference` [axis unit]."""
        axis = self.axis
        if axis.state != "exciting" or estimate.quality != "ok" or estimate.method != "wave":
            return
        if is_identified(axis.config.K_L):
            self._put_in_force(estimate)
        if axis.settings["two_phase"] and self._is_news(estimate):
            self._choose(estimate, reference)

    def _is_news(self, estimate: Estimate) -> bool:
        """Whether the choice has to be made, or made anew."""
        basis = self.basis
        if basis is None:
            return True
        zeta, before = estimate.zeta or 0.0, basis.zeta or 1.0
        omega_n, omega_before = estimate.omega_n or 0.0, basis.omega_n or 1.0
        if abs(omega_n / omega_before - 1.0) > MOVED or abs(zeta / before - 1.0) > MOVED:
            return True
        shortened = self.choice is None or self.choice.shift < self.longest
        return shortened and (estimate.zeta_sd or math.inf) < SHARPER * (basis.zeta_sd or 0.0)

    def _choose(self, estimate: Estimate, reference: float) -> None:
        if self.longest < 0.03 or None in (estimate.zeta, estimate.omega_n, estimate.K_L):
            return
        first = self.basis is None
        self.basis = estimate
        found = choose(
            self._seen(estimate),
            self._drive(estimate),
            self._limits(reference),
            self.plan.cycles,
            self.longest,
        )
        if isinstance(found, str):
            self.choice = None
            if first or self.axis.second_phase is not None:
                self.warn("two_phase", f"the first phase goes on alone: with both, {found}")
            return
        self.choice = found
        values = {"late": found.late, "cycles": self.plan.cycles, "period": found.period}
        swing = min(HEADROOM * found.reach.swing, self.axis.config.limits.amplitude)
        self.post("second_phase", {**values, "e_a": self.axis.settings["e_a"], "swing": swing})

    def _seen(self, estimate: Estimate) -> Seen:
        """What the estimate says; its amplitude is the first phase's only while there is no other."""
        plant = Dynamics(estimate.omega_n or 0.0, estimate.zeta or 0.0, estimate.delay_s or 0.0)
        swing = 0.0 if self.axis.second_phase else estimate.amplitude or 0.0
        return Seen(plant, estimate.zeta_sd or 0.0, estimate.K_L or 0.0, swing)

    def _drive(self, estimate: Estimate) -> Drive:
        settings = self.axis.settings
        load = 2.0 * (estimate.asymmetry or 0.0) * settings["e_a"]
        return Drive(settings["e_a"], settings["hysteresis"], load, self.axis.period_s)

    def _limits(self, reference: float) -> Reach:
        """How far the axis may go, from its set point."""
        limits = self.axis.config.limits
        low, high = limits.travel
        room = min(high - reference, reference - low)
        if self.axis.config.mode == "velocity":
            return Reach(limits.amplitude, math.inf, room, limits.growth)
        return Reach(limits.amplitude, room, limits.speed or math.inf, limits.growth)

    def _put_in_force(self, estimate: Estimate) -> None:
        """Where K_L is identified, and another than the one in force."""
        K_L, sd, now = estimate.K_L or 0.0, estimate.K_L_sd or math.inf, self.axis.settings["K_L"]
        if sd < FOUND * K_L and abs(K_L - now) > max(OTHER * now, SURE * sd):
            self.post("set", {"K_L": K_L})


def _is_other(event: dict[str, Any]) -> bool:
    """Whether an event tells of settings under which the choice is another."""
    return event["event"] == "changed" and bool(event["values"].keys() - {"K_L", "trim"})


class TwoPhases:
    """That of all axes of a rig.

    Args:
        axes: By name, in the order of the rig file.
        send: Sends the loop a command: its name, the number of the axis, values.
        warn: Takes a code, a sentence and the axis' name for the clients.
    """

    def __init__(
        self,
        axes: Mapping[str, Axis],
        send: Callable[[str, int, dict[str, Any]], None],
        warn: Callable[[str, str, str | None], None],
    ) -> None:
        def make(number: int, axis: Axis) -> TwoPhase:
            return TwoPhase(
                axis,
                lambda op, values: send(op, number, values),
                lambda code, why: warn(code, f"{axis.name}: {why}", axis.name),
            )

        self._of = {name: make(number, axis) for number, (name, axis) in enumerate(axes.items())}

    def heard(self, event: dict[str, Any]) -> None:
        """Take an event of the loop; one without an axis is for all."""
        name = event.get("axis")
        for two_phase in [self._of[name]] if name else self._of.values():
            two_phase.heard(event)

    def consider(self, axis: str, estimate: Estimate, reference: float) -> None:
        """Take an estimate of an axis, made while its set point is `reference` [axis unit]."""
        self._of[axis].consider(estimate, reference)
