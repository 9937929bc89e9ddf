"""What the interfaces of python-can do with our own frames: whether they hand them back, and how marked.

A frame that comes back tells that it has left, and when. It must also not be taken for somebody else's
command. Read from python-can 4.6; `docs/can.md` has the table.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, Literal

if TYPE_CHECKING:
    from drivers.can_config import CanOptions

Echo = Literal["ours", "local", "plain", "none"]
"""`ours`: handed back once sent, and marked as this connection's. `local`: marked, but so may be those of
other programs on this computer. `plain`: they come back like anybody's. `none`: they do not come back.
"""

ECHOES: Final[dict[str, Echo]] = {
    "socketcan": "ours",  # MSG_CONFIRM
    "virtual": "ours",
    "gs_usb": "ours",  # the adapter's echo id
    "kvaser": "local",
    "vector": "local",
    "pcan": "local",
    "neovi": "local",
    "nixnet": "local",
    "etas": "local",
    "udp_multicast": "plain",  # the group has all of its members' datagrams, the sender's own included
}

UNASKED: Final = frozenset({"udp_multicast", "gs_usb"})
"""They hand own frames back whether asked or not; the first one refuses to be asked."""

REALTIME_STAMPS: Final = frozenset({"socketcan", "virtual", "udp_multicast"})
"""Interfaces whose stamps are of this machine's CLOCK_REALTIME."""


def echo_of(options: CanOptions) -> Echo:
    """What comes back of our own frames: by the rig file's `echo`, or else by what is known."""
    known = ECHOES.get(options.interface, "none")
    if options.echo is None or options.interface in UNASKED:
        return known
    if not options.echo:
        return "none"
    return "plain" if known == "none" else known


def asks_for_echo(options: CanOptions) -> bool:
    """Whether `can.Bus` is asked to hand own frames back."""
    return echo_of(options) != "none" and options.interface not in UNASKED


def interface_warnings(options: CanOptions) -> list[str]:
    """What an interface cannot do, for `seod check`."""
    name, found = options.interface, []
    if echo_of(options) == "none":
        found.append(
            f"driver.interface {name} does not hand our frames back: commands that wait for the bus are not "
            "bounded (driver.max_in_flight), and the time at which a command left is when it was handed over"
        )
    if name not in REALTIME_STAMPS:
        found.append(
            f"driver.interface {name} has time stamps of its own clock: samples have the time of reading"
        )
    if name != "socketcan":
        found.append(
            f"driver.interface {name} belongs to the loop process: if that dies the supervisor cannot write "
            "neutral, and the amplifier's own watchdog is all there is"
        )
    return found
