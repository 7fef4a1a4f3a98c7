"""Part 4: hostile formulas of covariates and derived columns: read quickly, never run as Python."""

from __future__ import annotations

import faulthandler
import os
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from aleator.errors import AleatorError
from aleator.laws.covariates import DesignMatrix
from aleator.simulators.derived import parse
from hardening.judging import DONE, REFUSED, SLOW, TRACEBACK
from hardening.mutation import Damage

LIMIT = 0.5
"""Seconds of a processor that no text may take."""
ENDLESS = 60.0
"""Seconds of the clock after which the whole trial is ended, with a traceback of what hangs."""
WRITTEN = "written"
"""What is promised not to be, too: a text that made a file, or removed the one that was there."""
BROKEN = (TRACEBACK, SLOW, WRITTEN)
BYSTANDER = "bystander"

TABLE = pd.DataFrame(
    {
        "temp": np.linspace(10.0, 80.0, 24),
        "load": np.tile([1.0, 2.0, 4.0, 7.0], 6),
        "site": np.repeat(["a", "b", "c"], 8),
        "a b": np.linspace(-1.0, 1.0, 24) ** 2,
    },
    index=[f"E{k}" for k in range(24)],
)
PLAIN = ("temp", "load", "site", "`a b`", "1", "0", "2.5", "log(temp)", "C(site)", "temp*load")
RUNS = (
    "np.f2py.os.system('touch X')", "__import__('os').system('touch X')", "open('X', 'w')",
    "temp.__init__.__globals__['sys'].modules['os'].system('touch X')", "temp.to_csv('X')",
    "np.load('X.npy', allow_pickle=True)", "np.savetxt('X', [1])", "open('X','w').write('x')",
    "(lambda: open('X', 'w'))()", "[open('X', 'w') for _ in [1]]", "eval(\"open('X', 'w')\")",
    "exec(\"open('X', 'w')\")", "().__class__.__base__.__subclasses__()", "(x := open('X', 'w'))",
    "f\"{open('X', 'w')}\"", "temp if open('X', 'w') else 1", "getattr(temp, 'to_csv')('X')",
    "temp['a']", "contr.custom(open('X', 'w'))", "log(temp, out=open('X', 'w'))", "Q('temp')",
    "bs(temp, knots=open('X', 'w'))", "bs(temp, df=open('X', 'w'))", "print('x')", "*temp",
    "C(site, contr.treatment(base=open('X', 'w')))", "C(open('X', 'w'))", "os.remove('bystander')",
    "temp.values.tofile('X')", "pd.read_pickle('X')", "type(temp)", "log.__self__", "await temp",
)  # fmt: skip
LARGE = (
    "9**9**9", "2**2**2**2**2**2", "9.0**9**9", "10**400", "1e400", "-1e400", "'a'*10**10",
    "[0]*10**10", "(temp + load)**50", "(temp + load + site)**9", "(temp*load*site)**40",
    "bs(temp, df=10**9)", "bs(temp, df=1000000000)", "bs(temp, df=50)", "poly(temp, 10000000)",
    "poly(temp, degree=50)", "poly(temp, 1e9)", "cs(temp, df=999999)", "cr(temp, df=50)",
    "temp**1e308", "temp**temp**temp", "exp(exp(exp(temp)))", "1/(temp - temp)", "9"*1000,
)  # fmt: skip
LONG = (
    "-"*3000 + "temp", "+".join(["temp"]*3000), "("*3000 + "temp" + ")"*3000, "log("*900 + "temp",
    "log("*240 + "temp" + ")"*240, ":".join(["temp"]*400), "*".join(["temp", "load", "site"]*12),
    "**".join(["temp"]*200), "/".join(["temp"]*60), "temp + "*240 + "load", "{"*500, "`"*999,
    "max("*200 + "1" + ", temp)"*200, "+".join(f"temp**{k}" for k in range(1, 60)),
)  # fmt: skip
ODD = (
    "", " ", ".", "1 + .", "~", "temp ~ load", "temp | load", "\x00", "temp\n+ load", "`temp",
    "{temp}", "{", "}", "{{temp}}", "[temp]", "\ud800", "é", "٣", "1_000", "0x10", "temp; load",
    "temp # load", "C()", "C(", "I()", "center(1)", "poly(temp, raw=True)", "-1", "1 - 1", "1j",
    "True", "None", "...", "'temp'", "b'temp'", "temp @ load", "temp // load", "temp % 2",
    "temp,", "not temp", "temp < load", "temp & load", "~temp", "lag(temp)", "hashed(site)",
    "nan", "inf",
)  # fmt: skip
WITHIN = (
    "{}", "1 + {}", "I({})", "{{{}}}", "C({})", "log({})", "({})", "-({})", "({})*temp",
    "temp + {}", "bs({}, df=4)", "poly({}, 2)", "({})**2", "({0})*({0})", "center({})", "({}):load",
    "max({}, temp)", "({})**({})", "scale({}) + C(site)",
)  # fmt: skip
CHARACTERS = "()[]{}`'\"+-*/:|~^.,=#\\ \n09eE_aé"


@dataclass(frozen=True)
class Formulas:
    """How often what came of texts of each reader, and those that break the promise."""

    counts: Counter[tuple[str, str]]
    slowest: float
    broken: tuple[str, ...]


def hostile(number: int, seed: int) -> str:
    """The text of this number: one of the shapes within others, with some of its characters off."""
    chance = np.random.default_rng([seed, number])
    damage = Damage(chance)
    text = str(damage.choose(damage.choose((PLAIN, RUNS, RUNS, LARGE, LONG, ODD))))
    for _ in range(int(chance.integers(4))):
        within = str(damage.choose(WITHIN))
        text = within.replace("{0}", "{}").replace("{}", text).replace("{{", "{").replace("}}", "}")
    for _ in range(int(chance.integers(1, 4)) if chance.random() < 0.3 else 0):
        at = int(chance.integers(len(text) + 1))
        put = str(damage.choose(CHARACTERS)) if chance.random() < 0.6 else ""
        text = text[:at] + put + text[at + int(chance.integers(3)) :]
    return text


def _as_covariates(text: str) -> None:
    DesignMatrix.of(text, TABLE).at(TABLE)


def _as_derived(text: str) -> None:
    numbers = {name: TABLE[name].to_numpy() for name in ("temp", "load")}
    parse(text, [*numbers])(numbers)


READERS: dict[str, Callable[[str], None]] = {
    "formulas of covariates": _as_covariates,
    "derived columns": _as_derived,
}


def formulas(numbers: range, seed: int) -> Formulas:
    """Read so many texts by every reader, in a folder of their own."""
    counts, slowest, broken = Counter[tuple[str, str]](), 0.0, list[str]()
    here = Path.cwd()
    with tempfile.TemporaryDirectory(prefix="hardening-") as folder:
        os.chdir(folder)
        Path(BYSTANDER).touch()
        for read in READERS.values():
            read("temp")  # what is imported at first is not the time of a text
        try:
            for number in numbers:
                text = hostile(number, seed)
                for name, read in READERS.items():
                    outcome, took, words = _read(read, text)
                    counts[name, outcome] += 1
                    slowest = max(slowest, took)
                    if outcome in BROKEN:
                        broken.append(f"number {number}, {name}: {outcome}: {text!r:.300}\n{words}")
        finally:
            faulthandler.cancel_dump_traceback_later()
            os.chdir(here)
    return Formulas(counts, slowest, tuple(broken))


def _read(read: Callable[[str], None], text: str) -> tuple[str, float, str]:
    """What came of a text, the seconds of a processor that it took, and a traceback if any."""
    faulthandler.dump_traceback_later(ENDLESS, exit=True)
    began, outcome, words = time.process_time(), DONE, ""
    try:
        read(text)
    except AleatorError:
        outcome = REFUSED
    except Exception:
        outcome, words = TRACEBACK, traceback.format_exc()
    took = time.process_time() - began
    if [*map(str, Path().iterdir())] != [BYSTANDER]:
        outcome = WRITTEN
        for made in Path().iterdir():
            made.unlink()
        Path(BYSTANDER).touch()
    return (SLOW if took > LIMIT and outcome in (DONE, REFUSED) else outcome), took, words
