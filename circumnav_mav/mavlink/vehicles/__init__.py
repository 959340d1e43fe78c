"""The vehicle classes by the name that a configuration gives. A new one is a file and a line here."""

from __future__ import annotations

from circumnav_mav.mavlink.vehicles.arduplane import ARDUPLANE
from circumnav_mav.mavlink.vehicles.multirotor_attitude import PX4_MULTIROTOR_ATTITUDE
from circumnav_mav.mavlink.vehicles.plug import VehicleClass
from circumnav_mav.mavlink.vehicles.px4_fixed_wing import PX4_FIXED_WING
from circumnav_mav.mavlink.vehicles.px4_fixed_wing_position import PX4_FIXED_WING_POSITION
from circumnav_mav.mavlink.vehicles.velocity import ARDUCOPTER, PX4_MULTIROTOR, PX4_ROVER

VEHICLES: dict[str, VehicleClass] = {
    vehicle.name: vehicle
    for vehicle in (
        PX4_MULTIROTOR,
        PX4_MULTIROTOR_ATTITUDE,
        PX4_FIXED_WING,
        PX4_FIXED_WING_POSITION,
        ARDUCOPTER,
        ARDUPLANE,
        PX4_ROVER,
    )
}
