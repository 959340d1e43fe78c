"""Near overhead: said, not flown on, and the vehicle goes on by what it knows."""

from __future__ import annotations

from tests.lockstep import Rig, airborne, config


def test_near_overhead_is_said_once_and_counted():
    app = config(ranging={"target_height_m": 0.0})
    rig = Rig(app, airborne(distance_m=3.0, beacon_height_m=0.0, height_m=30.0))
    rig.run(6.0)
    assert rig.flight.rejected["overhead"] > 30
    said = [event.text for event in rig.flight.events if "near overhead" in event.text]
    assert len(said) == 1
    assert "m above the target" in said[0]
    assert rig.log.phases[-1] == "waiting_range"
    assert not rig.setpoints()
