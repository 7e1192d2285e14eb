"""mkdocs hook: include ``{{ FILE }}`` and ``{{ FILE: HEADING }}`` of the repository, and ``{{ options }}``.

Figures and the model card stay in one place each. The included text loses its own heading. Links to ``docs/``
become links of the site; other links to files become names. ``{{ options }}`` lists every option of
``bokehnet render`` from the settings.
"""

import posixpath
import re
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]

_LINE = re.compile(r"^\{\{ ([\w./-]+)(?:: (.+?))? \}\}$", re.MULTILINE)
_CODE = re.compile(r"^```.*?^```$", re.DOTALL | re.MULTILINE)
_LINK = re.compile(r"(?<!!)\[([^\]]+)\]\((?!https?:|#)([^)]+)\)")


def section(text: str, heading: str | None) -> str:
    """Return the text under ``heading``, or under the first heading, up to the next one of its level.

    Raises:
        ValueError: There is no such heading.
    """
    # Comments in code look like headings; blanks keep every offset.
    bare = _CODE.sub(lambda code: " " * len(code[0]), text)
    name = r".+" if heading is None else re.escape(heading)
    start = re.search(rf"^(#+) {name}$", bare, re.MULTILINE)
    if start is None:
        raise ValueError(f"no heading {heading!r}")
    end = re.compile(rf"^#{{1,{len(start[1])}}} ", re.MULTILINE).search(bare, start.end())
    return text[start.end() : end.start() if end else None].strip()


def _relink(match: re.Match[str], page: str) -> str:
    """Return a link of the repository as a link of the site, or the name alone outside ``docs/``."""
    label, target = match[1], match[2]
    if not target.startswith("docs/"):
        return f"`{target}`"
    path, anchor, name = target.removeprefix("docs/").partition("#")
    relative = posixpath.relpath(path, posixpath.dirname(page) or ".")
    return f"[{label.removeprefix('docs/')}]({relative}{anchor}{name})"


def _options() -> str:
    """Return a table of all options of ``bokehnet render`` for each group of settings."""
    from bokehnet.settings.fields import field_settings
    from bokehnet.settings.settings import group_types

    lines = []
    for group in group_types():
        lines += [f"## {group.TITLE}", "", "| option | default | |", "|---|---|---|"]
        for known in field_settings(group).values():
            if known.flag is not None:
                default = "" if known.default in (None, False, "") else f"`{known.default}`"
                text = known.help.replace("|", "\\|")
                lines.append(f"| `--{known.flag}` | {default} | {text} |")
        lines.append("")
    return "\n".join(lines)


def on_page_markdown(markdown: str, *, page: Any, **_: Any) -> str:
    """Insert the sections and the options, and name files outside the site without a link."""
    source = page.file.src_uri

    def read(match: re.Match[str]) -> str:
        if match[1] == "options":
            return _options()
        text = (ROOT / match[1]).read_text(encoding="utf-8")
        return _LINK.sub(lambda link: _relink(link, source), section(text, match[2]))

    def name_outside(match: re.Match[str]) -> str:
        path = match[2].split("#")[0]
        target = posixpath.normpath(posixpath.join("docs", posixpath.dirname(source), path))
        return match[0] if target.startswith("docs/") else f"{match[1]} (`{target}`)"

    return _LINK.sub(name_outside, _LINE.sub(read, markdown))


def on_page_content(html: str, **_: Any) -> str:
    """Remove the markup of Sphinx in docstrings: roles before names, colons before blocks."""
    return re.sub(r":(?:func|class|meth|mod):(?=<code)|<p>::</p>", "", html)
