"""An external program as a simulator: what it is given, how it is run, where its outcome is.

Three nouns: an input (`inputs`: texts with placeholders, tables, JSON), a process (`run`: one
run in a folder of its own, of which nothing is left), an output (`outputs`: a number, or a column
for a series, in what the program wrote). `simulator` puts them together.
"""

from aleator.simulators.command.inputs import (
    CsvFeed,
    Delimiters,
    Feed,
    InputFile,
    JsonFeed,
    Template,
)
from aleator.simulators.command.outputs import (
    CsvOutput,
    HookOutput,
    JsonOutput,
    Output,
    OutputFile,
    RegexOutput,
)
from aleator.simulators.command.run import Keep
from aleator.simulators.command.simulator import CommandSimulator

__all__ = [
    "CommandSimulator",
    "CsvFeed",
    "CsvOutput",
    "Delimiters",
    "Feed",
    "HookOutput",
    "InputFile",
    "JsonFeed",
    "JsonOutput",
    "Keep",
    "Output",
    "OutputFile",
    "RegexOutput",
    "Template",
]
