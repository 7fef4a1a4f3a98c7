"""The wheel has the package, what describes it, and nothing else."""

import subprocess
import sys
import zipfile
from importlib.metadata import version
from pathlib import Path

ROOT = Path(__file__).parents[1]


def test_the_wheel_holds_the_package_and_nothing_else(tmp_path: Path) -> None:
    made = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(tmp_path)]
    subprocess.run(made, cwd=ROOT, check=True, capture_output=True)
    (wheel,) = tmp_path.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
        entries = archive.read(f"aleator-{version('aleator')}.dist-info/entry_points.txt")
    source = ROOT / "src"
    package = {
        str(path.relative_to(source).as_posix())
        for path in (source / "aleator").rglob("*")
        if path.suffix in {".py", ".css", ".js", ".typed"}
    }
    assert {name for name in names if ".dist-info/" not in name} == package
    assert len(package) > 100
    assert "aleator/py.typed" in package  # type checkers of users read the annotations
    assert b"aleator = aleator.cli:main" in entries
