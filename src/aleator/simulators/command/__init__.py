"""An external program as a simulator: what it is given, how it is run, where its outcome is."""

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
from aleator.simulators.command.process import Keep
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
