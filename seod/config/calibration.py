"""What `seod calibrate` found, as it stands in the rig file."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from seod.config.section import FINITE, NON_NEGATIVE, Section

Number = Annotated[float, FINITE]


class CalibratedValue(Section):
    """A measured value, in SI."""

    value: Number
    """What was measured [SI unit of what it is: see the key that holds it]."""
    sd: Annotated[float, NON_NEGATIVE]
    """Its standard deviation [as the value]."""
    interval: tuple[Number, Number]
    """Its 95 % interval [as the value]."""


class CalibratedEdge(Section):
    """An edge of the deadband, found by a staircase of voltages."""

    interval: tuple[Number, Number]
    """Voltages between which it lies, lower first; still at that nearer the null, moving at the other [V]."""


class CalibrationConfig(Section):
    """Results of `seod calibrate`. The values in use are elsewhere: K_L, relay.bias, estimator.delay."""

    date: Annotated[str, Field(pattern=r"^\d{4}-\d\d-\d\d$")]
    """Day of the measurement (UTC)."""
    K_L: CalibratedValue
    """Mean gain of both directions [axis unit/s/V]."""
    K_L_up: CalibratedValue | None = None
    """Gain towards larger readings."""
    K_L_down: CalibratedValue | None = None
    """Gain towards smaller readings."""
    null: CalibratedValue
    """Voltage at which the actuator stands still [V]."""
    deadband_up: CalibratedEdge | None = None
    """Edge of the deadband towards larger readings."""
    deadband_down: CalibratedEdge | None = None
    """Edge of the deadband towards smaller readings."""
    delay: CalibratedValue
    """Loop delay [s]."""
    supply_pressure: Annotated[float, NON_NEGATIVE] | None = None
    """Mean supply pressure meanwhile [Pa]."""
