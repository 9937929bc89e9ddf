"""The supervisor, the daemon's main process: watches loop and gateway, writes neutral when the loop cannot.

Tiny on purpose, standard library only: it must stay in memory, start at once and never be the one that hangs.
It runs under SCHED_FIFO one above the loop, so that a loop gone wild cannot keep it from acting.
"""

from __future__ import annotations

import json
import math
import os
import select
import signal
import sys
import time
from functools import partial
from pathlib import Path
from typing import Any

from drivers.neutral import NeutralWriter, open_neutral
from seod.processes import journal
from seod.processes.handover import ChildArguments, die_with_parent, receive_json, send_json
from seod.processes.realtime import lock_memory, set_fifo
from seod.processes.ring import Shared, Word
from seod.supervisor.arguments import SupervisorArguments
from seod.supervisor.child import Child
from seod.supervisor.keeper import Keeper, Way
from seod.supervisor.say import say
from seod.supervisor.sdnotify import notify, watchdog_interval

GATEWAY_RESTARTS = 5
STILL_POLLS = 4
"""The loop hangs if it did not tick over this many polls in a row (a paused machine pauses the polls too)."""
BEAT_S = 0.02
"""Longest poll: the loop goes to neutral when no turn of ours came for `guard.SUPERVISOR_SILENT_S`."""
START_TIMEOUT_S = 60.0
WRITTEN = "neutral written"


class Supervisor:
    """Keeps the rig safe while the other two processes come and go."""

    def __init__(self, arguments: SupervisorArguments) -> None:
        self.arguments = arguments
        self.shared = Shared(arguments.axes, arguments.rows)
        self.poller = select.poll()
        self.wake_read, self.wake_write = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)
        self.poller.register(self.wake_read, select.POLLIN)
        self.loop: Child | None = None
        self.gateway: Child | None = None
        names = [name for name, wanted in (("panel", arguments.panel), ("fleet", arguments.fleet)) if wanted]
        self.way: Way | None = None
        self.keepers: list[Keeper] = []
        if names:
            self.way = Way()
            own_end = self.way.own_end.fileno()
            self.keepers = [Keeper(name, partial(self.child, f"seod.{name}", own_end)) for name in names]
        self.generation = 0
        self.gateway_starts = 0
        self.neutral: NeutralWriter = open_neutral({"kind": "none", "why": "the loop never opened the rig"})
        self.holding_neutral = False
        self.fenced = ""
        """What came of the neutral that was written as the loop was fenced; "" where it was not."""
        self.death: dict[str, object] = {}
        """Of the last loop, as the gateway was told; {} while there is one."""
        self.ticks_seen = -1
        self.still = 0
        self.gateway_seen, self.gateway_turned, self.looked = -1, 0.0, 0.0
        self.ending = False
        self.exit_code = 0
        self.announced = False
        self.ticks_fed = 0
        self.began = time.monotonic()
        self.ends_at = math.inf
        self.fed = 0.0
        self.watchdog = watchdog_interval()
        self.hang_polls = max(STILL_POLLS, math.ceil(arguments.hang_timeout / BEAT_S))
        self.poll_s = arguments.hang_timeout / self.hang_polls or 0.02

    def run(self) -> int:
        """Until a signal, the end of the time, or a failure that leaves nothing to supervise."""
        self.start_gateway()
        self.start_loop()
        while not self.ending:
            for fd, _ in self.poller.poll(self.poll_s * 1e3):
                self.serve(fd)
            self.shared.words[Word.BEATS] += 1
            self.watch_ticks()
            self.watch_gateway()
            self.announce()
            self.feed_watchdog()
            self.watch_times()
        self.shut_down()
        return self.exit_code

    def serve(self, fd: int) -> None:
        """Something happened on a descriptor."""
        if fd == self.wake_read:
            self.take_signals()
        elif self.loop is not None and fd == self.loop.pidfd:
            self.loop_died(self.loop)
        elif self.gateway is not None and fd == self.gateway.pidfd:
            self.gateway_died(self.gateway)
        elif self.loop is not None and fd == self.loop.link.fileno():
            self.hear_loop(self.loop)
        elif self.gateway is not None and fd == self.gateway.link.fileno():
            self.hear_gateway(self.gateway)
        else:
            self.hear_keeper(fd)

    def hear_keeper(self, fd: int) -> None:
        """Panel or fleet says something, or has ended."""
        for keeper in self.keepers:
            child = keeper.child
            if child is not None and fd == child.pidfd:
                keeper.died(self.drop)
                return
            if child is not None and fd == child.link.fileno():
                if not keeper.hear():
                    self.forget_link(child)
                return

    def take_signals(self) -> None:
        """SIGTERM and SIGINT end the daemon."""
        os.read(self.wake_read, 64)
        self.ending = True

    def child(self, module: str, panel_fd: int = -1) -> Child:
        """Start a child and watch it."""
        arguments = ChildArguments(
            config_fd=self.arguments.config_fd,
            shared_fd=self.shared.fd,
            supervisor_fd=-1,
            supervisor_pid=os.getpid(),
            axes=self.arguments.axes,
            rows=self.arguments.rows,
            generation=self.generation,
            record=self.record(),
            config_path=self.arguments.config_path,
            panel_fd=panel_fd,
        )
        child = Child(module, arguments)
        self.poller.register(child.pidfd, select.POLLIN)
        self.poller.register(child.link.fileno(), select.POLLIN)
        return child

    def record(self) -> str | None:
        """File to record to; a gateway that was started again begins another one."""
        name, again = self.arguments.record, self.gateway_starts > 1
        if not (name and again):
            return name
        path = Path(name)
        return str(path.with_suffix(f".start{self.gateway_starts}{path.suffix}"))

    def drop(self, child: Child) -> None:
        """Stop watching a child that ended."""
        self.poller.unregister(child.pidfd)
        self.forget_link(child)
        child.close()

    def forget_link(self, child: Child) -> None:
        """Its socket is at its end: nothing more comes, the pidfd tells the rest."""
        try:
            self.poller.unregister(child.link.fileno())
        except KeyError:
            return

    def start_loop(self) -> None:
        """Start the next loop process; it takes over writing to the rig once it is ready."""
        self.generation += 1
        self.death = {}
        self.tell_gateway({"loop": "starting", "generation": self.generation})
        self.loop = self.child("seod.loop")

    def start_gateway(self) -> None:
        """Start the gateway process."""
        self.gateway_starts += 1
        self.gateway = self.child("seod.gateway", -1 if self.way is None else self.way.gateway_end.fileno())
        if self.death:  # which the gateway before knew, and this one could not
            self.tell_gateway(self.death)

    def hear_loop(self, loop: Child) -> None:
        """The loop says how neutral can be written without it, and when it is ready."""
        message = receive_json(loop.link)
        if message == {}:
            self.forget_link(loop)
        if not message:
            return
        if message["loop"] == "open":
            self.neutral.close()
            recipe: Any = message["recipe"]
            self.neutral = open_neutral(recipe)
        elif message["loop"] == "failed":
            loop.failure = str(message["why"])
        elif message["loop"] == "ready":
            loop.ready, self.holding_neutral = True, False
            self.ticks_seen, self.still = -1, 0
            for why in message["warnings"] if isinstance(message["warnings"], list) else []:
                self.say(f"warning: not real-time: {why}", journal.WARNING, "not_realtime")

    def hear_gateway(self, gateway: Child) -> None:
        """The gateway says that it listens, or that a client reset a rig whose loop is dead."""
        message = receive_json(gateway.link)
        if message == {}:
            self.forget_link(gateway)
        if not message:
            return
        if message.get("gateway") == "ready":
            gateway.ready = True
            self.say(f"{self.arguments.rig}: JSON-RPC on port {message['port']}")
        elif message.get("gateway") == "failed":
            gateway.failure, gateway.ready = str(message["why"]), False
        elif message.get("op") == "restart_loop" and self.loop is None:
            self.start_loop()

    def announce(self) -> None:
        """Tell systemd once both children are ready and a tick is done; the time given by --for begins."""
        if self.announced or not (self.loop and self.loop.ready and self.gateway and self.gateway.ready):
            return
        if not self.shared.words[Word.TICKS]:
            return
        self.announced = True
        if self.arguments.duration is not None:
            self.ends_at = time.monotonic() + self.arguments.duration
        notify(f"READY=1\nSTATUS={self.arguments.rig}: running")
        for keeper in self.keepers:  # now: they must not hold up what the rig depends on
            keeper.start()

    def watch_ticks(self) -> None:
        """A loop that is ready but does not tick is fenced; a rig without a loop is held at neutral."""
        if self.holding_neutral:
            self.write_neutral()
        if self.loop is None or not self.loop.ready or self.arguments.hang_timeout == 0:
            return
        ticks = self.shared.words[Word.TICKS]
        self.still = self.still + 1 if ticks == self.ticks_seen else 0
        self.ticks_seen = ticks
        if self.still >= self.hang_polls:
            silent = self.arguments.hang_timeout * 1e3
            self.loop.failure = f"hung: no tick for {silent:.0f} ms, so it was fenced and killed"
            self.fence(self.loop)

    def watch_gateway(self) -> None:
        """A gateway that is ready but does not turn is killed: that ends it as if it had died."""
        now, turns = time.monotonic(), self.shared.words[Word.GATEWAY_BEAT]
        paused, self.looked = now - self.looked > STILL_POLLS * self.poll_s, now
        if self.gateway is None or not self.gateway.ready or turns != self.gateway_seen or paused:
            self.gateway_seen, self.gateway_turned = turns, now
        elif now - self.gateway_turned > self.arguments.gateway_timeout:
            silent = self.arguments.gateway_timeout * 1e3
            self.gateway.failure = f"hung: no turn for {silent:.0f} ms, so it was killed"
            self.gateway.ready = False
            self.gateway.signal(signal.SIGKILL)

    def fence(self, loop: Child) -> None:
        """Shut the loop out, kill it, and write neutral.

        A process that is killed never runs again, also one that was stopped just before it sent: so the kill
        comes before the neutral, for the supervisor itself may die in between.
        """
        self.shared.words[Word.FENCE] = self.generation
        loop.signal(signal.SIGKILL)
        self.fenced = self.write_neutral()
        self.still = 0
        loop.ready = False

    def loop_died(self, loop: Child) -> None:
        """Neutral at once and from now on; say why; wait for somebody to reset."""
        self.shared.words[Word.FENCE] = self.generation
        self.holding_neutral = True
        written = self.write_neutral()
        if self.fenced == WRITTEN:  # just before: now the queue may be full of neutral
            written = WRITTEN
        self.fenced = ""
        self.hear_loop(loop)  # its last words may still be under way
        hung, how = loop.failure, loop.end_of()
        why = hung or how
        self.drop(loop)
        self.loop = None
        self.say(f"the loop process {why}; {written}", journal.ERROR, "loop_died")
        notify(f"STATUS={self.arguments.rig}: fault: the loop process {why}")
        self.death = {
            "loop": "died",
            "t": time.monotonic(),
            "generation": self.generation,
            "why": f"the loop process {why}",
            "neutral": written,
        }
        self.tell_gateway(self.death)
        if not self.announced and not self.ending:
            self.ending, self.exit_code = True, 1

    def gateway_died(self, gateway: Child) -> None:
        """Stop the rig, for nobody could stop it over TCP; then start the gateway again."""
        self.hear_gateway(gateway)  # its last words may still be under way
        if self.loop is not None and self.loop.ready:
            self.loop.signal(signal.SIGUSR1)
        why = gateway.failure or gateway.end_of()
        gateway.process.wait()
        self.drop(gateway)
        self.gateway = None
        self.say(f"the gateway process {why}", journal.ERROR, "gateway_died")
        if not self.announced or self.gateway_starts > GATEWAY_RESTARTS:
            self.ending, self.exit_code = True, 1
        else:
            self.start_gateway()

    def write_neutral(self) -> str:
        """Write neutral without the loop; returns what came of it, for people."""
        why = self.neutral.write(self.shared.words[Word.COMMANDS_SENT])
        return f"neutral not written: {why}" if why else WRITTEN

    def tell_gateway(self, message: dict[str, object]) -> None:
        """Tell the gateway, if there is one."""
        if self.gateway is not None:
            send_json(self.gateway.link, message)

    def feed_watchdog(self) -> None:
        """Feed systemd's watchdog by ticks that were done, or while there is no loop that could do any."""
        now, ticks = time.monotonic(), self.shared.words[Word.TICKS]
        if now - self.fed < self.watchdog:
            return
        if ticks != self.ticks_fed or self.loop is None or not self.loop.ready:
            self.fed, self.ticks_fed = now, ticks
            notify("WATCHDOG=1")

    def watch_times(self) -> None:
        """End when the time is up, or when the start takes too long."""
        now = time.monotonic()
        if now >= self.ends_at:
            self.ending = True
        elif not self.announced and now - self.began > START_TIMEOUT_S:
            self.say(
                f"loop and gateway were not ready within {START_TIMEOUT_S:.0f} s", journal.ERROR, "start"
            )
            self.ending, self.exit_code = True, 1

    def say(self, text: str, priority: int = journal.INFO, code: str = "") -> None:
        """One line for the journal, with the rig's name as a field, or for the terminal."""
        if not journal.tell(f"seod: {text}", priority, RIG=self.arguments.rig, CODE=code):
            say(text)

    def still_here(self) -> None:
        """Children may take longer to end than systemd's watchdog waits."""
        notify("WATCHDOG=1")

    def shut_down(self) -> None:
        """Loop first (it writes neutral), our own neutral after it, then the gateway."""
        notify("STOPPING=1")
        if self.loop is not None:
            self.loop.end(self.still_here)
            self.shared.words[Word.FENCE] = self.generation
            self.write_neutral()
        for keeper in self.keepers:
            keeper.end()
        if self.gateway is not None:
            self.tell_gateway({"stop": True})
            self.gateway.end(self.still_here)
            if self.gateway.process.returncode > 0:  # it has said what its recording lacks
                self.exit_code = 1
        self.neutral.close()
        if self.way is not None:
            self.way.close()


def install_signals(wake_fd: int) -> None:
    """SIGTERM, SIGINT and SIGHUP wake the poll; a stop from the terminal would leave the rig alone."""
    signal.set_wakeup_fd(wake_fd)
    for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
        signal.signal(number, lambda *_: None)
    signal.signal(signal.SIGTSTP, signal.SIG_IGN)


def main() -> int:
    """Entry point of the supervisor process."""
    arguments = SupervisorArguments(**json.loads(sys.argv[1]))
    if arguments.parent is not None:
        die_with_parent(arguments.parent)
    supervisor = Supervisor(arguments)
    install_signals(supervisor.wake_write)
    for why in (set_fifo(arguments.priority + 1), lock_memory()):
        if why:
            say(f"warning: supervisor: {why}")
    return supervisor.run()
