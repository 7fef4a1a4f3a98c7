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
        about = f"aleator-{version('aleator')}.dist-info"
        entries = archive.read(f"{about}/entry_points.txt")
        licence = archive.read(f"{about}/licenses/LICENSE")
        metadata = archive.read(f"{about}/METADATA").decode()
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
    assert licence == (ROOT / "LICENSE").read_bytes()
    assert "\nLicense-Expression: BSD-3-Clause\n" in metadata
