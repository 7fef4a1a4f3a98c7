"""Models of a real UM-Bridge server as simulators, and what its failures are taken for."""

import json
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import closing
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path
from urllib.request import urlopen

import numpy as np
import pandas as pd
import pytest
from studies import done, read, refused

import aleator
from aleator.errors import AleatorError, SimulatorError, SurroundingsError
from aleator.simulators import ProcessPool, RunFailed

LOADS = np.repeat([10.0, 20.0, 30.0], 4)
TRAVELS = LOADS / np.random.default_rng(3).normal(2.0, 0.2, LOADS.size)


def free_port() -> int:
    with closing(socket.socket()) as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


def started(port: int) -> subprocess.Popen[bytes]:
    """A server that answers at a port of this machine."""
    pytest.importorskip("umbridge")
    script = Path(__file__).with_name("umbridge_server.py")
    process = subprocess.Popen(
        [sys.executable, str(script), str(port)], stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )  # fmt: skip
    for _ in range(400):
        try:
            urlopen(f"http://127.0.0.1:{port}/Info").close()
            break
        except OSError:
            time.sleep(0.05)
    return process


@pytest.fixture(scope="module")
def server() -> Iterator[str]:
    port = free_port()
    process = started(port)
    try:
        yield f"http://127.0.0.1:{port}"
    finally:
        process.kill()
        process.wait()


def spring(url: str, **more: object) -> aleator.UMBridgeSimulator:
    return aleator.UMBridgeSimulator(url, "spring", ["load", "stiffness"], **more)  # type: ignore[arg-type]


def test_an_evaluation_is_the_model_at_the_values(server: str) -> None:
    assert spring(server).run_one({"load": 3.0}, {"stiffness": 7.0}) == 3.0 / 7.0
    twice = spring(server, config={"factor": 2.0}, output={"way": 0, "energy": [1, 1]})
    assert twice.run_one({"load": 3.0}, {"stiffness": 2.0}) == {"way": 3.0, "energy": 4.5}
    one = aleator.UMBridgeSimulator(server, "spring", [["load", 4.0]])
    assert one.run_one({"load": 2.0}, {}) == 0.5


def test_a_series_fills_a_vector_and_reads_one(server: str) -> None:
    rows = pd.DataFrame({"id": list("aaabbb"), "time": [1.0, 2.0, 4.0] * 2, "level": 0.5})
    table = aleator.Experiments.from_frame(rows, id="id", outcome="level")
    decay = aleator.UMBridgeSimulator(server, "decay", [["rate"], "time"], series=True)
    run = aleator.Runner(decay, table, ["rate"])
    expected = [1.0 / 1.5, 1.0 / 2.0, 1.0 / 3.0]
    np.testing.assert_array_equal(run.values([0, 1], [[0.5], [0.5]])[0], expected)


@pytest.mark.usefixtures("unreported", "unjudged_commands")
def test_a_study_on_a_server_is_the_study_on_the_function(
    server: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("springs.csv").write_text(
        pd.DataFrame({"load": LOADS, "travel": TRAVELS}).to_csv(index=False)
    )
    text = f"""
[experiments]
file = "springs.csv"
outcome = "travel"
[simulator]
umbridge = "{server}"
model = "spring"
inputs = [["load", "stiffness"]]
output = [1, 0]
config = {{factor = 1.0}}
[parameters.stiffness]
law = "normal"
mean = {{lower = 1.0, upper = 3.0}}
sd = {{lower = 0.05, upper = 0.5}}
"""
    Path("study.toml").write_text(text)
    done("identify", "study.toml", "--output", "out", "--no-figures", "--quiet")
    stiffness = LOADS / TRAVELS  # monotone: the maximum is that of these
    alpha = read("out/identification.json")["alpha"]
    assert alpha["stiffness.mean"]["estimate"] == pytest.approx(stiffness.mean(), abs=2e-3)
    assert alpha["stiffness.sd"]["estimate"] == pytest.approx(stiffness.std(), abs=2e-3)
    again = text.replace(server, "http://127.0.0.1:9")  # where no server is
    Path("study.toml").write_text(again)
    said = refused("identify", "study.toml", "--output", "other", "--no-figures", "--quiet")
    assert "gives no answer: Connection refused" in said
    assert "every run that was made is kept" in said


def test_workers_evaluate_beside_each_other(server: str) -> None:
    table = aleator.Experiments.from_frame(pd.DataFrame({"load": LOADS, "y": 1.0}), outcome="y")
    with ProcessPool(2) as pool:
        run = aleator.Runner(spring(server), table, ["stiffness"], executor=pool)
        found = run(range(LOADS.size), np.full((LOADS.size, 1), 2.0))
    np.testing.assert_array_equal(found, LOADS / 2.0)


def test_a_server_that_is_gone_leaves_the_runs_that_were_made(tmp_path: Path) -> None:
    port = free_port()
    table = aleator.Experiments.from_frame(pd.DataFrame({"load": LOADS, "y": 1.0}), outcome="y")
    process = started(port)
    try:
        with aleator.Store(tmp_path / "runs.sqlite") as store:
            run = aleator.Runner(
                spring(f"http://127.0.0.1:{port}"), table, ["stiffness"], store=store
            )
            run([0, 4], [[2.0], [2.0]])
            process.kill()
            process.wait()
            with pytest.raises(SurroundingsError, match="gives no answer"):
                run([4, 8], [[2.0], [2.0]])
            assert not run.failures
            process = started(port)
            np.testing.assert_array_equal(run([4, 8], [[2.0], [2.0]]), LOADS[[4, 8]] / 2.0)
            assert run.fresh == 3
    finally:
        process.kill()
        process.wait()


@pytest.mark.parametrize(("stiffness", "said"), [(60.0, "500 Internal"), (45.0, "nan")])
def test_an_evaluation_that_fails_is_a_failed_run(server: str, stiffness: float, said: str) -> None:
    with pytest.raises(RunFailed, match=said):
        spring(server).run_one({"load": 3.0}, {"stiffness": stiffness})


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({"model": "sprong"}, "has no model 'sprong' .did you mean 'spring'"),
        ({"inputs": ["load", "stiffness", 1.0]}, r"vectors of \[3\] components.*takes \[2\]"),
        ({"inputs": [["load"], ["stiffness"]]}, r"vectors of \[1, 1\] components"),
        ({"output": 1}, "the vector 1 has 2 components"),
        ({"output": [1, 2]}, r"\[1, 2\] is beyond the output sizes \[1, 2\]"),
        ({"output": {"way": 2}}, "output of way: 2 is beyond"),
    ],
)
def test_what_the_server_does_not_have_ends_the_study(
    server: str, more: dict[str, object], said: str
) -> None:
    keys: dict[str, object] = {"url": server, "model": "spring", "inputs": ["load", "stiffness"]}
    simulator = aleator.UMBridgeSimulator(**{**keys, **more})  # type: ignore[arg-type]
    table = aleator.Experiments.from_frame(pd.DataFrame({"load": LOADS, "y": 1.0}), outcome="y")
    with pytest.raises(SimulatorError, match=said) as error:
        aleator.Runner(simulator, table, ["stiffness"])([0], [[2.0]])
    assert error.value.remedy


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({"url": "localhost:4242"}, "is no address"),
        ({"output": -1}, "-1 is no place"),
        ({"output": [0, 1, 2]}, "is no place"),
        ({"timeout": 0.0}, "is no time"),
        ({"inputs": ["lode", "stiffness"]}, "'lode' is neither .*did you mean 'load'"),
        ({"inputs": ["load"]}, "is never told the parameter 'stiffness'"),
    ],
)
def test_misuse_is_told_without_a_server(more: dict[str, object], said: str) -> None:
    keys = {"url": "http://127.0.0.1:9", "model": "spring", "inputs": ["load", "stiffness"]}
    with pytest.raises(AleatorError, match=said):
        aleator.UMBridgeSimulator(**{**keys, **more}).asks(["load"], ["stiffness"])  # type: ignore[arg-type]


def test_stored_runs_belong_to_the_address_or_to_a_version() -> None:
    here, there = spring("http://a:1"), spring("http://b:1")
    assert here.fingerprint() != there.fingerprint()
    assert here.fingerprint() != spring("http://a:1", config={"level": 2}).fingerprint()
    named = [spring(url, version="2.1").fingerprint() for url in ("http://a:1", "http://b:1")]
    assert named[0] == named[1] != spring("http://a:1", version="2.2").fingerprint()


class Answers(BaseHTTPRequestHandler):
    """A server whose evaluations answer as `answer` says: a code, a text, and a delay."""

    answer: tuple[int, str, float] = (200, "{}", 0.0)

    def do_GET(self) -> None:
        self._send(200, json.dumps({"protocolVersion": 1.0, "models": ["spring"]}))

    def do_POST(self) -> None:
        self.rfile.read(int(self.headers["Content-Length"]))
        sizes = {"/InputSizes": {"inputSizes": [2]}, "/OutputSizes": {"outputSizes": [1]}}
        if self.path in sizes:
            return self._send(200, json.dumps(sizes[self.path]))
        code, text, delay = self.answer
        time.sleep(delay)
        return self._send(code, text)

    def _send(self, code: int, text: str) -> None:
        self.send_response(code)
        self.send_header("Content-Length", str(len(text)))
        self.end_headers()
        self.wfile.write(text.encode())

    def log_message(self, *_: object) -> None:
        pass


ERROR = '{{"error": {{"type": "{}", "message": "{}"}}}}'
CASES: dict[str, tuple[tuple[int, str, float], type[Exception], str]] = {
    "refused": ((400, ERROR.format("InvalidInput", "negative"), 0), RunFailed, "InvalidInput"),
    "error with 200": ((200, ERROR.format("Model", "diverged"), 0), RunFailed, "diverged"),
    "licence": (
        (500, ERROR.format("Model", "license server is down"), 0),
        SurroundingsError,
        "lic",
    ),
    "balancer": ((503, "no backend", 0), SurroundingsError, "503"),
    "gone": ((400, ERROR.format("ModelNotFound", "spring"), 0), SimulatorError, "spring"),
    "slow": ((200, '{"output": [[1.0]]}', 1.0), RunFailed, "stopped after its 0.2 s"),
    "short": ((200, '{"output": []}', 0), RunFailed, "not that of the model"),
    "null": ((200, '{"output": [[null]]}', 0), RunFailed, "not that of the model"),
}


@pytest.mark.parametrize("case", CASES)
def test_trouble_of_the_surroundings_is_no_failed_run(
    case: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    answer, kind, said = CASES[case]
    monkeypatch.setattr(Answers, "answer", answer)
    with HTTPServer(("127.0.0.1", 0), Answers) as one:
        thread = threading.Thread(target=one.serve_forever)
        thread.start()
        try:
            simulator = spring(f"http://127.0.0.1:{one.server_port}", timeout=0.2)
            with pytest.raises(kind, match=said):
                simulator.run_one({"load": 1.0}, {"stiffness": 2.0})
        finally:
            one.shutdown()
            thread.join()
