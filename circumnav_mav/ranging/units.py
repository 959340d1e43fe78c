"""Units that ranging devices speak, as factors to SI."""

from __future__ import annotations

FOOT_M, INCH_M, YARD_M, MILE_M = 0.3048, 0.0254, 0.9144, 1609.344

LENGTH = {"m": 1.0, "dm": 0.1, "cm": 0.01, "mm": 0.001, "km": 1000.0, "ft": FOOT_M, "in": INCH_M, "yd": YARD_M}
SPEED = {
    "m/s": 1.0,
    "dm/s": 0.1,
    "cm/s": 0.01,
    "mm/s": 0.001,
    "km/h": 1 / 3.6,
    "ft/s": FOOT_M,
    "mph": MILE_M / 3600.0,
    "kn": 1852.0 / 3600.0,
}
TIME = {"s": 1.0, "ms": 1e-3, "us": 1e-6}
