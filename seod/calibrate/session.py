"""One axis of a running daemon, as the calibration drives it over TCP."""

from __future__ import annotations

import math
from collections import deque
from typing import TYPE_CHECKING, Any, TypeVar

from seod.calibrate.procedure import CalibrationError
from seod.calibrate.recording import recording

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from seod.calibrate.recording import Recording
    from seod.client import Client

T = TypeVar("T")

REST_S = 0.25
"""Idle time after a drive, so that no movement of one is left in the next."""
SILENCE_S = 15.0
"""A drive must be over, hold included, this long after its voltage."""
ALIVE_S = 0.2
"""So often the rig is told that somebody is there, for `guard.dead_man`."""
REST_ROWS = 400
MAX_TRIES = 3


class RemoteRig:
    """See `seod.calibrate.procedure.Rig`.

    Args:
        client: A connection that may command and that nobody else uses meanwhile.
        axis: Name of the axis; it must be idle.
    """

    def __init__(self, client: Client, axis: str) -> None:
        self.client = client
        self.axis = axis
        self.polarity: dict[str, Any] | None = None
        """The guard's `polarity` event; None while it has not pulsed."""
        self._alive = -math.inf
        self._lost = 0
        """Messages that the daemon could not send, for this end did not read."""
        self._subscription = client.subscribe(["sample", "event"], [axis])
        self._newest = self._first()
        self._rest: deque[dict[str, Any]] = deque([self._newest], maxlen=REST_ROWS)

    def close(self) -> None:
        """Hear no more of it: who is not read meanwhile is sent old samples later, and none of the newest."""
        self.client.unsubscribe(self._subscription)
        self.client.forget()

    def _first(self) -> dict[str, Any]:
        for sample in self._samples(SILENCE_S):
            return sample
        raise CalibrationError(f"no samples of {self.axis} within {SILENCE_S:g} s")

    def position(self) -> float:
        """Newest reading [axis unit]."""
        return float(self._newest["y"])

    def gain(self) -> float:
        """K_L in force [axis unit/s/V].

        Raises:
            CalibrationError: It is not known: the sensor of the supply pressure is silent.
        """
        K_L = self._newest["K_L"]
        if K_L is None:
            raise CalibrationError(f"K_L of {self.axis} is not known: is the supply pressure measured?")
        return float(K_L)

    def bias(self) -> float:
        """The bias in force [V]."""
        return float(self.client.get(self.axis)["settings"]["bias"])

    def set_bias(self, volts: float) -> None:
        """Change the bias [V]."""
        self.client.set(self.axis, bias=volts)

    def drive(self, volts: float, duration: float, stay: bool = False) -> Recording:
        """Drive and come back idle; once more where the stream had a gap just then.

        Raises:
            CalibrationError: The guard stopped it, or it does not end.
        """
        return self._tried(recording, volts, duration, stay, None)

    def excite(self, volts: float, duration: float, tones: Sequence[Sequence[float]]) -> list[dict[str, Any]]:
        """Put out tones, [Hz, V, rad] each, their sum at most `volts` [V]; the samples while they were on.

        Raises:
            CalibrationError: The guard stopped it, or it does not end.
        """
        return self._tried(lambda _, kept: list(kept), volts, duration, False, tones)

    def _tried(
        self,
        make: Callable[[Sequence[dict[str, Any]], Sequence[dict[str, Any]]], T],
        volts: float,
        duration: float,
        stay: bool,
        tones: Sequence[Sequence[float]] | None,
    ) -> T:
        why = ""
        for _ in range(MAX_TRIES):
            self.client.drive(self.axis, volts, duration, stay, tones)
            try:
                return make(*self._record(duration))
            except ValueError as error:
                why = str(error)
        raise CalibrationError(f"{MAX_TRIES} drives of {volts:+.3g} could not be recorded: {why}")

    def _record(self, duration: float) -> tuple[Sequence[dict[str, Any]], Sequence[dict[str, Any]]]:
        """Samples of the rest before a drive, and of the drive."""
        kept: list[dict[str, Any]] = []
        rest = deque(self._rest, maxlen=REST_ROWS)
        moved, idle_since, self._lost, over = False, None, 0, self._newest["t"] + duration
        for sample in self._samples(duration + SILENCE_S):
            state = sample["state"]
            if state == "exciting":
                kept.append(sample)
            elif not kept and state == "idle":
                rest.append(sample)
            if state != "idle":
                self._rest.clear()
            moved |= state not in ("idle", "fault") or (sample["t"] > over and self._moved_unseen())
            if state == "fault" and moved:
                raise CalibrationError(self._fault())
            if state == "idle" and moved:
                idle_since = idle_since or sample["t"]
                self._rest.append(sample)
                if sample["t"] - idle_since >= REST_S:
                    return self._whole(rest, kept)
        raise CalibrationError(f"{self.axis} did not come to rest within {duration + SILENCE_S:g} s")

    def _moved_unseen(self) -> bool:
        return self._lost > 0 and self.client.get(self.axis)["state"] in ("idle", "fault")

    def _whole(
        self, rest: Sequence[dict[str, Any]], kept: Sequence[dict[str, Any]]
    ) -> tuple[Sequence[dict[str, Any]], Sequence[dict[str, Any]]]:
        if self._lost:
            raise ValueError(f"{self._lost} samples were lost, for they were not taken in time")
        return rest, kept

    def _samples(self, timeout: float) -> Iterator[dict[str, Any]]:
        for message in self.client.notifications(timeout):
            params = message["params"]
            if message["method"] == "sample":
                self._newest = params
                if params["t"] - self._alive >= ALIVE_S:
                    self._alive = params["t"]
                    self.client.keepalive()
                yield params
            elif message["method"] == "lost":
                self._lost += params["lost"]
            elif message["method"] == "event" and params["event"] == "polarity":
                self.polarity = params
            elif message["method"] == "event" and params["event"] == "fault":
                raise CalibrationError(params["why"])

    def _fault(self) -> str:
        fault = self.client.get(self.axis)["fault"]
        return str(fault["why"]) if fault else f"{self.axis} is in fault"
