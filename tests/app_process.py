"""The app as a process, as a user starts it, but for its clock and two buttons.

With PACE_FILE in the environment it keeps one clock with the stub, as a demo does, at PACE_SPEED times real time: a
machine that stands still for two seconds holds both up, and is no silence between them. Without, either would find the
other gone, and rightly let go.

The buttons hang its loop until a byte comes on its stdin: SIGUSR1 (for 2.5 s at least, counted in naps as the watchdog
counts them), and SIGUSR2 with the GIL held. So it hangs for as long as the test's own clock says, whoever stands still.
"""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

from sitl_stub.pace import SIZE, Pace

ROOT = Path(__file__).parents[1]
NAP_S, NAPS = 0.05, 50


def start_app(*arguments: str, pace_file: Path, speed: float = 1.0, **more) -> subprocess.Popen:
    """Start `circumnav` with these arguments; it keeps its clock with whoever opens `pace_file`.

    speed: flight seconds a wall second, of both.
    """
    pace_file.unlink(missing_ok=True)
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "PACE_FILE": str(pace_file), "PACE_SPEED": str(speed)}
    return subprocess.Popen([sys.executable, "-m", "tests.app_process", *arguments], env=environment, **more)


def wait_for_pace(pace_file: Path, child: subprocess.Popen) -> Path:
    """Return `pace_file` as soon as the app has made it."""
    while not (pace_file.exists() and pace_file.stat().st_size == SIZE):
        assert child.poll() is None, "the app has ended before it flew"
        time.sleep(0.01)
    return pace_file


class Alone(Pace):
    """The vehicle's end of a pace file that tells the app the time, and no longer waits for it: the app is to hang."""

    def limit_s(self, now_s: float, wall_s: float) -> float:
        super().limit_s(now_s, wall_s)
        return float("inf")


def hang() -> None:
    for _ in range(NAPS):
        time.sleep(NAP_S)
    os.read(0, 1)


def hang_with_the_gil() -> None:
    ctypes.PyDLL(None).read(0, ctypes.create_string_buffer(1), 1)


if __name__ == "__main__":
    from circumnav_mav import cli
    from circumnav_mav.runtime import live_check
    from circumnav_mav.runtime.pace import PacedClock

    signal.signal(signal.SIGUSR1, lambda *_: hang())
    signal.signal(signal.SIGUSR2, lambda *_: hang_with_the_gil())
    if pace_file := os.environ.get("PACE_FILE"):
        cli.Clock = live_check.Clock = lambda: PacedClock(float(os.environ.get("PACE_SPEED", "1")), Path(pace_file))
    cli.main()
