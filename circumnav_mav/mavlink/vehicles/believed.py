"""An airspeed that nobody measures: what pitch, roll and turn rate make of it.

A multirotor's thrust holds it up, so its tilt pulls it along with g tan(tilt). The drag that balances the configured
pitch at the configured speed is taken as linear in the speed, k = g tan(-pitch0) / V0:

    forward' = g tan(-pitch) - k forward + r right,    right' = g tan(roll) - k right - r forward,    r = yaw rate

So it gathers speed in seconds, not at once; hovering in still air it has none; and in a turn that is not coordinated it
slips. An estimator that is told V0 straight ahead all the time does not find ranges and motion to belong together.
"""

from __future__ import annotations

from math import atan2, hypot, isnan, nan, tan

from circumnav_mav.mavlink.autopilot import VehicleState
from circumnav_mav.mavlink.setpoints import G_M_S2

LONGEST_STEP_S = 0.1
SLOW_M_S = 1.0
"""Below this speed the slip is that of a vehicle this fast: the direction of hardly any motion is noise."""


class BelievedSpeed:
    """The air's velocity in the body's axes; speed_m_s is flown at pitch_rad (nose up, so below 0) in still air."""

    def __init__(self, speed_m_s: float, pitch_rad: float) -> None:
        self._drag_per_s = G_M_S2 * tan(-pitch_rad) / speed_m_s
        self._last_s = nan
        self.forward_m_s = self.right_m_s = 0.0

    @property
    def speed_m_s(self) -> float:
        """Airspeed."""
        return hypot(self.forward_m_s, self.right_m_s)

    @property
    def slip_rad(self) -> float:
        """From the nose to the course through the air, + clockwise."""
        return atan2(self.right_m_s, max(self.forward_m_s, SLOW_M_S))

    def advance(self, now_s: float, state: VehicleState, *, on_ground: bool = False) -> None:
        """Fly the attitude of now since the last call; without one the speed stays as it is. On the ground it is 0."""
        dt, self._last_s = now_s - self._last_s, now_s
        if on_ground:  # it stands, however the ground slopes
            self.forward_m_s = self.right_m_s = 0.0
            return
        if not dt > 0.0 or isnan(state.roll_rad + state.pitch_rad + state.yaw_rate_rad_s):
            return
        steps = max(1, round(dt / LONGEST_STEP_S))
        for _ in range(min(steps, 100)):
            f, r, yaw_rate = self.forward_m_s, self.right_m_s, state.yaw_rate_rad_s
            self.forward_m_s += (G_M_S2 * tan(-state.pitch_rad) - self._drag_per_s * f + yaw_rate * r) * dt / steps
            self.right_m_s += (G_M_S2 * tan(state.roll_rad) - self._drag_per_s * r - yaw_rate * f) * dt / steps
