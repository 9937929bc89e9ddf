"""How far a long piece of work is, told to whoever asked: a function, or a bar such as tqdm's."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable

    Told = Callable[[str, float], None]
    """Takes the step under way and how far all is, 0 to 1."""

Made = TypeVar("Made")
LOOK_S = 0.1


class Bar(Protocol):
    """What is used of a progress bar: tqdm has all of it.

    Attributes:
        n: How far it is.
        total: What it is when all is done; None counts as 1.
    """

    n: Any
    total: Any

    def update(self, n: float) -> Any:
        """Go on by so much."""

    def set_description(self, desc: str) -> Any:
        """Say what is being done."""


def teller(progress: Told | Bar | None) -> Told:
    """The function that takes progress, whatever was given."""
    if progress is None:
        return lambda _what, _part: None
    bar: Any = progress
    if not hasattr(bar, "update"):
        return progress  # type: ignore[return-value] # it is a function then

    def tell(what: str, part: float) -> None:
        bar.set_description(what)
        bar.update(max(0.0, part * (bar.total or 1.0) - bar.n))

    return tell


def followed(what: str, work: Callable[[], Made], fraction: Callable[[], float], told: Told | None) -> Made:
    """Do `work` in a thread and tell `fraction` of it meanwhile.

    Whatever it raises is raised here. An interrupt is heard at once, even while compiled code runs, and
    leaves the thread to the end of the process.
    """
    if told is None:
        return work()
    done: list[Made] = []
    raised: list[BaseException] = []

    def run() -> None:
        try:
            done.append(work())
        except BaseException as error:  # noqa: BLE001 - raised again by whoever waits
            raised.append(error)

    thread = threading.Thread(target=run, name=what, daemon=True)
    thread.start()
    while thread.is_alive():
        told(what, fraction())
        thread.join(LOOK_S)
    if raised:
        raise raised[0]
    told(what, 1.0)
    return done[0]
