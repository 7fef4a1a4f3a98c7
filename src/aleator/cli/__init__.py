"""The command line: parse, call, print. A file a command, imported when the command is used."""

from aleator.cli.starting import ended_at_once

with ended_at_once():
    from aleator.cli.program import main

__all__ = ["main"]
