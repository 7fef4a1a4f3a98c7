"""The default path needs nothing of the paper's way: it runs with that room removed."""

import subprocess
import sys
import textwrap
from pathlib import Path

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
    from aleator import Free, Inputs, Noise, Normal, identify
    from aleator.study import load_study

    rng = np.random.default_rng(1)
    load = np.linspace(0.5, 2.0, 6)
    a, b, c = (1.0 + 0.2 * rng.standard_normal(6) for _ in range(3))
    of, known = Normal(Free(0.0, 2.0), Free(0.02, 1.0)), Normal(1.0, 0.2)

    def asked(model, y, laws, **choices):
        table = pd.DataFrame({"load": load, "y": y})
        found = identify(model, table, Inputs(laws), outcome="y", best_law=False, **choices)
        assert found.sound, found.warnings
        assert found.consistency is not None
        asked = found.predict(pd.DataFrame({"load": [1.0, 3.0]}))
        assert np.all(np.isfinite(asked["mean"]))
        assert "sound" in str(found.to_dict())
"""
STUDIES = """
    # three parameters by level sets
    asked(lambda load, a, b, c: load * a + b + c / load, load * a + b + c / load,
          {"a": of, "b": known, "c": known}, vectorized=True)

    # one parameter on surfaces
    asked(lambda load, a: load * a + 1.0 + 1.0 / load, load * a + 1.0 + 1.0 / load, {"a": of},
          vectorized=False)

    # noise
    asked(lambda load, a, b: load * a + b + 1.0 / load, load * a + b + c / load,
          {"a": of, "b": of}, vectorized=True, noise=Noise(Free(0.01, 1.0)))

    # a study file
    study = load_study("study.toml")
    found = identify(study.runner(), study.experiments, study.inputs, density=study.density,
                     propagation=study.propagation)
    assert found.sound
    assert not [name for name in sys.modules if name.startswith("aleator.moments")]
"""


def test_studies_with_their_questions(tmp_path: Path) -> None:
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
    script = textwrap.dedent(REMOVED) + textwrap.dedent(STUDIES)
    run = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=False, cwd=tmp_path
    )
    assert run.returncode == 0, run.stderr[-2000:]
