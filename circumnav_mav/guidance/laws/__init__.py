"""The guidance laws, by the name that a configuration gives. A new law is one file and one line here."""

from __future__ import annotations

from circumnav_mav.guidance.kernel import Law
from circumnav_mav.guidance.laws import cao2013, hashemi2013, pd_bias, sliding_mode, tangent

LAWS: dict[str, Law] = {
    law.name: law
    for law in (
        hashemi2013.LAW,
        cao2013.OUTER,
        cao2013.SMOOTH,
        cao2013.SATURATED,
        sliding_mode.LAW,
        pd_bias.LAW,
        tangent.LAW,
    )
}
