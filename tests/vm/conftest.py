"""The tests in `guest/` run inside the guest only; on the host, `test_guest.py` runs them there."""

import os

collect_ignore = [] if os.environ.get("SEOD_IN_GUEST") else ["guest"]
