"""The command line: it reads options, calls `tasks`, writes files and prints; it computes nothing.

Three nouns: a *command* is a function of click, imported when it is used (`program`); `RunOptions`
say where runs of the simulator are made and kept; a `Work` is a command with its study and the
folder of its results (`running`).

`new` writes a study, `exploring` prepares an identification, `identify` makes it and `predict` uses
it, `judging` assesses it, and `runs` manages the stored runs.
"""

from aleator.cli.starting import ended_at_once

with ended_at_once():
    from aleator.cli.program import main

__all__ = ["main"]
