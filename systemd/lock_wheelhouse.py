"""Writes the hashes of a folder's wheels into it, for `systemd/install.py` on another machine.

    python3 systemd/lock_wheelhouse.py DIR

The wheels were downloaded by the hashes of `requirements-run.lock`, or built from a source that was: what is
built here has a hash that no lock from elsewhere knows.
"""

from __future__ import annotations

import hashlib
import sys
from pathlib import Path

NAME = "wheels.lock"


def locked(wheelhouse: Path) -> str:
    """Requirements with hashes, one line a wheel; without seod's own, which is what asks for them."""
    lines = []
    for wheel in sorted(wheelhouse.glob("*.whl")):
        name, version = wheel.name.split("-")[:2]
        if name != "seod":
            digest = hashlib.sha256(wheel.read_bytes()).hexdigest()
            lines.append(f"{name.replace('_', '-')}=={version} --hash=sha256:{digest}\n")
    return "".join(lines)


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    (folder / NAME).write_text(locked(folder))
