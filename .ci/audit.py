"""Advisories about what is locked (`make audit`): any that is known is a failure.

Passes unasked only where PyPI's database of advisories does not answer, and says so; with AUDIT=required not
even then.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import urllib.error
import urllib.request
from pathlib import Path

DATABASE = "https://pypi.org/pypi/pip/24.0/json"
"""A release that is known to be there, asked for as pip-audit asks for each: mirrors often lack this."""
TIMEOUT_S = 15.0


def missing(url: str = DATABASE) -> str:
    """Why the database cannot be asked ("" where it can)."""
    try:
        with urllib.request.urlopen(url, timeout=TIMEOUT_S) as answer:  # noqa: S310 - as written above
            told = json.load(answer)
    except urllib.error.HTTPError as error:
        return f"HTTP {error.code} {error.reason}"
    except (OSError, ValueError) as error:
        return str(error)
    return "" if isinstance(told, dict) and "vulnerabilities" in told else "the answer has no advisories"


def main() -> int:
    """Ask for the advisories."""
    why = missing()
    if why:
        required = os.environ.get("AUDIT") == "required"
        print(f"not audited: {DATABASE}: {why}{'; AUDIT=required' if required else ''}", file=sys.stderr)
        return int(required)
    program = Path(sys.executable).with_name("pip-audit")
    words = ["-r", "requirements.lock", "--disable-pip", "--strict", "--progress-spinner", "off"]
    return subprocess.run([program, *words], check=False).returncode  # noqa: S603 - our own


if __name__ == "__main__":
    sys.exit(main())
