"""A frequency response that was measured (`seod response --json`), read for its -3 dB and -90 deg."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from seod.calibrate.value import Value, measured
from seod.files.user_files import irregular
from seod.sheet.segments import SheetError
from seod.sheet.trend import pooled

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    Array = NDArray[np.float64]

FITTED: Final = ("K_L", "omega_n", "zeta", "delay")
REFERENCE_BAND: Final = 2.0
"""The gain at low frequency is the mean of points up to so many times the lowest one: a band that begins at
a 20th of omega_n is flat there to 1 %."""


@dataclass(frozen=True, slots=True)
class Measured:
    """A response from voltage to speed.

    Attributes:
        path: The file.
        day: Of the file's last change (UTC): it tells none itself.
        quality: `ok`, or why it is not to be believed.
        omega: Of the points, rising [rad/s].
        decibel: Gain over that of the lowest octave, and its standard deviation.
        degrees: Phase, without jumps of 360, and its standard deviation.
        gain: Of the lowest octave [unit/s/V].
        fit: K_L, omega_n, zeta, delay of Eq. 1 fitted to the points.
    """

    path: Path
    day: str
    quality: str
    omega: Array
    decibel: tuple[Array, Array]
    degrees: tuple[Array, Array]
    gain: Value
    fit: dict[str, Value]

    def minus_3_db(self) -> Value | None:
        """Frequency [Hz] at which the gain first falls by 3 dB; None: not within the band."""
        return _crossing(self.omega, *self.decibel, -3.0)

    def minus_90_deg(self) -> Value | None:
        """Frequency [Hz] at which the phase first falls to -90 deg; None: not within the band."""
        return _crossing(self.omega, *self.degrees, -90.0)

    @property
    def band(self) -> tuple[float, float]:
        """Lowest and highest frequency [Hz]."""
        return float(self.omega[0]) / math.tau, float(self.omega[-1]) / math.tau


def read_response(path: Path) -> Measured:
    """Read what `seod response --json` printed into a file.

    Raises:
        SheetError: It is something else.
        OSError: It cannot be read.
    """
    if why := irregular(path):
        raise SheetError(f"{path}: {why}")
    try:
        told = json.loads(path.read_bytes())
        names = ("omega", "real", "imag", "sd")
        points = {name: np.array([point[name] for point in told["points"]]) for name in names}
        made = _measured(path, told, points)
    except (ValueError, KeyError, TypeError, IndexError) as error:
        raise SheetError(f"{path}: is no answer of `seod response --json`: {error!r}") from error
    return made


def _measured(path: Path, told: Any, points: dict[str, Array]) -> Measured:
    omega = points["omega"]
    if len(omega) < 2:
        raise ValueError("fewer than two points")
    G, sd = points["real"] + 1j * points["imag"], points["sd"]
    if told["output"] == "position":
        G, sd = G * 1j * omega, sd * omega
    sd = np.maximum(sd, 1e-12 * np.abs(G))
    low = omega <= REFERENCE_BAND * omega[0]
    gain = pooled(np.abs(G[low]).tolist(), sd[low].tolist())
    relative = np.hypot(sd / np.abs(G), gain.sd / gain.value)
    phase = np.degrees(np.unwrap(np.angle(G)))
    phase -= 360.0 * np.round(phase[0] / 360.0)
    day = datetime.fromtimestamp(path.stat().st_mtime, UTC).date().isoformat()
    return Measured(
        path=path,
        day=day,
        quality=told["quality"],
        omega=omega,
        decibel=(20.0 * np.log10(np.abs(G) / gain.value), 20.0 / math.log(10.0) * relative),
        degrees=(phase, np.degrees(sd / np.abs(G))),
        gain=gain,
        fit={
            name: measured(told["fit"][name]["value"], told["fit"][name]["sd"], math.inf) for name in FITTED
        },
    )


def _crossing(omega: Array, y: Array, sd: Array, level: float) -> Value | None:
    """Where y first falls through the level [Hz]: a straight line over the logarithm of the frequency."""
    falls = np.flatnonzero((y[:-1] > level) & (y[1:] <= level))
    if not len(falls):
        return None
    k = int(falls[0])
    part = float((y[k] - level) / (y[k] - y[k + 1]))
    octaves = math.log(omega[k + 1] / omega[k])
    frequency = float(omega[k]) * math.exp(part * octaves) / math.tau
    off = math.hypot((1.0 - part) * float(sd[k]), part * float(sd[k + 1]))
    return measured(frequency, frequency * octaves * off / float(y[k] - y[k + 1]), math.inf)
