"""The command line: it reads options, calls `tasks`, writes files and prints; it computes nothing.

Three nouns: a *command* is a function that the package click calls; its file is imported when the
command is used (`program`). `RunOptions` say which processes run the simulator and which file keeps
the runs. A `Work` is a command with its study and the folder of its results (`running`).

`new` writes a study, `exploring` prepares an identification, `identify` makes it, `predict` and
`pbox` use it, `judging` assesses it, and `runs` manages the stored runs.
"""

from aleator.cli.starting import ended_at_once

with ended_at_once():
    from aleator.cli.program import main

__all__ = ["main"]
