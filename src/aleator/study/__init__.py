"""study.toml: its sections and keys, checked, and made into the library's values.

Three nouns: a `Section` is a table of the file with known keys; `Kinds` are what a section may
choose by name, those that come along and those of plug-ins; a `Study` is all of it as values.

A key goes from `file` by its section (`sections`, `simulators`) and its kind (`kinds`) to the class
of its value; `schema` writes the same sections for editors. `roles`, `offers` and `proposal` make a
first file: what columns may be, what a simulator takes, and the study of both.
"""

from aleator.study.file import Study, load_study

__all__ = ["Study", "load_study"]
