"""One damaged study, table, result file or store, and the command that is given it."""

from __future__ import annotations

import json
import shutil
import sqlite3
from contextlib import closing, suppress
from pathlib import Path

import numpy as np

from hardening.mutation import Damage
from hardening.sound import OPTIONS, REPLICATED, RESULTS, STORE, STUDIES, as_toml

COLUMNS = {
    "runs": ("x", "outcome", "failure", "log", "seconds", "host", "time", "attempt", '"case"'),
    "cases": ("hash", "conditions", "parameters", "simulator"),
    "simulators": ("fingerprint", "name", "description", "version", "first_seen"),
}
IDENTIFY = ("identify", "study.toml", "--no-figures", "--quiet", "--output", "out")
PREDICT = ("predict", "out/identification.json", "--at", "new.csv", "--quiet")
LIGHT = (
    ("box", "study.toml", "--quiet"),
    ("sensitivity", "study.toml", "--quiet", "--no-figures", "--output", "out"),
)
READERS: dict[str, tuple[tuple[str, ...], ...]] = {
    "result, report": (("report", "out"),),
    "result, compared": (("report", "before", "--compare", "out"),),
    "result, predict": (
        PREDICT,
        (*PREDICT, "--no-uncertainty"),
        (*PREDICT, "--no-uncertainty", "--no-noise"),
        (*PREDICT, "--of", "A"),
        (*PREDICT, "--output", "told.json"),
    ),
    "result, decide": (
        (*PREDICT, "--no-uncertainty", "--event", "length > 3"),
        (*PREDICT, "--tolerance", "0.99", "0.95", "--side", "upper", "--no-uncertainty"),
        (*PREDICT, "--tolerance", "0.9", "0.9", "--outcome", "length", "--no-uncertainty"),
    ),
    "result, recover": (
        (
            *("recover", "study.toml", "--law", "out/identification.json"),
            *("--replicates", "2", "--workers", "1", "--quiet"),
        ),
    ),
    "replicates": (("bootstrap", "study.toml", "--quiet", "--replicates", "3", "--output", "out"),),
}
"""Who reads a damaged result, and with which commands."""
KINDS = ("study", "table", "store", *READERS)
OF_STORES = (
    ("runs", "list", "study.toml"),
    ("runs", "show", "study.toml"),
    ("runs", "show", "study.toml", "1"),
    ("runs", "show", "study.toml", "--failures"),
    ("runs", "export", "study.toml", "again.csv"),
    ("runs", "import", "study.toml", "runs.csv"),
    ("runs", "retry", "study.toml"),
    ("runs", "forget", "study.toml", "--all", "--yes"),
    ("runs", "list", "runs.sqlite"),
    ("box", "study.toml", "--quiet"),
)
NEAR = 0.8
"""Share of studies, tables and results whose values stay within their kind: most are then read."""
SLOW = 0.06
"""Share of the damaged studies and tables that are identified, which takes seconds."""


def damaged(number: int, seed: int, sound: Path, folder: Path) -> tuple[str, tuple[str, ...]]:
    """Make the damaged folder of this number: its kind, and the command that it is for."""
    chance = np.random.default_rng([seed, number])
    damage, kind = Damage(chance), KINDS[number % len(KINDS)]
    if kind == "store":
        return kind, _store(damage, chance, sound, folder)
    if kind in READERS:
        return kind, _result(damage, chance, sound, folder, kind)
    return kind, _study(damage, chance, sound, folder, of_table=kind == "table")


def _study(
    damage: Damage, chance: np.random.Generator, sound: Path, folder: Path, of_table: bool
) -> tuple[str, ...]:
    slow = chance.random() < SLOW
    names = ["plain"] * 6 + ["noisy", "repeated", "series"] if slow else [*STUDIES]
    name = str(damage.choose(names))
    shutil.copytree(sound / name, folder, ignore=shutil.ignore_patterns("out", "*.sqlite*"))
    file, times = folder / ("table.csv" if of_table else "study.toml"), int(chance.integers(1, 4))
    raw = file.read_bytes()
    how, near = chance.random(), chance.random() < NEAR
    if near and of_table:
        _write(file, damage.cells(raw.decode(), times, near))
    elif near:
        _write(file, as_toml(damage.varied(STUDIES[name].study, OPTIONS, times)))
    elif how < 0.15:
        file.write_bytes(damage.bytes(raw, times))
    elif how < 0.4:
        _write(file, damage.text(raw.decode(), times))
    elif of_table:
        _write(file, damage.cells(raw.decode(), times))
    else:
        _write(file, as_toml(damage.tree(STUDIES[name].study, times)))
    return IDENTIFY if slow else damage.choose(LIGHT)


def _result(
    damage: Damage, chance: np.random.Generator, sound: Path, folder: Path, kind: str
) -> tuple[str, ...]:
    name = REPLICATED if kind == "replicates" else str(damage.choose(RESULTS))
    shutil.copytree(sound / name, folder)
    command: tuple[str, ...] = damage.choose(READERS[kind])
    near, how, times = chance.random() < NEAR, chance.random(), int(chance.integers(1, 4))
    changed = damage.nearby if near else damage.tree
    if kind == "replicates":
        file = folder / "out" / "bootstrap.jsonl"
        lines = file.read_text().splitlines()
        at = int(chance.integers(len(lines)))
        lines[at] = json.dumps(changed(json.loads(lines[at]), times))
        _write(file, "\n".join(lines) + "\n")
        return command
    if kind == "result, compared":
        shutil.copytree(folder / "out", folder / "before")
    file = folder / "out" / "identification.json"
    if how < 0.1 and command[0] == "predict":
        table = folder / "new.csv"
        _write(table, damage.cells(table.read_text(), times, near))
    elif near or how > 0.4:
        _write(file, json.dumps(changed(json.loads(file.read_text()), times)))
    elif how < 0.25:
        file.write_bytes(damage.bytes(file.read_bytes(), times))
    else:
        _write(file, damage.text(file.read_text(), times))
    return command


def _store(
    damage: Damage, chance: np.random.Generator, sound: Path, folder: Path
) -> tuple[str, ...]:
    shutil.copytree(sound / STORE, folder)
    file, how = folder / "runs.sqlite", chance.random()
    if how < 0.15:
        table = folder / "runs.csv"
        _write(table, damage.cells(table.read_text(), int(chance.integers(1, 4))))
        return ("runs", "import", "study.toml", "runs.csv")
    if how < 0.3:
        file.write_bytes(damage.bytes(file.read_bytes(), int(chance.integers(1, 30))))
    elif how < 0.35:
        file.with_name("runs.sqlite-wal").write_bytes(chance.bytes(5000))
    else:
        _change(file, damage, chance)
    command: tuple[str, ...] = damage.choose(OF_STORES)
    return IDENTIFY if chance.random() < SLOW / 3 else command


def _change(file: Path, damage: Damage, chance: np.random.Generator) -> None:
    """Statements that a store never sees from Aleator."""
    with closing(sqlite3.connect(file)) as connection, connection:
        for _ in range(int(chance.integers(1, 3))):
            table = str(damage.choose([*COLUMNS]))
            column, value = damage.choose(COLUMNS[table]), damage.value()
            plain = value if isinstance(value, (str, float, bool)) else chance.bytes(7)
            given = (None if chance.random() < 0.1 else plain,)
            statement, values = damage.choose((
                (f"UPDATE {table} SET {column} = ? WHERE id % 3 = 0", given),
                (f"UPDATE {table} SET {column} = ?", given),
                (f"UPDATE {table} SET {column} = substr({column}, 2)", ()),
                (f"DELETE FROM {table} WHERE id % 2 = 0", ()),
                (f"DROP TABLE {table}", ()),
                (f"ALTER TABLE {table} RENAME COLUMN {column} TO other", ()),
                (f"PRAGMA user_version = {int(chance.integers(-2, 5))}", ()),
                (f"PRAGMA application_id = {int(chance.integers(5))}", ()),
            ))  # fmt: skip
            with suppress(sqlite3.Error, UnicodeEncodeError):
                connection.execute("PRAGMA ignore_check_constraints = ON")
                connection.execute(statement, values)


def _write(file: Path, text: str) -> None:
    file.write_bytes(text.encode("utf-8", "surrogatepass"))
