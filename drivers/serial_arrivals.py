"""Whether bytes came on a serial line, found out without waiting for those who carry them.

A worker of the kernel, at ordinary priority, carries the bytes of every serial line from its interrupt to
its readers. A read or a poll that finds nothing waits until that worker has finished (`flush_work` in
`n_tty_read` and `n_tty_poll`): on a busy machine for milliseconds, whatever the reader's priority. An
edge-triggered epoll asks nobody: the worker itself tells it, after the bytes are there.
"""

from __future__ import annotations

import select


class Arrivals:
    """Of one line; whoever is told reads all there is, or is not told of the rest.

    Args:
        fd: Of the line, not blocking.
    """

    def __init__(self, fd: int) -> None:
        self._epoll = select.epoll()
        self._epoll.register(fd, select.EPOLLIN | select.EPOLLET)

    def wait(self, timeout: float) -> bool:
        """Whether something comes, or the line hangs up, within `timeout` [s]; it is still to be `taken`."""
        return bool(select.select([self._epoll], [], [], timeout)[0])

    def taken(self) -> bool:
        """Whether something came since this was last asked."""
        return bool(self._epoll.poll(0, 1))

    def close(self) -> None:
        """Give the descriptor back."""
        self._epoll.close()
