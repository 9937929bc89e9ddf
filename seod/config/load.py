"""Reads a rig file: everything that is wrong with it at once, or a `RigConfig` that can be relied on."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, cast

from pydantic import BaseModel, ValidationError

from drivers import driver_class, driver_kinds
from drivers.base import DriverError
from seod.config.access import check_access
from seod.config.draft import Draft
from seod.config.errors import ConfigError, ConfigErrors, dotted, suggest
from seod.config.model import CONFIG_VERSION, RigConfig
from seod.config.modes import check_modes
from seod.config.mqtt import with_paths
from seod.config.mqtt_access import check_mqtt
from seod.config.numbers import check_numbers
from seod.config.token_field import CREDENTIALS
from seod.config.tokens import RIGHTS
from seod.config.translate import show, translate
from seod.config.wiring import check_wiring
from seod.config.yaml_lines import parse
from seod.files.user_files import irregular

if TYPE_CHECKING:
    from collections.abc import Iterator
    from os import PathLike

    from drivers.base import Driver
    from seod.config.server import ServerConfig

__all__ = ["ConfigError", "ConfigErrors", "load_rig", "load_text"]

MAX_BYTES = 1 << 20
"""Largest rig file; real ones have a few kB."""


def load_rig(path: str | PathLike[str]) -> RigConfig:
    """Read and check a rig file.

    Returns:
        The rig, in SI units; `driver` is checked (paths absolute) and JSON-able.

    Raises:
        ConfigErrors: All that is wrong, each with file, line and key.
    """
    try:
        return load_text(_read(Path(path)), str(path), Path(path).parent.resolve())
    except _UnreadableError as error:
        raise ConfigErrors([ConfigError(str(path), error.line, "", str(error))]) from error.__cause__


class _UnreadableError(Exception):
    """Why the file's bytes are no text, and in which line."""

    def __init__(self, why: str, line: int = 1) -> None:
        super().__init__(why)
        self.line = line


def _read(file: Path) -> str:
    if why := irregular(file):
        raise _UnreadableError(why)
    try:
        with file.open("rb") as stream:
            data = stream.read(MAX_BYTES + 1)
    except (OSError, ValueError) as error:
        raise _UnreadableError(f"cannot be read: {getattr(error, 'strerror', None) or error}") from error
    if len(data) > MAX_BYTES:
        raise _UnreadableError(f"is larger than {MAX_BYTES} bytes: no rig file")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise _UnreadableError("is not UTF-8 text; save it as UTF-8", line) from error


def load_text(text: str, name: str, directory: Path) -> RigConfig:
    """Check a rig file's text.

    Args:
        text: YAML.
        name: Name of the file for messages.
        directory: Folder that relative paths in it start from.

    Raises:
        ConfigErrors: All that is wrong.
    """
    draft = Draft(name, directory, parse(text))
    early = list(_unusable(draft))
    if early:
        raise ConfigErrors(early)
    problems = _problems(draft)
    known = {(error.line, error.key) for error in problems}
    rules = (_shape, _driver, check_wiring, check_modes, check_numbers, check_access, check_mqtt)
    found = [error for rule in rules for error in rule(draft)]
    errors = problems + [error for error in found if (error.line, error.key) not in known]
    if errors:
        raise ConfigErrors(errors)
    return _finished(draft)


def _problems(draft: Draft) -> list[ConfigError]:
    """What is wrong with the YAML itself."""
    return [
        ConfigError(draft.file, problem.line, dotted(problem.path), problem.message, problem.right)
        for problem in draft.document.problems
    ]


def _unusable(draft: Draft) -> list[ConfigError]:
    """Why nothing in this file can be judged: no mapping, or made for another version."""
    value = draft.document.value
    if not isinstance(value, dict):
        empty = value is None
        message = "the file is empty" if empty else f"must be a mapping of keys to values, got {show(value)}"
        return _problems(draft) or [draft.error((), message, "for an example see configs/virtual.yaml")]
    version = value.get("version", CONFIG_VERSION)
    if type(version) is int and version == CONFIG_VERSION:
        return []
    message = f"this seod reads version {CONFIG_VERSION}, the file has {show(version)}"
    return [draft.error(("version",), message, f"`version: {CONFIG_VERSION}`, or a seod made for this file")]


def _shape(draft: Draft) -> Iterator[ConfigError]:
    """What the models find: unknown and missing keys, wrong types, units and ranges."""
    try:
        RigConfig.model_validate_json(json.dumps(draft.document.value))
    except ValidationError as error:
        for path, message, right in translate(error, RigConfig, draft.document.value):
            yield draft.error(path, message, right)


def _driver(draft: Draft) -> Iterator[ConfigError]:
    """Find the driver, judge its options, ask it for its channels."""
    kind = draft.text("driver", "kind")
    if not isinstance(draft.raw("driver"), dict):
        return
    if kind is None or kind not in driver_kinds():
        right = suggest(kind or "", driver_kinds(), "kinds")
        yield draft.wrong(("driver", "kind"), "must name a driver", right)
        return
    try:
        draft.driver = driver_class(kind)
    except (ImportError, AttributeError) as error:  # a package with a kind of its own, badly installed
        yield draft.error(("driver", "kind"), f"driver {kind!r} cannot be loaded: {error}")
        return
    yield from _options(draft, draft.driver)


def _options(draft: Draft, driver: type[Driver]) -> Iterator[ConfigError]:
    section = dict(draft.raw("driver"))
    if "simulation" in driver.Options.model_fields:
        yield from _misplaced_simulation(draft)
        section.pop("simulation", None)
        if simulation := draft.simulation:
            section["simulation"] = simulation.model_dump(mode="json")
    try:
        text = json.dumps(section)
        draft.options = driver.Options.model_validate_json(text, context={"directory": str(draft.directory)})
        channels = driver.channels(draft.options)
    except ValidationError as error:
        for path, message, right in translate(error, driver.Options, section):
            yield draft.error(("driver", *path), message, right)
    except DriverError as error:
        if "simulation" not in section and "simulation" in driver.Options.model_fields:
            return  # told already
        yield draft.error(("driver",), str(error))
    except OSError as error:  # a path in the options that cannot even be looked up
        yield draft.error(("driver",), f"a file cannot be read: {error}")
    else:
        draft.channels = {channel.name: channel for channel in channels}


def _misplaced_simulation(draft: Draft) -> Iterator[ConfigError]:
    if draft.raw("driver", "simulation") is not None:
        yield draft.error(("driver", "simulation"), "unknown key", "`simulation:` stands at the top level")
    elif draft.raw("simulation") is None:
        message = f"kind {draft.text('driver', 'kind')!r} simulates a rig but is not told which"
        yield draft.error(("driver", "kind"), message, "a `simulation:` section at the top level")


def _finished(draft: Draft) -> RigConfig:
    """The checked file as a model, with everything in it that other processes need."""
    config = RigConfig.model_validate_json(json.dumps(draft.document.value))
    # Only what was given: a default that is written out may mean more than one that is left out.
    driver = cast("BaseModel", draft.options).model_dump(mode="json", exclude_unset=True)
    changed: dict[str, object] = {"driver": driver}
    changed["server"] = _with_paths(config.server, draft.directory)
    if config.mqtt is not None:
        changed["mqtt"] = with_paths(config.mqtt, draft.directory)
    return config.model_copy(update=changed)


def _with_paths(server: ServerConfig, directory: Path) -> ServerConfig:
    """With absolute paths; credentials stay as they are, for only their unit has them."""

    def absolute(section: BaseModel, *keys: str) -> dict[str, object]:
        given = {key: getattr(section, key) for key in keys}
        return {
            key: name if name.startswith(CREDENTIALS) else str(directory / name)
            for key, name in given.items()
            if name is not None
        }

    paths = absolute(server, *(f"{right}_file" for right in RIGHTS))
    if server.tls is not None:
        paths["tls"] = server.tls.model_copy(update=absolute(server.tls, "certificate", "key"))
    return server.model_copy(update=paths) if paths else server
