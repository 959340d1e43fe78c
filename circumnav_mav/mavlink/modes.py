"""What an autopilot calls its modes, and how it hands control over: one `ModeWords` an autopilot and airframe.

The numbers mean nothing across autopilots (4 is GUIDED on a copter, something else on a plane), so nobody else in the
app knows them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class ModeWords:
    """The custom_modes that the app knows by name, and the rules that go with the mode in which it flies.

    stream_first: setpoints must flow before the mode is entered (PX4). A pilot's choice of the mode is meant for this
        app if it streamed. Where it is False (ArduPilot) nothing may be streamed in other modes, because it would act
        the instant that somebody enters the mode; the choice is meant for this app if the mode APPEARS while the app
        is ready: a mode that was on before is somebody else's.
    leaves_when_silent: the autopilot leaves the mode when setpoints stop (PX4). Where it does not (ArduPilot holds its
        place in GUIDED after loss_timeout_s), this app gives up by itself after a silence that long.
    tells_intention: CURRENT_MODE is sent, with the mode that the autopilot means to return to (PX4). Where it is not,
        any mode but ours is settled: a stream changes nothing in it.
    """

    autopilot: str
    ours: int
    hold: int
    return_: int
    land: int | None
    names: Mapping[int, str]
    split: Callable[[int], tuple[int, int]]
    """custom_mode -> (param2, param3) of MAV_CMD_DO_SET_MODE."""
    stream_first: bool
    leaves_when_silent: bool
    tells_intention: bool
    loss_timeout_s: float
    loss_parameter: str
    """The parameter that holds loss_timeout_s; empty where it is fixed."""
    parameters: tuple[str, ...]
    """What a flight reads of the autopilot's settings; `check --live` reads more (settings_check.py)."""

    def name(self, custom_mode: int) -> str:
        """Return what people call the mode."""
        return self.names.get(custom_mode, f"mode {custom_mode:#x}" if custom_mode > 0xFFFF else f"mode {custom_mode}")

    @property
    def ours_name(self) -> str:
        """Return what people call the mode that the app flies in."""
        return self.name(self.ours)

    def hand_over(self, action: str) -> int | None:
        """Return the mode that on_range_lost asks for (hold, return, land); None for stop, which asks for none."""
        return {"hold": self.hold, "return": self.return_, "land": self.land, "stop": None}[action]
