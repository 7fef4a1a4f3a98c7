"""An external program as a simulator: what it is given, how it is run, where its outcome is."""

from aleator.simulators.command.documents import CsvOutput, JsonOutput
from aleator.simulators.command.feeds import CsvFeed, Feed, InputFile, JsonFeed, Template
from aleator.simulators.command.folder import Keep
from aleator.simulators.command.outputs import (
    HookOutput,
    Output,
    OutputFile,
    RegexOutput,
)
from aleator.simulators.command.placeholders import Delimiters
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
