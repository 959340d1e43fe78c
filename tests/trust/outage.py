"""An outage of the link, both ways; and the rule that PX4 makes necessary: a stream that resumes after it takes nothing
back.
"""

from __future__ import annotations

from typing import Any

import pytest

from sitl_stub.commander import ACCEPTED, Commander
from sitl_stub.modes import Mode
from tests.lockstep import OFFBOARD_LINK, Rig


def outage(rig: Rig, for_s: float) -> list[str]:
    """No frame of the app's link passes, either way; return the modes of the vehicle, tick by tick."""
    receive, modes = rig.stub.receive, []
    with pytest.MonkeyPatch.context() as cut:
        cut.setattr(rig, "deaf", True)
        cut.setattr(rig.stub, "receive", lambda link, data: None if link == OFFBOARD_LINK else receive(link, data))
        for _ in range(round(for_s / rig.tick_s)):
            rig.step()
            modes.append(rig.stub.truth().mode)
    return modes


def watch(patch: pytest.MonkeyPatch) -> list[float]:
    """Return a list that gets the time of every return to OFFBOARD that no request had a part in, for the rest of the
    flight: the stub left it because setpoints were missing, and a setpoint alone brought it back.
    """
    returns: list[float] = []
    starved: set[int] = set()
    request, update = Commander.request_mode, Commander.update

    def asked(self: Any, mode: Mode, *more: Any, **words: Any) -> int:
        result = request(self, mode, *more, **words)
        if result == ACCEPTED:
            starved.discard(id(self))
        return result

    def updated(self: Any, now_s: float, on_ground: bool) -> None:
        before = self.mode
        update(self, now_s, on_ground)
        if before is Mode.OFFBOARD and self.mode is not Mode.OFFBOARD and not self.offboard_ok:
            starved.add(id(self))
        elif self.mode is Mode.OFFBOARD and before is not Mode.OFFBOARD and self.armed and id(self) in starved:
            returns.append(now_s)

    patch.setattr(Commander, "request_mode", asked)
    patch.setattr(Commander, "update", updated)
    return returns
