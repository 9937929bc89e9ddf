"""`python -m seod.observe`, as the gateway starts it."""

import os
import sys

for library in ("OPENBLAS", "OMP", "MKL"):
    # small matrices only: threads would take longer to wake up than to compute, and a core from the loop
    os.environ.setdefault(f"{library}_NUM_THREADS", "1")

from seod.observe.process import main  # noqa: E402 (numpy reads the environment once, when it is loaded)

sys.exit(main())
