"""study.toml: its sections and keys, checked, and made into the library's values."""

from aleator.study.file import Study, load_study

__all__ = ["Study", "load_study"]
