"""Models in the sizes of a recording, for tests of the diagnosis."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from seod.diagnose.fitting.initial_states import simulated_states
from seod.diagnose.fitting.least_squares import fit
from seod.diagnose.fitting.model import baseline_model
from seod.diagnose.record.windows import cut
from seod.diagnose.starts.sizes import scales


def sized_model(one, rough, truth, names=(), *, speed=False):
    """Eq. 1 with these effects, in sizes that the plant of `truth` has in the recording."""
    plain = baseline_model(rough, 1.0, speed, {})
    windows, _ = cut([one])
    x = plain.searched(truth)
    begun = fit(plain, windows, x, simulated_states(plain, x, windows), free=np.zeros(3, np.bool_))
    model = replace(plain, scales=scales(begun, windows))
    for name in names:
        model = model.with_effect(name)
    return model
