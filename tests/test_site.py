"""What the site promises, without building it: every page is in its contents, every name too."""

import re
from pathlib import Path

import click

import aleator
from aleator.cli import main

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"


def contents(page: Path) -> set[Path]:
    """The pages that the contents of a page lead to, and their contents."""
    found: set[Path] = set()
    for block in re.findall(r"^```\{toctree\}\n(.*?)^```$", page.read_text("utf-8"), re.M | re.S):
        lines = [line for line in block.splitlines() if line and not line.startswith(":")]
        names = [re.sub(r".*<(.*)>", r"\1", line) for line in lines]
        pages = {path.resolve() for name in names for path in page.parent.glob(f"{name}.md")}
        pages |= {(page.parent / f"{name}.md").resolve() for name in names if name != "*"}
        for inner in pages - {page.resolve()}:
            found |= {inner} | contents(inner)
    return found


def test_every_page_is_in_the_contents_of_the_site_and_every_entry_is_there() -> None:
    written = {path.resolve() for path in DOCS.rglob("*.md")}
    written |= {path.resolve() for path in ROOT.glob("*.md")}
    written |= {path.resolve() for path in ROOT.glob("examples/*/README.md")}
    assert contents(DOCS / "index.md") == written - {(DOCS / "index.md").resolve()}


def test_every_public_name_is_in_the_reference_once() -> None:
    pages = "".join(path.read_text("utf-8") for path in (DOCS / "api").glob("*.md"))
    told = re.findall(r"^\.\. auto(?:class|function|exception):: aleator\.(\w+)$", pages, re.M)
    told += re.findall(r"^\.\. autoexception:: aleator\.errors\.(AleatorError)$", pages, re.M)
    assert sorted(told) == sorted(aleator.__all__)


def test_every_command_on_a_page_exists_with_its_options() -> None:
    context = click.Context(main)
    wrong = []
    for page in (*DOCS.rglob("*.md"), *ROOT.glob("*.md"), *ROOT.glob("examples/*/README.md")):
        text = page.read_text("utf-8").replace("\\\n", " ")
        for line in re.findall(r"(?:^    |^|`)aleator ([a-z][^\n`#]*)", text, re.MULTILINE):
            name, *words = line.split()
            command = main.get_command(context, name)
            if isinstance(command, click.Group) and words:
                command = command.get_command(context, words[0])
            if command is None:
                wrong.append((page.name, line))
                continue
            known = {o for p in command.get_params(context) for o in (*p.opts, *p.secondary_opts)}
            given = {word.strip("[],.;:)").split("=")[0] for word in words if "--" in word}
            wrong += [(page.name, line, option) for option in given - known]
    assert wrong == []
