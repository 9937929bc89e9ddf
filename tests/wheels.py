"""Wheels for tests of the installation: of this checkout, and of releases that never were."""

from __future__ import annotations

import re
import subprocess
import sys
import sysconfig
import zipfile
from pathlib import Path

REPO = Path(__file__).parents[1]


def built(folder: Path, source: Path = REPO) -> Path:
    """The wheel of this checkout, or of another folder with its sources."""
    words = ["-m", "build", "--wheel", "--no-isolation", "--outdir", str(folder), str(source)]
    subprocess.run([sys.executable, *words], check=True, capture_output=True)
    (wheel,) = folder.glob("seod-*.whl")
    return wheel


def repacked(wheel: Path, folder: Path, version: str, changed: dict[str, str] | None = None) -> Path:
    """The same wheel with another version, and with other texts in some files."""
    folder.mkdir(parents=True, exist_ok=True)
    now = wheel.name.split("-")[1]
    out = folder / wheel.name.replace(f"-{now}-", f"-{version}-", 1)
    names = []
    with zipfile.ZipFile(wheel) as source, zipfile.ZipFile(out, "w") as target:
        for name in source.namelist():
            data = source.read(name)
            if name.endswith("/RECORD"):
                continue
            if name.endswith(".dist-info/METADATA"):
                data = data.replace(f"\nVersion: {now}\n".encode(), f"\nVersion: {version}\n".encode())
            elif name == "seod/__init__.py":
                data = re.sub(rb'__version__ = ".*"', f'__version__ = "{version}"'.encode(), data)
            data = (changed or {}).get(name, "").encode() or data
            names.append(name.replace(f"seod-{now}.", f"seod-{version}.", 1))
            target.writestr(names[-1], data)
        record = f"seod-{version}.dist-info/RECORD"
        target.writestr(record, "".join(f"{name},,\n" for name in [*names, record]))
    return out


def with_these_packages(folder: Path, wheel: Path) -> Path:
    """The wheel without dependencies, beside one that lends this environment's packages."""
    folder.mkdir(parents=True, exist_ok=True)
    lent = "lent-1-py3-none-any.whl"
    about = "lent-1.dist-info"
    with zipfile.ZipFile(folder / lent, "w") as target:
        target.writestr("lent.pth", sysconfig.get_path("purelib") + "\n")
        target.writestr(f"{about}/METADATA", "Metadata-Version: 2.1\nName: lent\nVersion: 1\n")
        target.writestr(f"{about}/WHEEL", "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n")
        target.writestr(
            f"{about}/RECORD", f"lent.pth,,\n{about}/METADATA,,\n{about}/WHEEL,,\n{about}/RECORD,,\n"
        )
    with zipfile.ZipFile(wheel) as source, zipfile.ZipFile(folder / wheel.name, "w") as target:
        for name in source.namelist():
            data = source.read(name)
            if name.endswith(".dist-info/METADATA"):
                data = re.sub(rb"(?m)^Requires-Dist: (?!.*extra ==).*$\n", b"", data)
                data = data.replace(b"\nName: seod\n", b"\nName: seod\nRequires-Dist: lent\n", 1)
            target.writestr(name, data)
    return folder / wheel.name


def houses(folder: Path) -> dict[str, Path]:
    """Wheelhouses of three releases: this one, a later one, and a later one that does not start."""
    first = with_these_packages(folder / "now", built(folder))
    broken = {"seod/supervisor/__main__.py": "raise SystemExit('this release does not start')\n"}
    for name, version, changed in (("later", "9.0.0", {}), ("broken", "9.1.0", broken)):
        repacked(first, folder / name, version, changed)
        (folder / name / "lent-1-py3-none-any.whl").write_bytes(
            (folder / "now/lent-1-py3-none-any.whl").read_bytes()
        )
    return {name: folder / name for name in ("now", "later", "broken")}
