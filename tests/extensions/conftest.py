"""Plug-ins as pip installs them: a module on the path, and a dist-info with entry points."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

PLUGINS = Path(__file__).parent / "plugins"


@pytest.fixture
def install(
    tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Callable[..., None]]:
    """`install(group, name, "module:Name")` makes a distribution with this entry point."""

    def installed(group: str, name: str, value: str, distribution: str = "") -> None:
        site = tmp_path_factory.mktemp("site")
        called = distribution or f"a-{name}"
        info = site / f"{called.replace('-', '_')}-1.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {called}\nVersion: 1.0\n")
        (info / "entry_points.txt").write_text(f"[{group}]\n{name} = {value}\n")
        monkeypatch.syspath_prepend(site)
        importlib.invalidate_caches()

    monkeypatch.syspath_prepend(PLUGINS)
    yield installed
    for file in PLUGINS.glob("*.py"):
        sys.modules.pop(file.stem, None)


@pytest.fixture
def study(tmp_path: Path) -> Callable[..., Path]:
    """`study(outcomes, text, model)` writes the table, study.toml and model.py."""

    def written(outcomes: list[float], text: str, model: str = "") -> Path:
        rows = "".join(f"{k},{y!r}\n" for k, y in enumerate(outcomes))
        (tmp_path / "measured.csv").write_text("id,y\n" + rows)
        (tmp_path / "model.py").write_text(model)
        head = '[experiments]\nfile = "measured.csv"\noutcome = "y"\nconditions = []\n'
        (tmp_path / "study.toml").write_text(head + text)
        return tmp_path / "study.toml"

    return written
