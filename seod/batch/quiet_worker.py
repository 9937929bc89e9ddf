"""What local workers load first: an interrupt from the terminal is the command's, who then ends them."""

from __future__ import annotations

import signal


def dask_setup(_worker: object) -> None:
    """Called by Dask in each worker that starts."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
