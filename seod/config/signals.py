"""Rules about what is commanded: each channel has one source, and carries the numbers that it is given."""

from __future__ import annotations

from typing import TYPE_CHECKING

from seod.config.outputs import OutputConfig

if TYPE_CHECKING:
    from collections.abc import Iterator

    from seod.config.draft import Draft
    from seod.config.errors import ConfigError, KeyPath


def check_signals(draft: Draft) -> Iterator[ConfigError]:
    """All mistakes in what goes out beside the axes' commands, and channels that are set twice."""
    yield from _carried(draft)
    yield from _set_once(draft)


def _outputs(draft: Draft) -> Iterator[tuple[str, str, OutputConfig]]:
    """Axis, output's name and output, where they are valid."""
    for axis in draft.names("axes"):
        name = draft.text("axes", axis, "output") or ""
        output = draft.section(OutputConfig, "outputs", name)
        if output is not None:
            yield axis, name, output


def _carried(draft: Draft) -> Iterator[ConfigError]:
    """The channels can carry what they are given."""
    for _, name, output in _outputs(draft):
        for channel, value in output.fixed.items():
            yield from _fits(draft, ("outputs", name, "fixed", channel), channel, value)
        if output.enable is not None:
            for key in ("on", "off"):
                path = ("outputs", name, "enable", key)
                yield from _fits(draft, path, output.enable.channel, getattr(output.enable, key))


def _fits(draft: Draft, path: KeyPath, name: str, value: float) -> Iterator[ConfigError]:
    channel = (draft.channels or {}).get(name)
    if channel is not None and not channel.minimum <= value <= channel.maximum:
        carried = f"channel {name!r} carries only {channel.minimum:g} to {channel.maximum:g}"
        yield draft.wrong(path, carried)


def _set_once(draft: Draft) -> Iterator[ConfigError]:
    """A channel has one source; an enable signal, or a fixed number, may be the same one for several."""
    sources: dict[str, tuple[str, object]] = {}
    for axis, name, output in _outputs(draft):
        found: list[tuple[KeyPath, str, str, object]] = [
            (("axes", axis, "output"), output.channel, f"driven by axis {axis!r}", axis)
        ]
        if output.enable is not None:
            enable = output.enable
            what = f"the enable signal of output {name!r}"
            found.append((("outputs", name, "enable", "channel"), enable.channel, what, enable))
        for channel, value in output.fixed.items():
            what = f"fixed at {value:g} by output {name!r}"
            found.append((("outputs", name, "fixed", channel), channel, what, value))
        for path, channel, what, source in found:
            before, same = sources.setdefault(channel, (what, source))
            if same != source:
                message = f"channel {channel!r} is already {before}"
                yield draft.error(path, message, "one source for each channel")
