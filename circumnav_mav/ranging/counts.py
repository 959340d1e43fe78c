"""What came in and what was turned away, by reason: the figures that the app shows, logs and reports."""

from __future__ import annotations

from circumnav_mav.types import RangeSample, Rejected


class Counts:
    """Accepted samples and rejections by reason, with the last detail of each reason in words."""

    def __init__(self) -> None:
        self.accepted = 0
        self.rejected: dict[str, int] = {}
        self.last_detail: dict[str, str] = {}

    def add(self, result: RangeSample | Rejected) -> None:
        if isinstance(result, RangeSample):
            self.accepted += 1
            return
        reason = str(result.reason)
        self.rejected[reason] = self.rejected.get(reason, 0) + 1
        self.last_detail[reason] = result.detail

    @property
    def total_rejected(self) -> int:
        return sum(self.rejected.values())
