"""What a person should read: in the log, on the terminal, and where it matters on the ground station."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from circumnav_mav.mavlink.dialect import enums
from circumnav_mav.mavlink.link import AutopilotLink

WARNING, INFO = 4, 6
"""MAV_SEVERITY."""


class Event(NamedTuple):
    """Something a person should read."""

    t_s: float
    text: str
    severity: int


class Notices:
    """Collects events; `send` takes the frames of those that the ground station is told."""

    def __init__(self, link: AutopilotLink, send: Callable[[list[bytes]], None]) -> None:
        self.events: list[Event] = []
        self._link, self._send = link, send
        self._told: set[str] = set()
        self._failures_told = 0

    def say(self, now_s: float, text: str, severity: int) -> None:
        """Tell the log, the terminal and the ground station."""
        self.tell(now_s, text, severity)
        if self._link.autopilot.sysid is not None:
            self._send(self._link.announce.text(f"circumnav {text}", severity))

    def tell(self, now_s: float, text: str, severity: int) -> None:
        """Tell the log and the terminal."""
        self.events.append(Event(now_s, text, severity))

    def once(self, what: str) -> bool:
        """Return whether this is the first time that it is asked: some things are told once a flight."""
        first = what not in self._told
        self._told.add(what)
        return first

    def watch_link(self, now_s: float) -> None:
        """Tell what the autopilot did not do, or cannot, of what it was asked."""
        failures = self._link.commands.failures
        for failure in failures[self._failures_told :]:
            if failure.command.command != enums.MAV_CMD_SET_MESSAGE_INTERVAL:  # an autopilot may lack a stream
                self.tell(now_s, str(failure), WARNING)
        self._failures_told = len(failures)
        if self._link.signs_at_us and self.once("signing"):
            text = "the autopilot signs its messages: without vehicle.signing_key_file it obeys nothing"
            self.tell(now_s, text, WARNING)
        if (words := self._link.authority.rival_words(now_s)) and self.once("rival"):
            self.say(now_s, words, WARNING)
        ap = self._link.autopilot
        if ap.only is None and ap.strangers and self.once("strangers"):
            others = ", ".join(f"system {n}" for n in sorted(ap.strangers))
            text = f"{others} is another autopilot; system {ap.sysid} is flown: set vehicle.system_id"
            self.say(now_s, text, WARNING)
