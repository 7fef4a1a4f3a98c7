"""An FMU in this process: quicker to start, and what crashes or hangs in it takes this along."""

from __future__ import annotations

import shutil
from pathlib import Path

from aleator.errors import AleatorError, SimulatorError, SurroundingsError
from aleator.simulators.failure import RunFailed
from aleator.simulators.fmu.session import Failed, Job, Session, Setup, Trajectory


class Inside:
    """A session without a child process, with the members of `Child`."""

    def __init__(self, setup: Setup) -> None:
        self.runs = 0
        self.note = ""
        self.alive = True
        self._fmu = setup["fmu"]
        try:
            self._session = Session(setup)
        except Exception as error:
            shutil.rmtree(setup["folder"], ignore_errors=True)
            log = getattr(error, "log", "")
            raise unusable(setup["fmu"], getattr(error, "message", str(error)), log) from None

    def run(self, job: Job, timeout: float | None, logging: bool = False) -> Trajectory:
        """The trajectory of a run; raises RunFailed. There is no time limit."""
        assert timeout is None
        self.runs += 1
        try:
            trajectory = self._session.run(job, logging)
        except Failed as failure:
            if not failure.begun:
                raise unusable(self._fmu, failure.message, failure.log, begun=True) from None
            raise RunFailed(failure.message, failure.log) from None
        self.note = self._session.note
        return trajectory

    def close(self) -> None:
        """Free the FMU and remove its folder."""
        self.alive = False
        self._session.close()


def unusable(fmu: str, message: str, log: str, begun: bool = False) -> AleatorError:
    """The error for an FMU that cannot be instantiated, or not again where runs have `begun`."""
    printed = f"; it said: {' '.join(log.split())[-300:]}" if log else ""
    kind, again = (SurroundingsError, " again") if begun else (SimulatorError, "")
    return kind(
        f"the FMU {Path(fmu).name} cannot be instantiated{again}: {message}{printed}",
        "see that its libraries, files and licenses are on this machine",
    )
