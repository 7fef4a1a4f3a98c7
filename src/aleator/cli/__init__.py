"""The command line: parse, call, print. A file a command; importing one adds it to the program."""

from aleator.cli import box, clutch, identify, predict, recover, runs, sensitivity
from aleator.cli.program import main

__all__ = [
    "box",
    "clutch",
    "identify",
    "main",
    "predict",
    "recover",
    "runs",
    "sensitivity",
]
