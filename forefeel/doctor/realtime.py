"""Is the loop permitted to run in real time, and how late does it wake up on this host?

Asked for in a process of its own, so that nothing of it stays.
"""

import json
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from forefeel.doctor.findings import Finding, Level
from forefeel.interrupt import at_last, ends_in_order
from forefeel.parent import child_environment

GROUP = "real time"
# s for which the loop is measured: 2000 ticks at 1 kHz; chosen, not measured: longer sees rarer delays
SECONDS = 2.0
# us of lateness at the 99th percentile: a quarter of a period at 1 kHz, and a whole one
_GOOD_US, _POOR_US = 250.0, 1000.0
FEW_MISSED = 0.001
"""Share of ticks; a loop that misses more is amber."""
_MANY = 0.01  # share of ticks; a loop that misses more is red; chosen, not measured: ten times `FEW_MISSED`
_LIMITS = (
    "permit it: systemd units have LimitRTPRIO and LimitMEMLOCK; else rtprio 90 and memlock unlimited for "
    "this user in /etc/security/limits.d, then log in again"
)


@dataclass(frozen=True, slots=True)
class Loop:
    """What a process with a 1 kHz loop got and did."""

    scheduling: str
    memory: str
    ticks: int
    missed: int
    p50_us: float
    p99_us: float
    max_us: float


@dataclass(frozen=True, slots=True)
class Kernel:
    """What the kernel says of itself; None: it does not say."""

    preempt_rt: bool | None
    governors: tuple[str, ...]
    isolated: str | None


def measure_loop(priority: int, seconds: float) -> Loop:
    """Runs a loop that does nothing, as a daemon would.

    Raises:
        RuntimeError: the process failed.
    """
    command = [sys.executable, "-m", "forefeel.doctor.realtime_child", str(priority), str(seconds)]
    with (
        ends_in_order("doctor"),
        subprocess.Popen(
            command,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,  # a terminal's Ctrl-C ends us, and so the child
            env=child_environment(),
        ) as process,
        at_last(process.kill),  # a signal may come before its first line, by which it dies with us
    ):
        out, errors = process.communicate(timeout=seconds + 30)
    if process.returncode != 0:
        raise RuntimeError(" ".join(errors.split())[-200:] or f"exit code {process.returncode}")
    return Loop(**json.loads(out))


def judge_loop(loop: Loop, priority: int) -> list[Finding]:
    """Permissions, then lateness."""
    findings = []
    if priority:
        granted = loop.scheduling.startswith("SCHED_FIFO")
        findings.append(_permission("scheduling", loop.scheduling, granted))
    else:
        findings.append(Finding(GROUP, "scheduling", "green", "normal, as realtime.priority 0 asks for"))
    findings.append(_permission("memory", loop.memory, loop.memory == "memory locked"))
    return [*findings, _lateness(loop)]


def _permission(subject: str, found: str, granted: bool) -> Finding:
    return (
        Finding(GROUP, subject, "green", found)
        if granted
        else Finding(GROUP, subject, "amber", found, _LIMITS)
    )


def _lateness(loop: Loop) -> Finding:
    share = loop.missed / max(1, loop.ticks + loop.missed)
    level: Level = "green"
    if loop.p99_us > _GOOD_US or share > FEW_MISSED:
        level = "amber"
    if loop.p99_us > _POOR_US or share > _MANY or not loop.ticks:
        level = "red"
    found = (
        f"p50 {loop.p50_us:.0f} us, p99 {loop.p99_us:.0f} us, worst {loop.max_us:.0f} us late; "
        f"{loop.missed} of {loop.ticks + loop.missed} missed"
    )
    advice = "end other work on this host, permit real time, set the cpufreq governor to performance"
    return Finding(GROUP, "1 kHz loop", level, found, "" if level == "green" else advice)


def read_kernel(system: Path = Path("/sys")) -> Kernel:
    """From /sys."""
    flag = _text(system / "kernel" / "realtime")
    cpus = sorted((system / "devices" / "system" / "cpu").glob("cpu[0-9]*/cpufreq/scaling_governor"))
    governors = tuple(dict.fromkeys(text for text in map(_text, cpus) if text))
    isolated = _text(system / "devices" / "system" / "cpu" / "isolated")
    return Kernel(flag == "1", governors, isolated)


def judge_kernel(kernel: Kernel) -> list[Finding]:
    """Information; a governor that saves power is amber."""
    rt = "PREEMPT_RT" if kernel.preempt_rt else "no PREEMPT_RT"
    isolated = f"isolated processors: {kernel.isolated}" if kernel.isolated else "no isolated processors"
    findings = [Finding(GROUP, "kernel", "green", f"{rt}; {isolated}")]
    if not kernel.governors:
        return [*findings, Finding(GROUP, "cpufreq governor", "green", "unknown: the kernel shows none")]
    saving = [name for name in kernel.governors if name != "performance"]
    level: Level = "amber" if saving else "green"
    advice = "cpupower frequency-set -g performance: others wake up later" if saving else ""
    return [*findings, Finding(GROUP, "cpufreq governor", level, ", ".join(kernel.governors), advice)]


def highest(priorities: Sequence[int]) -> int:
    """What to ask for when several daemons are looked at."""
    return max(priorities, default=50)


def _text(path: Path) -> str | None:
    try:
        return path.read_text(encoding="ascii").strip() or None
    except (OSError, UnicodeDecodeError):
        return None
