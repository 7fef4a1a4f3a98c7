"""An external program as a simulator: its inputs, its process, and where its outcome is.

Three nouns. An input (`inputs`) is what the program reads: texts with placeholders, tables, JSON. A
process (`run`) makes one run in a folder of its own, of which nothing is left. An output
(`outputs`) finds the result in what the program wrote: a number, or a column for a series. The
module `simulator` combines them.
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
