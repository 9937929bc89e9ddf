"""What in this machine's settings makes programs wake up late, and how to change it."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Machine:
    """Settings that matter to a real-time loop; None where the machine does not tell.

    Attributes:
        kernel: Release.
        cpu: Model of the processor.
        cpus: Number of processors.
        virtual: It is a virtual machine.
        preempt_rt: The kernel is a PREEMPT_RT one.
        governors: Frequency governors in use.
        isolated: Processors taken out of ordinary scheduling, as the kernel writes them ("2-3", "" for none).
        rt_runtime_us: Microseconds that real-time processes may take out of `rt_period_us`; -1 for all.
        rt_period_us: See there.
    """

    kernel: str
    cpu: str
    cpus: int
    virtual: bool
    preempt_rt: bool
    governors: tuple[str, ...]
    isolated: str
    rt_runtime_us: int | None
    rt_period_us: int | None

    def describe(self) -> str:
        """One line."""
        kind = "PREEMPT_RT" if self.preempt_rt else "not PREEMPT_RT"
        where = ", virtual machine" if self.virtual else ""
        return f"{self.cpu}, {self.cpus} processors{where}; Linux {self.kernel}, {kind}"

    def advice(self) -> list[str]:
        """What to change, as sentences with the command that does it; the most effective first."""
        return [*self._kernel(), *self._isolation(), *self._governor(), *self._throttling()]

    def _kernel(self) -> list[str]:
        found = []
        if self.virtual:
            found.append(
                "This is a virtual machine: its host decides when it runs, and nothing in here changes that. "
                "Measure on the computer that stands beside the rig."
            )
        if not self.preempt_rt:
            found.append(
                "The kernel is not PREEMPT_RT, so its own work can hold the loop up: "
                "`sudo apt-get install linux-image-rt-amd64` (Debian) or `sudo pro enable realtime-kernel` "
                "(Ubuntu), then reboot."
            )
        return found

    def _isolation(self) -> list[str]:
        if self.isolated:
            first = self.isolated.replace("-", ",").split(",")[0]
            return [
                f"Processors {self.isolated} are isolated: `loop: {{cpu: {first}}}` in the rig file puts the "
                "loop there, unless it is there already."
            ]
        if self.cpus < 2:
            return []
        last = self.cpus - 1
        return [
            "No processor is isolated, so the loop shares its own with everything else: add "
            f"`isolcpus={last} nohz_full={last} rcu_nocbs={last}` to GRUB_CMDLINE_LINUX in "
            "/etc/default/grub, `sudo update-grub`, reboot, and write "
            f"`loop: {{cpu: {last}}}` into the rig file."
        ]

    def _governor(self) -> list[str]:
        slow = sorted(set(self.governors) - {"performance"})
        if not slow:
            return []
        return [
            f"The frequency governor is {', '.join(slow)}: a processor that has slowed down needs time to "
            "speed up. `echo performance | sudo tee /sys/devices/system/cpu/cpu*/cpufreq/scaling_governor`"
        ]

    def _throttling(self) -> list[str]:
        if self.rt_runtime_us is None or self.rt_runtime_us < 0 or not self.rt_period_us:
            return []
        share = 100 * self.rt_runtime_us / self.rt_period_us
        return [
            f"Real-time processes are stopped once they have used {share:.0f} % of a second: a loop that "
            "takes less never notices, and one that runs wild can still be ended. To lift it: "
            "`sudo sysctl -w kernel.sched_rt_runtime_us=-1`"
        ]


def read_machine(root: Path = Path("/")) -> Machine:
    """Read this machine's settings below `root`; what cannot be read is taken as absent."""
    proc, cpu = root / "proc", root / "sys/devices/system/cpu"
    cpuinfo = _text(proc / "cpuinfo")
    governors = sorted(cpu.glob("cpu[0-9]*/cpufreq/scaling_governor"))
    return Machine(
        kernel=_text(proc / "sys/kernel/osrelease") or "unknown",
        cpu=_field(cpuinfo, "model name") or os.uname().machine,
        cpus=cpuinfo.count("processor\t") or 1,
        virtual=" hypervisor" in _field(cpuinfo, "flags"),
        preempt_rt=_text(root / "sys/kernel/realtime") == "1",
        governors=tuple(_text(path) for path in governors),
        isolated=_text(cpu / "isolated"),
        rt_runtime_us=_integer(proc / "sys/kernel/sched_rt_runtime_us"),
        rt_period_us=_integer(proc / "sys/kernel/sched_rt_period_us"),
    )


def _text(path: Path) -> str:
    try:
        return path.read_text().strip()
    except OSError:
        return ""


def _integer(path: Path) -> int | None:
    text = _text(path)
    return int(text) if text else None


def _field(cpuinfo: str, name: str) -> str:
    """Value of the first line `name : value`."""
    lines = (line.partition(":") for line in cpuinfo.splitlines())
    return next((value.strip() for key, _, value in lines if key.strip() == name), "")
