# SPDX-License-Identifier: MIT
"""The outcome of the records of one sink."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Mapping
from typing import NamedTuple


class LaneCounts(NamedTuple):
    """Records of one sink: taken by probe and topic, the others by probe."""

    taken: defaultdict[str, Counter[str]]
    dropped: Counter[str]
    earlier: Counter[str]  # put before there was such a sink

    @staticmethod
    def none() -> LaneCounts:
        return LaneCounts(defaultdict(Counter), Counter(), Counter())

    def after(self, before: LaneCounts, names: Mapping[str, str]) -> LaneCounts:
        """These counts and those before them; `names` are old and new names."""
        total = LaneCounts.none()
        for counts, renamed in ((self, {}), (before, names)):
            for probe, by_topic in counts.taken.items():
                total.taken[renamed.get(probe, probe)] += by_topic
            for probe, count in counts.dropped.items():
                total.dropped[renamed.get(probe, probe)] += count
            for probe, count in counts.earlier.items():
                total.earlier[renamed.get(probe, probe)] += count
        return total
