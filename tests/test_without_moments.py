"""The default path needs nothing of the paper's way: it runs with that room removed."""

import subprocess
import sys
import textwrap

import pytest

REMOVED = """
    import sys
    from importlib.abc import MetaPathFinder

    class Removed(MetaPathFinder):
        def find_spec(self, name, path=None, target=None):
            if name.split(".")[:2] == ["aleator", "moments"]:
                raise ModuleNotFoundError(f"{name} is removed")

    sys.meta_path.insert(0, Removed())
    import numpy as np
    import pandas as pd
    from aleator import Free, Inputs, Noise, Normal, ResponseSurface, identify, load, predict

    rng = np.random.default_rng(1)
    load_ = np.linspace(0.5, 2.0, 6)
    a, b, c = (1.0 + 0.2 * rng.standard_normal(6) for _ in range(3))
    table = pd.DataFrame({"load": load_, "y": load_ * a + b + c / load_})
    of = {name: Normal(Free(0.0, 2.0), Free(0.02, 1.0)) for name in ("a", "b", "c")}
"""
STUDIES = {
    "three parameters by level sets": """
    model = lambda load, a, b, c: load * a + b + c / load
    known = Normal(1.0, 0.2)
    law = Inputs({"a": of["a"], "b": known, "c": known})
    found = identify(model, table, law, outcome="y", vectorized=True, best_law=False)
    """,
    "one parameter on surfaces": """
    model = lambda load, a: load * a + 1.0 + 1.0 / load
    table["y"] = model(load_, a)
    found = identify(model, table, Inputs({"a": of["a"]}), outcome="y")
    """,
    "noise": """
    model = lambda load, a, b: load * a + b + 1.0 / load
    of.pop("c")
    found = identify(model, table, Inputs(of), outcome="y", vectorized=True,
                     noise=Noise(Free(0.01, 1.0)))
    """,
}


@pytest.mark.parametrize("study", STUDIES.values(), ids=[*STUDIES])
def test_a_study_with_its_questions(study: str) -> None:
    script = (
        textwrap.dedent(REMOVED)
        + textwrap.dedent(study)
        + textwrap.dedent("""
        assert found.sound, found.warnings
        assert found.consistency is not None
        asked = found.predict(pd.DataFrame({"load": [1.0, 3.0]}))
        assert np.all(np.isfinite(asked["mean"]))
        assert "sound" in str(found.to_dict())
        assert not [name for name in sys.modules if name.startswith("aleator.moments")]
    """)
    )
    run = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stderr[-2000:]


def test_a_study_file(tmp_path) -> None:  # type: ignore[no-untyped-def]
    (tmp_path / "model.py").write_text("def model(load, a):\n    return load * a\n")
    (tmp_path / "data.csv").write_text("id,load,y\n1,1.0,1.1\n2,2.0,1.8\n3,3.0,3.6\n4,4.0,3.7\n")
    (tmp_path / "study.toml").write_text("""
[experiments]
file = "data.csv"
outcome = "y"
[simulator]
function = "model:model"
[parameters.a]
law = "normal"
mean = {lower = 0.5, upper = 1.5}
sd = {lower = 0.01, upper = 0.5}
""")
    script = textwrap.dedent(REMOVED) + textwrap.dedent(f"""
        from aleator.study import load_study
        study = load_study({str(tmp_path / "study.toml")!r})
        found = identify(study.runner(), study.experiments, study.inputs, density=study.density,
                         propagation=study.propagation)
        assert found.sound
    """)
    run = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stderr[-2000:]
