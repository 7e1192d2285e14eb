"""Hook of mkdocs: a line ``{{ FILE }}`` or ``{{ FILE: HEADING }}`` stands for text of the repository.

So that figures and the model card stand in one place each, which people also find without this site. The text
loses its own heading; links to ``docs/`` are made those of the site, other links to files are only named.
"""

import re
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]

_LINE = re.compile(r"^\{\{ ([\w./-]+)(?:: (.+?))? \}\}$", re.MULTILINE)
_CODE = re.compile(r"^```.*?^```$", re.DOTALL | re.MULTILINE)
_LINK = re.compile(r"(?<!!)\[([^\]]+)\]\((?!https?:|#)([^)]+)\)")


def section(text: str, heading: str | None) -> str:
    """Return what stands under ``heading``, up to the next one as high; all under the first without one.

    Raises:
        ValueError: There is no such heading.
    """
    # Comments in code look like headings; blanks keep every place where it is.
    bare = _CODE.sub(lambda found: " " * len(found[0]), text)
    name = r".+" if heading is None else re.escape(heading)
    start = re.search(rf"^(#+) {name}$", bare, re.MULTILINE)
    if start is None:
        raise ValueError(f"no heading {heading!r}")
    end = re.compile(rf"^#{{1,{len(start[1])}}} ", re.MULTILINE).search(bare, start.end())
    return text[start.end() : end.start() if end else None].strip()


def _relink(found: re.Match[str]) -> str:
    label, target = found[1], found[2]
    if target.startswith("docs/"):
        return f"[{label.removeprefix('docs/')}]({target.removeprefix('docs/')})"
    return f"`{target}`"


def on_page_markdown(markdown: str, *, page: Any, **_: Any) -> str:
    """Put the sections in, and name files outside the site without linking them."""

    def read(found: re.Match[str]) -> str:
        text = (ROOT / found[1]).read_text(encoding="utf-8")
        return _LINK.sub(_relink, section(text, found[2]))

    def name_outside(found: re.Match[str]) -> str:
        path = found[2].split("#")[0]
        outside = path.startswith("../")
        return f"{found[1]} (`{path.removeprefix('../')}`)" if outside else found[0]

    return _LINK.sub(name_outside, _LINE.sub(read, markdown))


def on_page_content(html: str, **_: Any) -> str:
    """Take out what Sphinx would read in docstrings: the roles before names, the colons before blocks."""
    return re.sub(r":(?:func|class|meth|mod):(?=<code)|<p>::</p>", "", html)
