"""Advisories about what is locked (`make audit`): any that is known is a failure.

Passes unasked only where PyPI's database of advisories does not answer, and says so; with AUDIT=required not
even then. AUDIT_DATABASE=DIR asks a folder of OSV files instead (as of github.com/pypa/advisory-database),
and needs no network.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import urllib.error
import urllib.request
from pathlib import Path
from typing import Any

from packaging.utils import canonicalize_name
from packaging.version import InvalidVersion, Version
from ruamel.yaml import YAML

DATABASE = "https://pypi.org/pypi/pip/24.0/json"
"""A release that is known to be there, asked for as pip-audit asks for each: mirrors often lack this."""
TIMEOUT_S = 15.0
ACCEPTED = {
    "PYSEC-2023-163": "numexpr refuses such expressions since 2.8.5, and asammdf gives it only its own",
    "PYSEC-2023-121": "of the command line tool of zstd 1.4.10; the wheel has the library alone, a later one",
}
"""Advisories that name no version in which they are mended, and do not apply: each with its reason."""


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


def locked(text: str) -> dict[str, str]:
    """Versions of a lock by name."""
    return {canonicalize_name(name): v for name, v in re.findall(r"^([\w.-]+)==([^\s;\\]+)", text, re.M)}


def hit(affected: dict[str, Any], version: str) -> bool:
    """Whether an entry of `affected` (OSV schema) has the version: it is listed, or within a range."""
    if version in affected.get("versions", []):
        return True
    for each in affected.get("ranges", []):
        if each["type"] != "ECOSYSTEM":
            continue
        inside = False
        try:
            for event in each["events"]:  # in order of versions
                (kind, at), *_ = event.items()
                reached = Version(version) >= Version(at) if at != "0" else True
                if kind == "introduced":
                    inside |= reached
                elif kind == "fixed":
                    inside &= not reached
                elif kind == "last_affected":
                    inside &= Version(version) <= Version(at)
        except InvalidVersion:
            continue  # then only the list of versions tells
        if inside:
            return True
    return False


def advisories(folder: Path, lock: dict[str, str]) -> tuple[int, list[str]]:
    """How many advisories there are in a folder, and what they say of a lock.

    Raises:
        OSError, ValueError, KeyError, TypeError: A file is none.
    """
    files = sorted(p for p in folder.rglob("*") if p.suffix in (".yaml", ".yml", ".json"))
    yaml, entries, found = YAML(typ="safe", pure=True), 0, []
    for path in files:
        text = path.read_text("utf-8")
        told = json.loads(text) if path.suffix == ".json" else yaml.load(text)
        if not isinstance(told, dict) or "affected" not in told:
            continue
        entries += 1
        if told.get("withdrawn"):
            continue
        for affected in told["affected"]:
            package = affected["package"]
            version = lock.get(canonicalize_name(package["name"]))
            if told["id"] in ACCEPTED:
                continue
            if package["ecosystem"] == "PyPI" and version and hit(affected, version):
                also = " ".join(told.get("aliases", []))
                found.append(f"{package['name']} {version}: {told['id']} {also}".rstrip())
    return entries, sorted(set(found))


def ask_folder(folder: Path, lock: Path = Path("requirements.lock")) -> int:
    """Ask a folder of OSV files; one without advisories is a failure."""
    pinned = locked(lock.read_text("utf-8"))
    entries, found = advisories(folder, pinned)
    if not entries:
        print(f"not audited: {folder} has no advisories", file=sys.stderr)
        return 1
    print("\n".join(f"accepted: {name}: {why}" for name, why in ACCEPTED.items()))
    print(
        "\n".join(found) or f"{len(pinned)} locked packages: no other of {entries} advisories is about them"
    )
    return int(bool(found))


def main() -> int:
    """Ask for the advisories."""
    if folder := os.environ.get("AUDIT_DATABASE"):
        return ask_folder(Path(folder))
    why = missing()
    if why:
        required = os.environ.get("AUDIT") == "required"
        print(f"not audited: {DATABASE}: {why}{'; AUDIT=required' if required else ''}", file=sys.stderr)
        return int(required)
    program = Path(sys.executable).with_name("pip-audit")
    words = ["-r", "requirements.lock", "--disable-pip", "--strict", "--progress-spinner", "off"]
    words += [word for name in ACCEPTED for word in ("--ignore-vuln", name)]
    return subprocess.run([program, *words], check=False).returncode  # noqa: S603 - our own


if __name__ == "__main__":
    sys.exit(main())
