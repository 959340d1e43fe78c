"""The guidance laws, by the name that a configuration gives. A new law is one file and one line here."""

from __future__ import annotations

from circumnav_mav.guidance.kernel import Law
from circumnav_mav.guidance.laws import hashemi2013, tangent

LAWS: dict[str, Law] = {law.name: law for law in (hashemi2013.LAW, tangent.LAW)}
