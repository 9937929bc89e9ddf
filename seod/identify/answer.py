"""What recordings say, in the form of a person's and a program's answer."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from seod.estimate.advice import Advice, advise, as_json
from seod.estimate.base import finite_or_none
from seod.identify.agree import disagreement
from seod.identify.alternatives import WITHOUT_DELAY, Alternative, alternatives, in_words
from seod.identify.fit import Fit, fit
from seod.identify.problem import NAMES, Given
from seod.identify.words import correlations, early, quality, tied, unsure

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from seod.identify.record import Record


@dataclass(frozen=True, slots=True)
class Result:
    """The answer.

    Attributes:
        fit: The plant; of several that explain the recordings as well, the simplest. None: nothing is told.
        quality: `ok`, or why it is not to be believed: a word of `seod.estimate.base.QUALITIES`.
        message: The reason of a quality that is not `ok`.
        cannot_tell: What the recordings cannot tell, in sentences.
        alternatives: Plants that explain them as well.
        assumed: Names of values that were not told and are taken to be zero.
        advice: For the position controller; None where the answer is not `ok`.
        method: What found it.
        answers: Of a live estimator: how many by quality.
    """

    fit: Fit | None
    quality: str
    message: str | None = None
    cannot_tell: tuple[str, ...] = ()
    alternatives: tuple[Alternative, ...] = ()
    assumed: tuple[str, ...] = ()
    advice: Advice | None = None
    method: str = "output_error"
    answers: Mapping[str, int] = field(default_factory=dict)

    def as_json(self) -> dict[str, Any]:
        """Values with standard deviations, quality word, nrmse and what else there is; undefined is None."""
        return self._values() | {
            "quality": self.quality,
            "message": self.message,
            "method": self.method,
            "nrmse": None if self.fit is None else finite_or_none(self.fit.nrmse),
            "correlation": {} if self.fit is None else correlations(self.fit),
            "answers": dict(self.answers),
            "rejected": 0 if self.fit is None else self.fit.rejected,
            "cannot_tell": list(self.cannot_tell),
            "assumed": list(self.assumed),
            "alternatives": [
                {"what": each.what, **each.fit.value, "nrmse": each.fit.nrmse} for each in self.alternatives
            ],
            "advice": None if self.advice is None else as_json(self.advice),
        }

    def _values(self) -> dict[str, Any]:
        if self.fit is None:
            return {name: {"value": None, "sd": None} for name in NAMES}
        value, sd = self.fit.value, self.fit.sd
        return {
            name: {
                "value": finite_or_none(value[name]),
                "sd": None if name in self.assumed else finite_or_none(sd[name]),
            }
            for name in NAMES
        }


def identify(records: Sequence[Record], K_L: float | None = None, delay: float | None = None) -> Result:
    """Identify the plant of one or several recordings.

    Args:
        records: At least one.
        K_L: Gain [unit/s/V] if it is known; None: free.
        delay: Beyond the recordings' own times [s] if it is known; None: free.
    """
    try:
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            best = fit(records, Given(K_L, delay))
            differ = disagreement(records, Given(K_L, delay), best)
            others = alternatives(records, K_L, delay, best)
    except (np.linalg.LinAlgError, ArithmeticError, ValueError) as error:
        return Result(None, "fault", f"the search came to no number: {error}")
    simplest = next((each.fit for each in others if each.what == WITHOUT_DELAY), None)
    told = best if simplest is None else simplest
    cannot_tell = [in_words(each, best) for each in others] or [*unsure(best), *tied(best)]
    word, message = quality(records, told, bool(others), differ)
    cannot_tell += [sentence for sentence in early(told) if sentence != message]
    value = told.value | {"K_L": abs(told.value["K_L"])}
    return Result(
        fit=told,
        quality=word,
        message=message,
        cannot_tell=tuple(cannot_tell),
        alternatives=tuple(
            Alternative("with delay", best) if each.what == WITHOUT_DELAY else each for each in others
        ),
        assumed=() if simplest is None else ("delay",),
        advice=advise(value, told.sd) if word == "ok" else None,
    )
