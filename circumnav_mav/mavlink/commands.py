"""Commands that need an answer: one at a time, asked again three times, and what failed is kept for people.

Mode requests do not go through here: PX4 answers them twice and only the mode itself is the verdict (offboard.py).
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from math import nan
from typing import NamedTuple

from circumnav_mav.mavlink.dialect import enums

RETRY_S = 0.5
TRIES = 4
IN_PROGRESS = 5


class Command(NamedTuple):
    """A COMMAND_LONG: id, its seven parameters, and what it is for, in words. With a frame, a COMMAND_INT."""

    command: int
    params: tuple[float, ...]
    purpose: str
    frame: int | None = None


@dataclass(frozen=True, slots=True)
class Failure:
    """A command that was refused (MAV_RESULT) or never answered (None)."""

    command: Command
    result: int | None

    def __str__(self) -> str:
        if self.result is None:
            return f"{self.command.purpose}: no answer from the autopilot"
        word = enums.enums["MAV_RESULT"][self.result].name if self.result in enums.enums["MAV_RESULT"] else self.result
        return f"{self.command.purpose}: refused by the autopilot ({str(word).removeprefix('MAV_RESULT_').lower()})"


class CommandQueue:
    """First in, first out, one outstanding."""

    def __init__(self) -> None:
        self._waiting: deque[Command] = deque()
        self._current: Command | None = None
        self._tries = 0
        self._next_s = nan
        self.failures: list[Failure] = []
        self.accepted: set[str] = set()
        """Purposes of the commands that were accepted."""

    def failure(self, purpose: str) -> Failure | None:
        """Return the newest failure of commands with this purpose."""
        return next((f for f in reversed(self.failures) if f.command.purpose == purpose), None)

    def push(self, command: int, *params: float, purpose: str, frame: int | None = None) -> None:
        """Queue a command; missing parameters are 0."""
        self._waiting.append(Command(command, params + (0.0,) * (7 - len(params)), purpose, frame))

    def add(self, command: Command) -> None:
        """Queue a command as it is."""
        self._waiting.append(command)

    def clear(self) -> bool:
        """Forget everything that is not done (the autopilot has restarted, or the aircraft is no longer ours).

        Return whether there was anything.
        """
        undone = self._current is not None or bool(self._waiting)
        self._waiting.clear()
        self._current = None
        return undone

    def on_ack(self, command: int, result: int) -> None:
        """Take in a COMMAND_ACK."""
        if self._current is None or command != self._current.command or result == IN_PROGRESS:
            return
        if result == enums.MAV_RESULT_ACCEPTED:
            self.accepted.add(self._current.purpose)
        else:
            self.failures.append(Failure(self._current, result))
        self._current = None

    def poll(self, now_s: float) -> list[Command]:
        """Return the command to send now, if one is due."""
        if self._current is None:
            if not self._waiting:
                return []
            self._current = self._waiting.popleft()
            self._tries, self._next_s = 0, now_s
        if now_s < self._next_s:
            return []
        if self._tries == TRIES:
            self.failures.append(Failure(self._current, None))
            self._current = None
            return []
        self._tries += 1
        self._next_s = now_s + RETRY_S
        return [self._current]
