"""What the windows so far have told of the delay: a constant of the rig, or nearly so.

A window of one limit cycle hardly tells a delay from omega_n. But the delay of the next window is the same:
what each window told is what is known before the next one that shares no sample with it.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final, NamedTuple

from seod.estimate.known import Known

if TYPE_CHECKING:
    from seod.estimate.wave.answer import Answer

WANDER: Final = 0.03
"""Ticks by which a delay may have wandered after a second, standard deviation (as a random walk does).

Clocks that differ by 1e-5 move the age of frames of a device without a SYNC by 0.01 ticks of 1 ms in a
second: answers then lag by under one deviation. Less is narrower on rigs that stand still, and wrong there.
"""
SURPRISE: Final = 15.0
"""Chi-square of one degree above which the delay is another than before: once in 10,000 of noise."""
SHARPER: Final = 0.8
"""Part of a standard deviation that another must be below to take its place."""


class _Learned(NamedTuple):
    """What was known when the samples up to `t` [s] had told theirs."""

    t: float
    known: Known


class DelayMemory:
    """Hands what windows tell of the delay on to windows that share no sample with them.

    Args:
        prior: The delay as it is known beforehand [s]. If it is certain, or not known at all, each window
            stands alone.
        wander: Standard deviation of the delay's random walk after one second [s].
    """

    def __init__(self, prior: Known, wander: float) -> None:
        self.prior = prior
        self._variance_rate = wander**2
        self.forget()

    @property
    def keeps(self) -> bool:
        """Whether there is anything to learn, and anything to begin with."""
        return 0.0 < self.prior.sd < math.inf

    @property
    def known(self) -> Known:
        """What the window that is fitted now is told."""
        return self._settled.known

    def forget(self) -> None:
        """Only what was known beforehand is left."""
        self._settled = self._newest = _Learned(-math.inf, self.prior)

    def inherit(self, other: DelayMemory) -> None:
        """Go on with what another has learnt, if it began with the same value."""
        if self.keeps and other.keeps and self.prior.value == other.prior.value:
            self._settled, self._newest = other._settled, other._newest

    def before(self, begin: float, end: float) -> Known:
        """What is known of the delay at `end` without the samples since `begin` [s]."""
        if begin < self._settled.t:
            self.forget()  # time runs back
        if self._newest.t <= begin:
            self._settled = self._newest
        t, known = self._settled
        if math.isinf(t):
            return self.prior
        variance = known.sd**2 + self._variance_rate * (end - t)
        return Known(known.value, min(math.sqrt(variance), self.prior.sd))

    def learn(self, answer: Answer) -> None:
        """Take what a window told, unless it shares samples with one that told as much.

        The oscillation's first cycles tell more than those after them: a window that holds more of them
        takes the place of one that is not yet handed on.
        """
        begin, end = float(answer.window.t[0]), float(answer.window.t[-1])
        shown = Known(answer.fit.delay, answer.sd("delay"))
        waiting = self._newest is not self._settled
        if self.keeps and (
            begin >= self._newest.t or (waiting and shown.sd < SHARPER * self._newest.known.sd)
        ):
            self._newest = _Learned(end, shown)

    def contradicts(self, answer: Answer) -> bool:
        """Whether an answer's own samples say another delay than was handed to it."""
        before = answer.window.delay
        if not self.keeps or before == self.prior:
            return False
        freed = before.sd**2 - answer.sd("delay") ** 2
        return (answer.fit.delay - before.value) ** 2 > SURPRISE * max(freed, 0.0)
