"""A value and how well it is known."""

from __future__ import annotations

from typing import Final, NamedTuple


class Known(NamedTuple):
    """A value known beforehand, with its standard deviation: 0 is certain, inf is not known at all."""

    value: float
    sd: float = 0.0

    @property
    def certain(self) -> bool:
        """Whether nothing is left to estimate."""
        return self.sd == 0.0

    @property
    def precision(self) -> float:
        """1 / variance; 0 where certain, for then it is no unknown, and where not known at all."""
        return 0.0 if self.certain else self.sd**-2


EXACTLY_ZERO: Final = Known(0.0)
