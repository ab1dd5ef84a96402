"""The HTTP API's page, from what the console says about itself."""

from types import SimpleNamespace
from typing import Any

from console.address import Address
from console.app import create_app
from console.routes.description import OPENAPI_PATH

PREFIX = "/api"
_UNUSED_PORT = 8080

_HEAD = f"""# HTTP API

Made from the console's own description, which a running console gives at `{OPENAPI_PATH}`. Example
[09](../examples.md#09-talk-to-the-console) is a program that uses it, [10](../examples.md#10-queue-of-trials) another.

"""


def document() -> dict[str, Any]:
    """Return the console's OpenAPI description."""
    # routes are all that is looked at: nothing is served, and no part of it used
    no_parts: Any = SimpleNamespace(sign_in=None)
    return create_app(no_parts, Address(_UNUSED_PORT)).openapi()


def http_api_page() -> str:
    """Return the page, in Markdown."""
    described = document()
    operations = [
        (f"{method.upper()} {path}", of)
        for path, methods in described["paths"].items()
        if path.startswith(PREFIX)
        for method, of in methods.items()
    ]
    parts = [_HEAD + described["info"]["description"], _refusals(operations)]
    for tag in described["tags"]:
        parts.append(f"## {tag['name'].capitalize()}\n\n{tag['description']}\n")
        parts += [_operation(title, of) for title, of in operations if of.get("tags", [])[:1] == [tag["name"]]]
    others = [_operation(title, of) for title, of in operations if not of.get("tags")]
    parts += ["## Others\n", *others] if others else []
    parts.append("## Types\n")
    schemas = described["components"]["schemas"]
    used = _closure(set().union(*(_references(of) for _, of in operations)), schemas)
    parts += [_schema(name, of) for name, of in schemas.items() if name in used]
    return "\n".join(parts)


def _operation(title: str, of: dict[str, Any]) -> str:
    lines = [f"### {title}", "", f"{of['summary']}.", "", of.get("description", ""), ""]
    if of.get("parameters"):
        lines += ["| parameter | in | type | default |", "|---|---|---|---|"]
        for one in of["parameters"]:
            default = "required" if one["required"] else f"`{one['schema'].get('default')!r}`"
            lines.append(f"| `{one['name']}` | {one['in']} | {_type(one['schema'])} | {default} |")
        lines.append("")
    for content in of.get("requestBody", {}).get("content", {}).values():
        lines += [f"Body: {_type(content['schema'])}.", ""]
    answers = [f"{status}, {_answer(answer)}" for status, answer in of["responses"].items() if status < "300"]
    refused = ", ".join(sorted(status for status in of["responses"] if status >= "400"))
    return "\n".join([*lines, f"Answers {'; '.join(answers)}. Refused: {refused}.", ""])


def _refusals(operations: list[tuple[str, dict[str, Any]]]) -> str:
    answers = {status: answer for _, of in operations for status, answer in of["responses"].items() if status >= "400"}
    rows = [f"| {status} | {answer['description']} |" for status, answer in sorted(answers.items())]
    return "\n".join(["## Refusals", "", "| status | what |", "|---|---|", *rows, ""])


def _answer(of: dict[str, Any]) -> str:
    kinds = {kind: _type(content.get("schema", {})) for kind, content in of.get("content", {}).items()}
    return " or ".join(name if kind == "application/json" else f"`{kind}`" for kind, name in kinds.items()) or "nothing"


def _schema(name: str, of: dict[str, Any]) -> str:
    lines = [f"### {name}", "", " ".join(of.get("description", "").split()), ""]
    if "enum" in of:
        lines += ["One of " + ", ".join(f"`{value}`" for value in of["enum"]) + ".", ""]
    if of.get("properties"):
        lines += ["| key | type | default |", "|---|---|---|"]
        for key, value in of["properties"].items():
            default = "required" if key in of.get("required", ()) else f"`{value.get('default')!r}`"
            lines.append(f"| `{key}` | {_type(value)} | {default} |")
        lines.append("")
    return "\n".join(lines)


def _type(schema: dict[str, Any]) -> str:
    if "$ref" in schema:
        name = schema["$ref"].rpartition("/")[2]
        return f"[{name}](#{name.lower()})"
    if "anyOf" in schema:
        return " or ".join(_type(one) for one in schema["anyOf"])
    kind = schema.get("type", "any")
    if kind == "array":
        return f"list of {_type(schema.get('items', {}))}"
    low, high = schema.get("minimum"), schema.get("maximum")
    return kind if low is None or high is None else f"{kind}, {low:g} to {high:g}"


def _references(value: Any) -> set[str]:
    if isinstance(value, dict):
        own = {value["$ref"].rpartition("/")[2]} if "$ref" in value else set()
        return own.union(*map(_references, value.values()))
    if isinstance(value, list):
        return set().union(*map(_references, value))
    return set()


def _closure(names: set[str], schemas: dict[str, Any]) -> set[str]:
    further = names.union(*(_references(schemas[name]) for name in names))
    return names if further == names else _closure(further, schemas)
