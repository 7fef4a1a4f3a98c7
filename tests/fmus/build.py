"""Builds the FMUs of the tests: C by gcc with the headers that FMPy ships, Python by PythonFMU."""

import inspect
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import fmpy
import pytest
from fmpy import fmi2, fmi3

HERE = Path(__file__).parent
HEADERS = Path(fmpy.__file__).parent / "c-code"


def functions_of(version: int) -> set[str]:
    """The names of all functions that FMPy asks a library for."""
    module = {2: fmi2, 3: fmi3}[version]
    classes = (getattr(module, f"FMU{version}{kind}") for kind in ("Model", "Slave"))
    return {
        name
        for kind in classes
        for name, _ in inspect.getmembers(kind, inspect.isfunction)
        if name.startswith(f"fmi{version}")
    }


def compiled(version: int, folder: Path, step_sizes: bool = True) -> Path:
    """The body that cools as an FMU of FMI 2.0 or 3.0."""
    if shutil.which("gcc") is None:
        pytest.skip(
            "gcc is not here: FMUs from C, hence model exchange and FMI 3.0, are not tested"
        )
    source = HERE / f"cooling{version}.c"
    defined = set(re.findall(r"\b(fmi[23]\w+)\(", source.read_text(encoding="utf-8")))
    stubs = folder / "stubs.c"
    stubs.write_text(
        "".join(f"int {name}(void) {{ return 3; }}\n" for name in functions_of(version) - defined)
    )
    library = folder / f"cooling{version}.so"
    command = ["gcc", "-shared", "-fPIC", "-O1", "-Wall", "-Wno-unused-function", f"-I{HEADERS}"]
    subprocess.run([*command, source, stubs, "-o", library, "-lm"], check=True)
    description = (HERE / f"cooling{version}.xml").read_text(encoding="utf-8")
    if not step_sizes:
        description = description.replace('StepSize="true"', 'StepSize="false"')
    where = fmpy.platform if version == 2 else fmpy.platform_tuple
    target = folder / f"cooling{version}{'' if step_sizes else '_fixed'}.fmu"
    with zipfile.ZipFile(target, "w") as archive:
        archive.writestr("modelDescription.xml", description)
        archive.write(library, f"binaries/{where}/cooling.so")
        archive.writestr("resources/readme.txt", "none")
    return target


def rewritten(fmu: Path, target: Path, old: str, new: str) -> Path:
    """The FMU with another model description or other names of its files."""
    with zipfile.ZipFile(fmu) as archive, zipfile.ZipFile(target, "w") as copy:
        for name in archive.namelist():
            content = archive.read(name)
            if name.endswith(".xml"):
                content = content.replace(old.encode(), new.encode())
            copy.writestr(name.replace(old, new), content)
    return target


def python_fmu(source: Path, folder: Path, *modules: Path) -> Path:
    """A Python file with an Fmi2Slave, and modules that it imports, as an FMU."""
    from pythonfmu.builder import FmuBuilder

    known, path = set(sys.modules), [*sys.path]
    sys.path[:0] = [str(module.parent) for module in modules]
    try:
        return Path(FmuBuilder.build_FMU(source, dest=folder, project_files=modules))
    finally:
        sys.path[:] = path
        for name in set(sys.modules) - known:
            if name in {file.stem for file in (source, *modules)}:
                del sys.modules[name]
