"""A model of an UM-Bridge server as a simulator: vectors sent and received as JSON over HTTP."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from http.client import HTTPException
from typing import Any
from urllib.error import HTTPError, URLError
from urllib.request import Request, urlopen

import numpy as np

from aleator.errors import SimulatorError, SurroundingsError, nearest
from aleator.simulators.protocol import (
    Columns,
    Returned,
    RunFailed,
    name_lists,
    one_by_one,
    require_distinct,
)
from aleator.simulators.surroundings import (
    STOP_ON,
    checked_limit,
    prevented,
    printed,
    require_pattern,
)

Part = str | float
"""A component of an input vector: the name of a condition or a parameter, or a number."""
Place = int | Sequence[int]
"""Where an outcome is: the number of an output vector, or [vector, component], from 0."""

_UNAVAILABLE = (429, 502, 503, 504)
"""Codes of HTTP by which a server, or what stands before it, says that it cannot serve now."""
_MISUSED = ("ModelNotFound", "UnsupportedFeature")
"""Types of errors of UM-Bridge that no other values of the parameters would mend."""


class _Refused(Exception):
    """The server answered, and the answer is an error: its type and its text."""

    def __init__(self, kind: str, text: str) -> None:
        super().__init__(kind, text)
        self.kind, self.text = kind, text


@dataclass(frozen=True)
class UMBridgeSimulator:
    """A model that an UM-Bridge server computes, one evaluation for each run.

    The protocol is that of UM-Bridge 1.0 (Seelinger et al., *J. Open Source Softw.* 8 (2023) 4748).
    `url` is the address of the server, `model` the name of the model there. `inputs` has a list for
    each input vector, of names of conditions and parameters and of numbers; a flat list is one
    vector. `output` is the place of the outcome, a vector of one component or [vector, component],
    both from 0; for several responses it is a mapping from their names. `config` is passed as it
    is.

    With `series` one evaluation makes all m rows of an experiment: a condition that varies within
    an experiment fills m components of its input vector, and an output vector has a component for
    each row; [vector, component] is then one number for all rows.

    An evaluation that the server answers with an error, or after more than `timeout` seconds, is a
    failed run. A server that is not reached, and an error that matches the regular expression
    `stop_on`, stop the study. `version` names what the server computes; without it stored runs
    belong to its address.

    Raises SimulatorError for an address, a place or a limit that is none, and before the first run
    for a model that the server does not have and for sizes that are not those of the model. Cost:
    one request a run, some 2 ms on the same machine.

    >>> server = UMBridgeSimulator("http://localhost:4242", "forward", ["load", "stiffness"])
    >>> server.asks(["load", "bench"], ["stiffness"])
    ('load',)
    """

    url: str
    model: str
    inputs: Sequence[Part | Sequence[Part]]
    output: Place | Mapping[str, Place] = 0
    config: Mapping[str, Any] = field(default_factory=dict)
    timeout: float | None = None
    stop_on: str = STOP_ON
    version: str = ""
    series: bool = False
    # A call makes one run, so that progress is reported after every run.
    block: int = field(default=1, init=False, repr=False)

    def __post_init__(self) -> None:
        if not self.url.startswith(("http://", "https://")):
            raise SimulatorError(
                f"'{self.url}' is no address of a server", 'write "http://localhost:4242"'
            )
        checked_limit(self.timeout)
        require_pattern(self.stop_on)
        for name, place in self._places.items():
            numbers = [place] if isinstance(place, int) else [*place]
            if len(numbers) not in (1, 2) or any(number < 0 for number in numbers):
                raise SimulatorError(
                    f"output{f' of {name}' if name else ''}: {place!r} is no place",
                    "write the number of an output vector, or [vector, component], from 0",
                )

    @property
    def name(self) -> str:
        """The name of the model and the address of its server."""
        return f"{self.model} at {self.url}"

    @property
    def description(self) -> str:
        """The model, its address, and what is passed, as one text."""
        return f"{self.name}: {json.dumps(self._vectors)}, {json.dumps(dict(self.config))}"

    def asks(self, conditions: Sequence[str], parameters: Sequence[str]) -> tuple[str, ...]:
        """The conditions that are components of an input. The server is not asked.

        Raises SimulatorError for a component that is neither a condition nor a parameter, and for a
        parameter that is no component.
        """
        used = [part for vector in self._vectors for part in vector if isinstance(part, str)]
        known = (*conditions, *parameters)
        for name in used:
            if name not in known:
                raise SimulatorError(
                    f"inputs: '{name}' is neither a condition nor a parameter"
                    f"{nearest(name, known)}",
                    name_lists(conditions, parameters),
                )
        for name in parameters:
            if name not in used:
                raise SimulatorError(
                    f"simulator '{self.name}' is never told the parameter '{name}'"
                    f"{nearest(name, used)}",
                    "write its name into inputs, in the place where the model takes it",
                )
        require_distinct(self.name, conditions, parameters)
        return tuple(name for name in conditions if name in used)

    def run_one(self, conditions: Mapping[str, Any], parameters: Mapping[str, float]) -> Any:
        """The outcome of one evaluation: a number, or one for each response; arrays in a series.

        Raises RunFailed for an evaluation that failed, SurroundingsError for a server that cannot
        be reached, and SimulatorError for a model or sizes that the server does not know.
        """
        cells = {**conditions, **parameters}
        filled = [
            [number for part in vector for number in _numbers(part, cells)]
            for vector in self._vectors
        ]
        self._require_sizes(filled)
        try:
            output = self._asked("Evaluate", input=filled)["output"]
            found = {name: self._read(output, place) for name, place in self._places.items()}
        except _Refused as error:
            fault = SimulatorError(f"simulator '{self.name}': {error.text}", _MEND)
            if error.kind in _MISUSED:
                raise fault from None
            failure = RunFailed(f"the server answered {error.kind}", error.text)
            raise printed(error.text, self.stop_on) or failure from None
        except TimeoutError:
            raise RunFailed(f"it was stopped after its {self.timeout:g} s") from None
        except (LookupError, TypeError, ValueError) as error:
            raise RunFailed(f"the server's output is not that of the model: {error}") from None
        return found if isinstance(self.output, Mapping) else found[""]

    def __call__(self, conditions: Columns, parameters: Columns) -> Returned:
        """Run R times, one after the other. On a failure RunStopped has the outcomes before it."""
        return one_by_one(lambda cells: self.run_one(cells, {}), conditions, parameters)

    def fingerprint(self) -> str:
        """A hash of the model, its inputs, outputs and configuration, and of address or version.

        What the server computes is not seen: give another `version` when it changes.
        """
        where = ("version", self.version) if self.version else ("url", self.url)
        choices = (where, self.model, self._vectors, sorted(self._places.items()),
                   sorted(self.config.items()), self.series)  # fmt: skip
        return hashlib.sha256(json.dumps(choices).encode()).hexdigest()

    @property
    def _vectors(self) -> list[list[Part]]:
        """The components of each input vector."""
        flat = [part for part in self.inputs if isinstance(part, (str, int, float))]
        if len(flat) == len(self.inputs):
            return [flat]
        return [[vector] if isinstance(vector, (str, int, float)) else [*vector]
                for vector in self.inputs]  # fmt: skip

    @property
    def _places(self) -> Mapping[str, Place]:
        """The places of the outcomes by response; a single outcome has the name ""."""
        return self.output if isinstance(self.output, Mapping) else {"": self.output}

    @cached_property
    def _sizes(self) -> tuple[list[int], list[int]]:
        """The sizes of the model's input and output vectors, asked of the server once.

        Raises SimulatorError if the server does not have the model, or is none of UM-Bridge.
        """
        try:
            about = self._asked("Info")
            known = about["models"]
            if about.get("protocolVersion") != 1.0:
                raise SimulatorError(
                    f"{self.url} speaks version {about.get('protocolVersion')} of UM-Bridge",
                    "only version 1.0 is known: serve the model in that",
                )
            if self.model not in known:
                raise SimulatorError(
                    f"{self.url} has no model '{self.model}'{nearest(self.model, known)}",
                    f"its models are {', '.join(map(str, known))}",
                )
            return (
                [*map(int, self._asked("InputSizes")["inputSizes"])],
                [*map(int, self._asked("OutputSizes")["outputSizes"])],
            )
        except TimeoutError as error:
            raise self._unreached(error) from None
        except (_Refused, LookupError, TypeError, ValueError) as error:
            said = error.text if isinstance(error, _Refused) else repr(error)
            raise SimulatorError(
                f"{self.url} does not answer as an UM-Bridge server does: {said[:200]}",
                "name the address at which the server listens, as it prints it when it starts",
            ) from None

    def _require_sizes(self, filled: Sequence[Sequence[float]]) -> None:
        """Raise SimulatorError unless inputs and places of outcomes fit the model's sizes."""
        taken, given = self._sizes
        if (sent := [len(vector) for vector in filled]) != taken:
            raise SimulatorError(
                f"inputs: vectors of {sent} components, and {self.name} takes {taken}", _MEND
            )
        for name, place in self._places.items():
            vector, component = _place(place)
            of = f"output{f' of {name}' if name else ''}"
            if vector >= len(given) or (component or 0) >= given[vector]:
                raise SimulatorError(f"{of}: {place!r} is beyond the output sizes {given}", _MEND)
            if component is None and given[vector] != 1 and not self.series:
                raise SimulatorError(
                    f"{of}: the vector {vector} has {given[vector]} components",
                    f"say which: output = [{vector}, 0]; or series = true: one for each row",
                )

    def _read(self, output: Sequence[Sequence[float]], place: Place) -> Any:
        """The outcome at a place of the output vectors."""
        vector, component = _place(place)
        if self.series and component is None:
            return np.array([float(number) for number in output[vector]])
        return float(output[vector][component or 0])

    def _asked(self, question: str, **more: Any) -> Mapping[str, Any]:
        """The server's answer to a question of the protocol.

        Raises _Refused for an error that it answers, TimeoutError after `timeout` seconds, and
        SurroundingsError if there is no answer.
        """
        body = {"name": self.model, "config": dict(self.config), **more}
        data = None if question == "Info" else json.dumps(body).encode()
        head = {"Content-Type": "application/json"}
        request = Request(f"{self.url.rstrip('/')}/{question}", data, head)
        status = "200 OK"
        try:
            with urlopen(request, timeout=self.timeout) as response:
                text = response.read().decode("utf-8", "replace")
        except HTTPError as error:
            status, text = f"{error.code} {error.reason}", error.read().decode("utf-8", "replace")
            if error.code in _UNAVAILABLE:
                raise self._unreached(ConnectionError(f"{status}: {text[:200]}")) from None
        except TimeoutError:
            raise
        except URLError as error:
            reason = error.reason if isinstance(error.reason, OSError) else error
            raise self._unreached(reason) from None
        except (OSError, HTTPException) as error:
            cut = error if isinstance(error, OSError) else ConnectionError("its answer is cut off")
            raise self._unreached(cut) from None
        try:
            answer = json.loads(text)
        except ValueError:
            raise _Refused(status, text) from None
        if not isinstance(answer, dict) or "error" in answer or status != "200 OK":
            fault = answer.get("error") if isinstance(answer, dict) else None
            told = fault if isinstance(fault, dict) else {"type": status, "message": text}
            raise _Refused(str(told.get("type")), str(told.get("message")))
        return answer

    def _unreached(self, error: OSError) -> SurroundingsError:
        return prevented(error, f"a run could not be made: {self.url} gives no answer")


_MEND = (
    "correct what the study says of the server; docs/simulators.md says how inputs and output are "
    "written"
)


def _place(place: Place) -> tuple[int, int | None]:
    """The number of a vector, and that of its component; None if no component is named."""
    if isinstance(place, int):
        return place, None
    return place[0], place[1] if len(place) > 1 else None


def _numbers(part: Part, cells: Mapping[str, Any]) -> list[float]:
    """The numbers of a component; a condition that varies within an experiment has several."""
    if not isinstance(part, str):
        return [float(part)]
    value = cells[part]
    if isinstance(value, str):
        raise SimulatorError(
            f"the condition '{part}' is the text '{value}', and an UM-Bridge model takes numbers",
            "leave it out of inputs, or write numbers for its texts",
        )
    return [float(number) for number in np.atleast_1d(value)]
