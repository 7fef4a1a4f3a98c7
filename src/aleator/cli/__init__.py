"""The command line: it parses, calls, writes and prints, and computes nothing.

Three nouns: a command is a function of click, imported when it is used (`program`); `RunOptions`
say where its runs are made and kept; `Work` is a command at work on a study, with the place of its
answer (`running`).

`new` makes a study, `exploring` looks before an identification, `identify` answers, `predict` uses
the answer, `judging` asks how good it is, and `runs` keeps the store.
"""

from aleator.cli.starting import ended_at_once

with ended_at_once():
    from aleator.cli.program import main

__all__ = ["main"]
