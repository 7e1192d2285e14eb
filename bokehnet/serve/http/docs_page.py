"""Page ``/docs`` of a service: its interface and all settings, without scripts and external files."""

from html import escape
from typing import Any

from bokehnet.settings.preset import presets
from bokehnet.settings.settings import all_settings, group_types

__all__ = ["CONTENT_POLICY", "docs_page"]

# Content security policy of the page: nothing but its own style sheet.
CONTENT_POLICY = "default-src 'none'; style-src 'unsafe-inline'"

_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #222; background: #fff; }
body { max-width: 60rem; margin: 2rem auto; padding: 0 1rem; }
h1, h2, h3 { line-height: 1.2; } h3 { margin-top: 2rem; }
code, pre { font: 13px/1.5 ui-monospace, monospace; }
pre { background: #f2f2f2; padding: 1rem; overflow: auto; }
table { border-collapse: collapse; width: 100%; } td, th { text-align: left; vertical-align: top; }
td, th { padding: .3rem .8rem .3rem 0; border-bottom: 1px solid #ddd; }
@media (prefers-color-scheme: dark) {
  body { color: #ddd; background: #181818; } pre { background: #262626; } td, th { border-color: #444; }
}
"""

_EXAMPLE = """\
curl -F image=@photo.jpg -F disparity=@disparity.png \\
    -F 'settings={"camera": {"blur": 40}, "aperture": {"blades": 7}}' {origin}/v1/jobs
curl {origin}/v1/jobs/ID
curl -o out.png {origin}/v1/jobs/ID/result
"""


def docs_page(schema: dict[str, Any], origin: str) -> str:
    """Return the page in HTML.

    Args:
        schema: OpenAPI document of the service.
        origin: Address of the service, such as ``http://localhost:8000``.
    """
    info = {key: escape(value) for key, value in schema["info"].items()}
    parts = [
        f"<!doctype html><html lang=en><meta charset=utf-8><title>{info['title']} service</title>",
        f"<meta name=viewport content='width=device-width'><style>{_STYLE}</style>",
        f"<h1>{info['title']} {info['version']}</h1>",
        f"<p>{info['description']} <a href=/openapi.json>OpenAPI document</a></p>",
        f"<h2>Example</h2><pre>{escape(_EXAMPLE.replace('{origin}', origin))}</pre>",
        "<p>With tokens, each request needs the header <code>Authorization: Bearer TOKEN</code>.</p>",
        "<h2>Requests</h2>",
    ]
    for path, methods in schema["paths"].items():
        for method, operation in methods.items():
            parts.append(_operation(schema, path, method, operation))
    looks = ", ".join(f"<code>{escape(name)}</code>" for name in presets())
    parts += [f"<h2>Presets</h2><p>{looks}</p>", "<h2>Settings</h2>"]
    parts += [_settings_table(group.GROUP, group.TITLE) for group in group_types()]
    return "\n".join(parts)


def _operation(schema: dict[str, Any], path: str, method: str, operation: dict[str, Any]) -> str:
    """Return the section of a request: description, fields, headers and codes."""
    rows = [
        (item["name"], item["in"], "required" if item.get("required") else "")
        for item in operation.get("parameters", ())
    ]
    for content in operation.get("requestBody", {}).get("content", {}).values():
        name = content["schema"].get("$ref", "").rpartition("/")[2]
        body = schema.get("components", {}).get("schemas", {}).get(name, {})
        rows += [(field, _kind(item), "") for field, item in body.get("properties", {}).items()]
    table = "".join(
        f"<tr><td><code>{escape(name)}</code><td>{escape(where)}<td>{escape(note)}"
        for name, where, note in rows
    )
    codes = ", ".join(operation.get("responses", {}))
    about = escape(operation.get("description", ""))
    return (
        f"<h3><code>{method.upper()} {escape(path)}</code></h3><p>{about} Responses: {escape(codes)}.</p>"
        + (f"<table>{table}</table>" if table else "")
    )


def _kind(item: dict[str, Any]) -> str:
    """Return "file" or "text" for a form field."""
    options = [item, *item.get("anyOf", ())]
    is_file = any(option.get("format") == "binary" or "contentMediaType" in option for option in options)
    return "file" if is_file else "text"


def _settings_table(group: str, title: str) -> str:
    """Return the fields of a group with accepted values, default and help."""
    rows = []
    for known in all_settings().values():
        if known.group != group:
            continue
        default = "" if known.default is None else str(known.default)
        cells = (known.expectation, default, known.help)
        rows.append(f"<tr><td><code>{known.name}</code>" + "".join(f"<td>{escape(cell)}" for cell in cells))
    head = "<tr><th>field<th>accepts<th>default<th>"
    return f"<h3><code>{group}</code>: {escape(title)}</h3><table>{head}{''.join(rows)}</table>"
