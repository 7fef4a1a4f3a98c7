"""Part 1: damaged studies, tables, result files and stores, and what the commands say to them."""

from __future__ import annotations

import tempfile
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from hardening.damaged import KINDS
from hardening.judging import BROKEN, Verdict, judged
from hardening.sound import prepared


@dataclass(frozen=True)
class Mutations:
    """How often what came of which kind of damage, and the verdicts that break the promise."""

    counts: Counter[tuple[str, str]]
    slowest: float
    broken: tuple[Verdict, ...]


def mutations(
    numbers: range, seed: int, workers: int, say: Callable[[Verdict], None] = lambda _: None
) -> Mutations:
    """Try so many of them; `say` is told each verdict as it comes."""
    counts, slowest, broken = Counter[tuple[str, str]](), 0.0, list[Verdict]()
    with tempfile.TemporaryDirectory(prefix="hardening-") as folder:
        sound = Path(folder) / "sound"
        prepared(sound)
        for verdict in judged(numbers, seed, sound, workers):
            say(verdict)
            counts[KINDS[verdict.number % len(KINDS)], verdict.outcome] += 1
            slowest = max(slowest, verdict.seconds)
            if verdict.outcome in BROKEN:
                broken.append(verdict)
    return Mutations(counts, slowest, tuple(broken))
