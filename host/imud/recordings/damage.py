# SPDX-License-Identifier: MIT
"""Damage of a log on disk, apart from losses on the wire."""

from __future__ import annotations

from collections import Counter

from imud.log.parts import Damage


class DamageCount:
    """Follows the damage of one log, and the gaps in the numbers of its probes that are
    of it: the first of each probe behind a damaged place.
    """

    def __init__(self) -> None:
        self.places = 0
        self.bytes = 0
        self.is_cut = False  # it is truncated
        self.lost = Counter[str]()  # messages, by probe
        self._due: dict[str, int] = {}  # damaged places that a probe's gap was told of

    def add(self, damage: Damage) -> None:
        self.bytes += damage.size
        self.places += not damage.is_tail
        self.is_cut = self.is_cut or damage.is_tail

    def hear(self, probe: str, lost: int) -> None:
        """A message of that probe, with so many lost before it."""
        if self._due.get(probe, 0) != self.places:
            self._due[probe] = self.places
            self.lost[probe] += max(0, lost)

    def words(self) -> str:
        """Where it is damaged; empty: nowhere. A truncated log has
        nothing else wrong: imud was killed, or still writes it.
        """
        if not self.places:
            return ""
        places = "1 place" if self.places == 1 else f"{self.places} places"
        cut = " and truncated" if self.is_cut else ""
        return (
            f"damaged in {places}{cut}; the intact part was read, imud recover saves it"
        )
