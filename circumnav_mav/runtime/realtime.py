"""What the system and the garbage collector can be asked for, so that ticks are on time. None of it is needed."""

from __future__ import annotations

import gc
import os

PRIORITY = 40


def settle() -> str:
    """Freeze what is alive so that no collection ever walks it, and take real-time scheduling where it is permitted.

    Return what was reached, in words.
    """
    gc.collect()
    gc.freeze()
    try:
        # Children (the live view) must not inherit it.
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(PRIORITY))
    except (AttributeError, OSError):
        return "normal scheduling (real-time scheduling is not permitted here, and not needed)"
    return f"real-time scheduling, SCHED_FIFO {PRIORITY}"
