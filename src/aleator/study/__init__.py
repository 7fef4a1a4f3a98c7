"""study.toml: its sections and keys, how they are checked, and the values made from them.

Three nouns: a `Section` is a table of the file with known keys. `Kinds` are the alternatives that a
section chooses by name (`law = "normal"`), built in or of plug-ins. A `Study` has the whole file as
values of the library.

`file` reads a study file; `sections` and `simulators` define its sections, `kinds` their
alternatives; `schema` writes the same sections as a JSON schema for editors. Three modules make a
first file for `aleator new`: `roles` says what the columns of a table may be, `offers` what a
simulator takes and returns, and `proposal` joins both.
"""

from aleator.study.file import Study, load_study

__all__ = ["Study", "load_study"]
