"""What a listener knows of all rigs: the newest of each, nothing twice, and what is missing. No sockets."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final, NamedTuple

from seod.fleet.topics import KINDS, NOTHING, Body, Key, decode, key_of, kind_of, split_topic

STALE_S: Final = 30.0
"""A rig that lives and says nothing for this long is stale [s]: three reports of health."""
TREND_POINTS: Final = 120
"""Of a trend: when it is full, every second point goes, and the next ones come half as often."""
MOST_RIGS: Final = 20_000
"""Names that nobody else has checked: beyond that new ones are not taken."""


class Trend:
    """zeta and omega_n since the listener began, in a bounded number of points."""

    def __init__(self) -> None:
        self.points: list[tuple[float, float | None, float | None]] = []
        """UTC [s], zeta, omega_n [rad/s]."""
        self._every, self._waited = 1, 0

    def add(self, at: float, zeta: float | None, omega_n: float | None) -> None:
        """One more estimate."""
        self._waited += 1
        if self._waited < self._every:
            return
        self._waited = 0
        self.points.append((at, zeta, omega_n))
        if len(self.points) >= TREND_POINTS:
            self.points = self.points[1::2]
            self._every *= 2


@dataclass(slots=True, eq=False)
class Rig:
    """One rig.

    Attributes:
        name: In the fleet.
        last: Key of the newest message that was taken.
        birth: What it said of itself; {} before.
        death: The newest; it may be that of an earlier connection.
        state: As in its topic `state`.
        state_key: Key of that.
        estimates: The newest, by axis.
        trends: By axis.
        health: The newest.
        heard: When anything came last [s], of the listener's clock.
    """

    name: str
    last: Key | None = None
    birth: Body = field(default_factory=dict)
    death: Body = field(default_factory=dict)
    state: Body = field(default_factory=dict)
    state_key: Key = NOTHING
    estimates: dict[str, Body] = field(default_factory=dict)
    trends: dict[str, Trend] = field(default_factory=dict)
    health: Body = field(default_factory=dict)
    heard: float = 0.0

    @property
    def alive(self) -> bool | None:
        """Whether it is connected; None before that is known."""
        if not self.birth:
            return None if not self.death else False
        return _life(self.birth) > _life(self.death)

    def standing(self, now: float) -> str:
        """`live`, `stale` (connected, but silent), `dead` (its last will), `ended`, `unknown`."""
        if self.alive is None:
            return "unknown"
        if not self.alive:
            return "ended" if self.death.get("why") == "ended" else "dead"
        return "stale" if now - self.heard > STALE_S else "live"


class Heard(NamedTuple):
    """A message that was taken for the first time."""

    rig: Rig
    suffix: str
    key: Key
    body: Body


@dataclass(slots=True)
class Counts:
    """What came."""

    taken: int = 0
    twice: int = 0
    lost: int = 0
    foreign: int = 0


class Board:
    """All rigs.

    Args:
        archive: Name of the archive that this is; what a rig keeps for it is taken only without gaps.
    """

    def __init__(self, archive: str | None = None) -> None:
        self.archive = archive
        self.rigs: dict[str, Rig] = {}
        self.counts = Counts()
        self.gaps: set[str] = set()
        """Rigs that must send again what is missing here."""

    def known(self, name: str, key: Key) -> None:
        """Of this rig all up to this key was taken before."""
        self.rigs.setdefault(name, Rig(name)).last = key

    def take(self, topic: str, payload: object, retained: bool, now: float) -> Heard | None:
        """Take a message.

        Args:
            topic: Its topic.
            payload: Bytes.
            retained: The broker had kept it: it has come before, to those who listened then.
            now: Of any clock [s].

        Returns:
            What was taken for the first time and is one of `KINDS`; None otherwise.
        """
        parts, body = split_topic(topic), decode(payload)
        if parts is None or body is None or (parts[0] not in self.rigs and len(self.rigs) >= MOST_RIGS):
            self.counts.foreign += 1
            return None
        name, suffix = parts
        kind = kind_of(suffix)
        if kind not in (*KINDS, "birth", "death"):
            return None
        rig = self.rigs.setdefault(name, Rig(name))
        if kind in ("birth", "death"):
            self._life(rig, kind, body, now)
            return None
        return self._in_order(rig, suffix, body, retained, now)

    def _life(self, rig: Rig, kind: str, body: Body, now: float) -> None:
        if kind == "death":
            rig.death = body
            return
        rig.birth, rig.heard = body, now
        told = body.get("now")
        if isinstance(told, dict) and not rig.state:
            rig.state = told
        if self.archive is not None and body.get("archive") == self.archive:
            self.gaps.add(rig.name)  # tell it what there is already

    def _in_order(self, rig: Rig, suffix: str, body: Body, retained: bool, now: float) -> Heard | None:
        key, previous = key_of([body.get("session"), body.get("seq")]), key_of(body.get("prev"))
        if key is None or previous is None:
            self.counts.foreign += 1
            return None
        if retained:
            self._note(rig, suffix, key, body, now)
            return None
        rig.heard = now
        if rig.last is not None and key <= rig.last:
            self.counts.twice += 1
            return None
        if self._is_gap(rig, previous, body):
            return None
        rig.last = key
        self.counts.taken += 1
        self._note(rig, suffix, key, body, now)
        return Heard(rig, suffix, key, body)

    def _is_gap(self, rig: Rig, previous: Key, body: Body) -> bool:
        """Whether this must wait for what comes before it; where that is gone for good, it is counted."""
        kept_for_us = self.archive is not None and body.get("archive") == self.archive
        last = rig.last or (NOTHING if kept_for_us else previous)
        if previous <= last:
            return False
        if kept_for_us and not body.get("oldest"):
            self.gaps.add(rig.name)
            return True
        if rig.last is not None:
            self.counts.lost += previous.seq - last.seq if previous.session == last.session else previous.seq
        return False

    def _note(self, rig: Rig, suffix: str, key: Key, body: Body, now: float) -> None:
        kind, _, axis = suffix.partition("/")
        if kind == "state" and key > rig.state_key:
            rig.state, rig.state_key = body, key
            rig.heard = rig.heard or now
        elif kind == "health":
            rig.health = body
        elif kind == "estimate":
            rig.estimates[axis] = body
            if body.get("quality") == "ok":
                trend = rig.trends.setdefault(axis, Trend())
                trend.add(
                    _number(body.get("at")) or 0.0, _number(body.get("zeta")), _number(body.get("omega_n"))
                )

    def rows(self, now: float) -> list[Body]:
        """For tables: a row for each axis of each rig, by name."""
        return [row for name in sorted(self.rigs) for row in _rows(self.rigs[name], now)]


def _rows(rig: Rig, now: float) -> list[Body]:
    axes = rig.state.get("axes")
    axes = axes if isinstance(axes, dict) and axes else {name: {} for name in rig.estimates or ["-"]}
    about = {
        "rig": rig.name,
        "standing": rig.standing(now),
        "silent_s": None if not rig.heard else now - rig.heard,
        "simulated": rig.birth.get("simulated"),
        "version": rig.birth.get("version"),
    }
    rows = []
    for name, axis in axes.items():
        told = axis if isinstance(axis, dict) else {}
        estimate = rig.estimates.get(name, {})
        keys = ("zeta", "zeta_sd", "omega_n", "omega_n_sd", "K_L", "K_L_sd", "quality")
        keep = ("state", "fault", "left_model", "left_since", "model_error")
        trend = rig.trends.get(name)
        row = {**about, "axis": name, **{key: told.get(key) for key in keep}}
        row |= {key: estimate.get(key) for key in keys}
        row["trend"] = [] if trend is None else trend.points
        rows.append(row)
    return rows


def _life(body: Body) -> Key:
    """Number of a connection: a death is that of the birth with the same one."""
    return key_of([body.get("session"), body.get("connection")]) or NOTHING


def _number(value: object) -> float | None:
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else None
