"""Shape of an axis' `excitation` in a rig file."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from seod.config.section import NonNegativeSeconds, Seconds, Section


class TwoPhaseConfig(Section):
    """The relay's phase alternates, so that K_L and the delay come out together with zeta and omega_n."""

    enabled: bool | None = None
    """Whether it does; left out: where `K_L` is `identified`."""
    cycles: Annotated[int, Field(ge=2, le=20)] = 3
    """Cycles of each phase: as they are, then with each switch late."""
    shift: Annotated[float, Field(ge=0.03, le=0.4, allow_inf_nan=False)] = 0.25
    """Longest lateness [periods of the first phase]; less where the limits ask for less."""


class ExcitationConfig(Section):
    """When the relay is on."""

    kind: Literal["continuous", "burst"] = "continuous"
    """On until stopped, or in bursts with pauses."""
    duration: Seconds = 0.5
    """Length of a burst (the paper's 0.05-0.8 s)."""
    pause: NonNegativeSeconds = 1.0
    """Time between bursts, spent holding the position."""
    entry: NonNegativeSeconds = 0.05
    """The relay's amplitude rises from 0 to e_a in this time, at the start of each burst."""
    two_phase: TwoPhaseConfig = TwoPhaseConfig()
