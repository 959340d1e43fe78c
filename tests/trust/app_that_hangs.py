"""The app as a user starts it, with two buttons: SIGUSR1 blocks its loop for 3 s, SIGUSR2 with the GIL held."""

from __future__ import annotations

import ctypes
import signal
import time

from circumnav_mav.cli import main

signal.signal(signal.SIGUSR1, lambda *_: time.sleep(3.0))
signal.signal(signal.SIGUSR2, lambda *_: ctypes.PyDLL(None).usleep(3_000_000))
main()
