"""Eq. 1 in closed form, with a constant offset and a delay, as `seod identify` fits it.

It tells whether y follows the integral of u (a position: type 1) or u itself (a speed: type 0) where nobody
says, and where the plant is that an offset or a delay hides.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from seod.diagnose.tuning.record import BLOCKS, CLOSED_FORM
from seod.identify.fit import fit
from seod.identify.problem import Given
from seod.identify.record import IdentifyError, Record, UntoldError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from seod.data import Recording
    from seod.diagnose.result import Hold, Output

TYPES: Final = {"position": "type 1: y follows the integral of u", "velocity": "type 0: y follows u itself"}


EQUATION: Final = "in one run Eq. 1 with offset and delay leaves"


class UserValues(NamedTuple):
    """What the user tells of a plant.

    Attributes:
        hold: Whether each command holds until the next or runs straight on to it.
        gain: K_L [unit/s/V] if it is known.
        delay: Likewise [s].
    """

    hold: Hold = "zero"
    gain: float | None = None
    delay: float | None = None


class ClosedForm(NamedTuple):
    """The best plant: K_L, omega_n, zeta and delay by name, none where none was found, and its NRMSE."""

    values: Mapping[str, float]
    nrmse: float


def closed_form(recordings: Sequence[Recording], output: Output, given: UserValues) -> ClosedForm:
    """Eq. 1 with an offset, and a delay where none is known, fitted to recordings.

    Of a long one to where its command moves most, as many rows as are searched for causes.
    """
    try:
        records = [_record(each, output, given.hold) for each in recordings]
        with np.errstate(all="ignore"):
            found = fit(records, Given(given.gain, given.delay))
    except (UntoldError, IdentifyError, np.linalg.LinAlgError, ArithmeticError, ValueError):
        return ClosedForm({}, math.inf)
    return (
        ClosedForm(found.value, float(found.nrmse))
        if math.isfinite(found.nrmse)
        else ClosedForm({}, math.inf)
    )


def _record(recording: Recording, output: Output, hold: Hold) -> Record:
    rows = _liveliest(recording)
    t, u, y = recording.t[rows], recording.u[rows], recording.y[rows]
    t_u = None if recording.t_u is None else recording.t_u[rows]
    return Record(recording.paths[0], t, u, y, t_u, output, hold=hold).thinned(CLOSED_FORM.samples)


def _liveliest(recording: Recording) -> slice:
    """Rows of the segment in which the command moves most while y is read; the last one ends as they do."""
    most = BLOCKS.searched_rows
    u = np.where(np.isfinite(recording.y), recording.u, np.nan)

    def moves(first: int) -> float:
        own = u[first : first + most]
        own = own[np.isfinite(own)]
        return float(np.std(own)) if len(own) else 0.0

    last = max(0, len(u) - most)
    first = max([*range(0, last, most), last], key=moves)
    return slice(first, first + most)


class Types(NamedTuple):
    """What y may be.

    Attributes:
        likelier: What it is taken for at first.
        closed: The best plant by what y is.
        said: A sentence of what y is taken for; none where the user tells.
    """

    likelier: Output
    closed: Mapping[Output, ClosedForm]
    said: tuple[str, ...]


def output_types(closed: Mapping[Output, ClosedForm], usual: Output) -> Types:
    """What y may be, by the best plants of both types.

    Args:
        closed: The best plant by what y is.
        usual: What y is unless the other is nearer.
    """
    other: Output = "velocity" if usual == "position" else "position"
    by_usual, by_other = closed[usual].nrmse, closed[other].nrmse
    first, second = (other, usual) if by_other < CLOSED_FORM.clearly * by_usual else (usual, other)
    return Types(first, closed, (taken_for(first, closed[first].nrmse, closed[second].nrmse),))


def taken_for(output: Output, left: float, otherwise: float, by: str = EQUATION) -> str:
    """That y is taken for this, as the NRMSE that `by` leaves is so, and otherwise so."""
    other: Output = "velocity" if output == "position" else "position"
    usual = f", which is not below {100.0 * CLOSED_FORM.clearly:.0f} % of that" if otherwise < left else ""
    return (
        f"y is taken for a {_word(output)} ({TYPES[output]}): {by} {_percent(left)}, as a {_word(other)} "
        f"{_percent(otherwise)}{usual}; --output says which it is"
    )


def _word(output: Output) -> str:
    return "position" if output == "position" else "speed"


def _percent(part: float) -> str:
    if not math.isfinite(part):
        return "more than there is"
    return f"{100.0 * part:.3g} %" if part < 1.0 else f"{100.0 * part:.0f} %"
