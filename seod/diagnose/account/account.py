"""The measured movement in three parts: explained, systematic but unnamed, and what does not repeat."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from seod.diagnose.account.black_box import foretold
from seod.diagnose.account.chance import may_pass, usable
from seod.diagnose.account.load_noise import on_load
from seod.diagnose.account.loop import acts_on_errors
from seod.diagnose.account.residual import Plant, mean_square, not_repeated, window_residuals
from seod.diagnose.account.with_movement import comes_with_movement
from seod.diagnose.account.yardstick import beaten, yardstick
from seod.diagnose.fitting.initial_states import rings
from seod.diagnose.fitting.noise_colour import NoiseColour, colour
from seod.diagnose.fitting.repeats import repeats
from seod.diagnose.fitting.uncertainty import at_limits
from seod.diagnose.record.sweep import sweeps
from seod.diagnose.result import Account, Yardstick
from seod.diagnose.tuning.account import ACCOUNT, GRADE, SYSTEMATIC

if TYPE_CHECKING:
    from collections.abc import Sequence

    from seod.diagnose.account.black_box import Foretold
    from seod.diagnose.account.residual import WindowResidual
    from seod.diagnose.account.yardstick import Reached
    from seod.diagnose.fitting.held_out import HeldOut
    from seod.diagnose.fitting.least_squares import Fitted
    from seod.diagnose.fitting.repeats import Share
    from seod.diagnose.record.series import Series
    from seod.diagnose.record.windows import Cut
    from seod.diagnose.result import Evidence, OnLoad


class Shown(NamedTuple):
    """How much of what is left is systematic, at least.

    Attributes:
        part: Of the squared error [0 to 1].
        by: How it is known.
        noise: Of the rest.
        asked: The recording could have shown it: the command repeats, or windows are alike.
        detectable: Part of the squared error that would have been shown, had it been systematic.
        on_load: How much of the rest acts on the load.
    """

    part: float
    by: Evidence
    noise: NoiseColour
    asked: bool
    detectable: float
    on_load: OnLoad | None = None


def accounted(
    found: Fitted,
    seen: HeldOut,
    held: HeldOut,
    base: HeldOut,
    *,
    predicted: bool = False,
    noise_alone: bool = False,
) -> tuple[Account | None, Yardstick | None]:
    """Parts of the baseline's squared error over the windows held out, and what models without physics reach.

    The systematic part is the largest that is shown by what repeats with the command, by what a black box
    foretells of windows that it has not seen, by how much more is left where the load moves more, or by how
    much nearer ARX or NARX come: each is the least that there is. Where much is left, and neither repetition
    nor the black box would have shown anything, less is asked of ARX and NARX.
    Of a plant at an end of its range, or that rings through its windows, nobody can tell what it leaves.

    Args:
        found: The extended model.
        seen: Its simulation of the windows that were fitted.
        held: Of those held out.
        base: The baseline's of the same.
        predicted: The model was fitted by prediction errors: see `beaten`.
        noise_alone: The same set fitted so leaves nothing systematic. What this one does is of its numbers,
            which noise has moved.
    """
    parts, own = window_residuals(seen, held_out=False), window_residuals(held, held_out=True)
    if (
        not own
        or not mean_square([*parts, *own]) > 0.0
        or not max(base.nrmse, seen.nrmse, held.nrmse) < ACCOUNT.lost
    ):
        return None, None
    plant = Plant.of(found.model, found.x)
    in_loop = acts_on_errors(held.cut.series, [*parts, *own])
    shown = systematic([*parts, *own], held.cut.series, plant, in_loop=in_loop)
    other = yardstick(seen.cut, held.cut)
    if noise_alone:
        every = [*parts, *own]
        shown = shown._replace(part=0.0, by="nothing", noise=colour(every), on_load=on_load(every, plant))
    elif other is not None:
        total = mean_square(own)
        shown = _by_yardstick(shown, seen, held, other, total, predicted=predicted, in_loop=in_loop)
    remains = min(1.0, (held.nrmse / base.nrmse) ** 2) if base.nrmse > 0.0 else 1.0
    account = Account(
        explained=1.0 - remains,
        systematic=shown.part * remains,
        not_repeatable=(1.0 - shown.part) * remains,
        systematic_nrmse=math.sqrt(shown.part) * held.nrmse,
        shown_by=shown.by,
        noise_order=shown.noise.order,
        asked=shown.part > 0.0 or (shown.asked and _is_a_plant(found, held.cut)),
        detectable_nrmse=math.sqrt(shown.detectable) * held.nrmse,
        noise_correlation_s=shown.noise.correlation * held.cut.series[0].tick,
        on_load=shown.on_load,
    )
    return account, None if other is None else Yardstick(other.arx, other.narx, other.changes_with)


def _by_yardstick(
    shown: Shown,
    seen: HeldOut,
    held: HeldOut,
    other: Reached,
    total: float,
    *,
    predicted: bool,
    in_loop: bool,
) -> Shown:
    """What is shown, or what ARX and NARX show, where that is more of the mean square `total`.

    Less is asked of them where much is left, and nothing else would have shown anything.
    """
    alone = held.nrmse > GRADE.untold and shown.detectable > 1.0
    chance = SYSTEMATIC.chance_alone if alone else SYSTEMATIC.chance
    nearer = beaten(seen, held, other, shown.noise, predicted=predicted, in_loop=in_loop, chance=chance)
    if not (nearer.significant and nearer.square > shown.part * total):
        return shown
    return shown._replace(part=min(1.0, nearer.square / total), by="yardstick", on_load=None)


def _is_a_plant(found: Fitted, held: Cut) -> bool:
    return not at_limits(found) and not rings(found.model, found.x, held)


def systematic(
    parts: Sequence[WindowResidual], every: Sequence[Series], plant: Plant, *, in_loop: bool
) -> Shown:
    """Of what is left of windows; 0 where it may be chance."""
    swept = all(sweeps(one.t, one.u) for one in every)
    again, box = repeats(every, parts), foretold(parts, plant, swept=swept, in_loop=in_loop)
    tells = box is not None and (not swept or math.isfinite(box.detectable))
    asked = again is not None or tells
    total = mean_square([one for one in parts if one.held_out])
    ways = [_Way(0.0, "nothing", parts), _moved(parts, every, plant, in_loop=in_loop)]
    if box is not None and box.share.significant:
        ways.append(_Way(min(1.0, box.share.square / total), "black box", box.rest))
    if again is not None and again.significant:
        ways.append(_Way(min(1.0, again.square / total), "repetition", not_repeated(every, parts)))
    part, by, rest = max(ways, key=lambda way: way.part)
    detectable = _detectable(again, box if asked else None, total)
    enters = None if by == "movement" else on_load(rest, plant)
    return Shown(part, by, colour(rest), asked, detectable, enters)


class _Way(NamedTuple):
    """One way to see what is systematic: its part of the squared error, its name, and windows without it."""

    part: float
    by: Evidence
    rest: Sequence[WindowResidual]


def _moved(parts: Sequence[WindowResidual], every: Sequence[Series], plant: Plant, *, in_loop: bool) -> _Way:
    """By the movement, unless a sensor errs more as it moves."""
    if any(one.errs_as_it_moves for one in every):
        return _Way(0.0, "nothing", parts)
    noise = usable(colour(parts), parts)
    return _Way(comes_with_movement(parts, plant, noise, may_pass(in_loop=in_loop)), "movement", parts)


def _detectable(again: Share | None, box: Foretold | None, total: float) -> float:
    """Smallest systematic part that one of the ways would have shown, of the mean square `total`."""
    ways = [] if box is None else [box.detectable]
    ways += [] if again is None else [again.limit * again.sd / total]
    return min(ways, default=math.inf)
