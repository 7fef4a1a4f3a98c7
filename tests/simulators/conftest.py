"""The FMUs of the tests, compiled once."""

from __future__ import annotations

from pathlib import Path

import pytest
from fmus.build import compiled, python_fmu


@pytest.fixture(scope="session")
def fmus(tmp_path_factory: pytest.TempPathFactory) -> dict[int, Path]:
    """The FMU of FMI 2.0 and that of FMI 3.0."""
    folder = tmp_path_factory.mktemp("fmus")
    return {version: compiled(version, folder) for version in (2, 3)}


@pytest.fixture(scope="session")
def spring(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An FMU in Python."""
    source = Path(__file__).parents[1] / "fmus" / "spring.py"
    return python_fmu(source, tmp_path_factory.mktemp("spring"))


@pytest.fixture(scope="session")
def ball(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An FMU in Python of a ball that bounces."""
    source = Path(__file__).parents[1] / "fmus" / "ball.py"
    return python_fmu(source, tmp_path_factory.mktemp("ball"))
