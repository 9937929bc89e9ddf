"""Installs seod as a service, upgrades it in place, rolls it back, removes it. Standard library only.

    python3 systemd/install.py install --wheelhouse DIR     # and upgrade: DIR holds all wheels, no network
    python3 systemd/install.py rollback                     # to the release before
    python3 systemd/install.py uninstall                    # rig files, recordings and credentials stay

Each release is an environment of its own, PREFIX/releases/VERSION-N; PREFIX/current points at the one in
force and changes in one step. Running rigs are restarted one after the other; if one that ran does not come
up again, the release before is put back.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import venv
from importlib.util import find_spec
from pathlib import Path

PREFIX = Path("/opt/seod")
UNITS = ("seod@.service", "seod-can@.service", "seod-vcan@.service")
KEPT = 3
"""Releases that stay."""
WHEELS_LOCK = "wheels.lock"
"""Hashes of what lies beside it; see `systemd/lock_wheelhouse.py`."""
BACKOFF_SINCE = 254
"""Version of systemd that knows RestartSteps=."""


class InstallError(Exception):
    """It cannot be done; the message says why and what holds now."""


class Service:
    """Where everything lies.

    Args:
        prefix: Of the releases.
        root: Before /etc; not / in tests and images: then systemd is not spoken to.
    """

    def __init__(self, prefix: Path, root: Path) -> None:
        self.releases, self.current = prefix / "releases", prefix / "current"
        self.prefix = prefix
        self.units = root / "etc/systemd/system"
        self.rigs = root / "etc/seod"
        self.live = root == Path("/")

    # ---- commands

    def install(self, wheelhouse: Path, lock: Path | None) -> str:
        """A new release in force; the one before is put back where that fails."""
        before, running = self._in_force(), self._running()
        release = self._make(wheelhouse, lock)
        try:
            self._check_rigs(release)
            self._put_in_force(release, running)
        except InstallError as error:
            held = "none was installed before"
            if before is not None:
                self._put_in_force(before, running)
                held = f"{before.name} is in force again"
            shutil.rmtree(release)
            raise InstallError(f"{error}; {held}") from error
        self._forget_old()
        return f"{release.name} is in force" + (f" instead of {before.name}" if before else "")

    def rollback(self) -> str:
        """The release before the one in force."""
        now = self._in_force()
        older = [each for each in self._all() if now is not None and _number(each) < _number(now)]
        if now is None or not older:
            raise InstallError(f"there is no earlier release in {self.releases}")
        self._put_in_force(older[-1], self._running())
        return f"{older[-1].name} is in force instead of {now.name}"

    def uninstall(self) -> str:
        """Units and releases go; rig files and what the daemon wrote stay."""
        for unit in self._enabled():
            self._systemctl("disable", "--now", unit)
        for unit in self._running():
            self._systemctl("stop", unit)
        for name in UNITS:
            (self.units / name).unlink(missing_ok=True)
        (self.units / "seod@.service.d" / "backoff.conf").unlink(missing_ok=True)
        self._systemctl("daemon-reload")
        self.current.unlink(missing_ok=True)
        shutil.rmtree(self.prefix, ignore_errors=True)
        return f"seod is gone; {self.rigs} stays"

    # ---- releases

    def _all(self) -> list[Path]:
        found = [each for each in self.releases.glob("*-*") if each.is_dir()]
        return sorted(found, key=_number)

    def _in_force(self) -> Path | None:
        return self.current.resolve() if self.current.is_symlink() and self.current.exists() else None

    def _make(self, wheelhouse: Path, lock: Path | None) -> Path:
        wheels = sorted(wheelhouse.glob("seod-*.whl"))
        if len(wheels) != 1:
            raise InstallError(f"{wheelhouse}: expected one seod-*.whl, found {len(wheels)}")
        version = wheels[0].name.split("-")[1]
        number = max(map(_number, self._all()), default=0) + 1
        release = self.releases / f"{version}-{number}"
        self.releases.mkdir(parents=True, exist_ok=True)
        try:
            venv.create(release, with_pip=find_spec("pip") is None, symlinks=True)
            words = ["install", "--quiet", "--no-index", "--find-links", str(wheelhouse)]
            lock = lock or next(wheelhouse.glob(WHEELS_LOCK), None)
            if lock:  # by hash; the wheel itself, which nobody has locked, comes after
                _run([*_pip(release), *words, "--require-hashes", "--requirement", str(lock)])
                words.append("--no-deps")
            _run([*_pip(release), *words, str(wheels[0])])
        except (InstallError, subprocess.CalledProcessError) as error:
            shutil.rmtree(release, ignore_errors=True)
            raise InstallError(
                f"{wheels[0].name} cannot be installed: {error}; nothing has changed"
            ) from error
        return release

    def _check_rigs(self, release: Path) -> None:
        """The new release must read every rig file that is there, before it is in force."""
        for rig in sorted(self.rigs.glob("*.yaml")):
            unit = f"seod@{rig.stem}.service"
            if unit in self._enabled() + self._running():
                _run([str(release / "bin/seod"), "check", str(rig)])

    def _put_in_force(self, release: Path, running: list[str]) -> None:
        fresh = self.current.with_name("current.new")
        fresh.unlink(missing_ok=True)
        fresh.symlink_to(release)
        fresh.replace(self.current)
        self.rigs.mkdir(parents=True, exist_ok=True)
        self._put_units(release / "share/seod/systemd")
        self._systemctl("daemon-reload")
        for unit in running:
            self._restart(unit)

    def _put_units(self, source: Path) -> None:
        self.units.mkdir(parents=True, exist_ok=True)
        for name in UNITS:
            text = (source / name).read_text()
            (self.units / name).write_text(text.replace(str(PREFIX), str(self.prefix)))
        if self.live and _systemd_version() >= BACKOFF_SINCE:
            drop = self.units / "seod@.service.d"
            drop.mkdir(exist_ok=True)
            shutil.copy(source / "backoff.conf", drop)

    def _forget_old(self) -> None:
        now = self._in_force()
        for release in self._all()[:-KEPT]:
            if release != now:
                shutil.rmtree(release)

    # ---- systemd

    def _systemctl(self, *words: str) -> str:
        return _run(["systemctl", *words]) if self.live else ""

    def _running(self) -> list[str]:
        words = ["list-units", "--state=active,activating,reloading", "--no-legend", "--plain"]
        said = self._systemctl(*words, "seod@*.service")
        return [line.split()[0] for line in said.splitlines() if line.strip()]

    def _enabled(self) -> list[str]:
        return sorted({link.name for link in self.units.glob("*.wants/seod*@*.service")})

    def _restart(self, unit: str) -> None:
        """Returns once it says that it is ready."""
        try:
            self._systemctl("restart", unit)
        except InstallError as error:
            raise InstallError(f"{unit} does not come up: journalctl -u {unit}") from error


def _pip(release: Path) -> list[str]:
    """This interpreter's pip for the release's, which is quicker to make without one of its own."""
    quiet = "--disable-pip-version-check"
    if find_spec("pip") is None:
        return [str(release / "bin/pip"), quiet]
    return [sys.executable, "-m", "pip", quiet, "--python", str(release / "bin/python")]


def _number(release: Path) -> int:
    found = re.search(r"-(\d+)$", release.name)
    return int(found[1]) if found else 0


def _systemd_version() -> int:
    found = re.match(r"systemd (\d+)", _run(["systemctl", "--version"]))
    return int(found[1]) if found else 0


def _run(command: list[str]) -> str:
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    if done.returncode != 0:
        raise InstallError(f"{' '.join(command)}: {(done.stderr or done.stdout).strip()}")
    return done.stdout


def main() -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("what", choices=["install", "rollback", "uninstall"])
    parser.add_argument("--prefix", type=Path, default=PREFIX, help="of the releases (default: /opt/seod)")
    parser.add_argument("--root", type=Path, default=Path("/"), help="of /etc; not /: systemd is left alone")
    parser.add_argument("--wheelhouse", type=Path, help="folder with the wheel and all that it needs")
    parser.add_argument(
        "--lock",
        type=Path,
        help="requirements with hashes that must be met (default: DIR/wheels.lock, where it is)",
    )
    given = parser.parse_args()
    service = Service(given.prefix, given.root)
    if given.root == Path("/") and os.geteuid() != 0:
        print("run as root: it writes /opt and /etc", file=sys.stderr)
        return 1
    try:
        if given.what == "install":
            if given.wheelhouse is None:
                parser.error("install needs --wheelhouse")
            print(service.install(given.wheelhouse.resolve(), given.lock))
        else:
            print(getattr(service, given.what)())
    except InstallError as error:
        print(error, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
