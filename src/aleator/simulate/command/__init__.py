"""An external program as a simulator: what it is given, how it is run, where its outcome is."""

from aleator.simulate.command.feeds import CsvFeed, Feed, InputFile, JsonFeed, Template
from aleator.simulate.command.folder import Keep
from aleator.simulate.command.outputs import (
    CsvOutput,
    HookOutput,
    JsonOutput,
    Output,
    OutputFile,
    RegexOutput,
)
from aleator.simulate.command.placeholders import Delimiters
from aleator.simulate.command.simulator import CommandSimulator

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
