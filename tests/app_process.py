"""The app as a user starts it, with two buttons: SIGUSR1 blocks its loop for 3 s, SIGUSR2 with the GIL held.

With PACE_FILE in the environment it keeps one clock with the stub, as a demo does.
"""

from __future__ import annotations

import ctypes
import os
import signal
import time
from pathlib import Path

from circumnav_mav import cli
from circumnav_mav.runtime.pace import PacedClock

signal.signal(signal.SIGUSR1, lambda *_: time.sleep(3.0))
signal.signal(signal.SIGUSR2, lambda *_: ctypes.PyDLL(None).usleep(3_000_000))
if pace_file := os.environ.get("PACE_FILE"):
    cli.Clock = lambda: PacedClock(1.0, Path(pace_file))
cli.main()
