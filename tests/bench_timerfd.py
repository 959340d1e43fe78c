"""The bare loop that the app is measured against: a timerfd on a fixed grid. Prints its p99 lateness [s]."""

from __future__ import annotations

import ctypes
import math
import os
import struct
import sys
import time

from circumnav_mav.runtime.realtime import settle

CLOCK_MONOTONIC = 1
TFD_TIMER_ABSTIME = 1


def main(rate_hz: float, for_s: float) -> float:
    libc = ctypes.CDLL(None, use_errno=True)
    timer = libc.timerfd_create(CLOCK_MONOTONIC, 0)
    start_ns = time.monotonic_ns() + 10_000_000
    period_ns = round(1e9 / rate_hz)
    spec = struct.pack("qqqq", 0, period_ns, start_ns // 10**9, start_ns % 10**9)
    if timer < 0 or libc.timerfd_settime(timer, TFD_TIMER_ABSTIME, spec, None) != 0:
        sys.exit("timerfd is not to be had here")
    settle()
    late_s, n = [], -1
    while n * period_ns < for_s * 1e9:
        (expired,) = struct.unpack("Q", os.read(timer, 8))
        n += expired
        late_s.append((time.monotonic_ns() - start_ns - n * period_ns) / 1e9)
    return sorted(late_s)[math.ceil(len(late_s) * 0.99) - 1]


if __name__ == "__main__":
    print(main(float(sys.argv[1]), float(sys.argv[2])))
