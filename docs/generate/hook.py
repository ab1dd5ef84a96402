"""MkDocs' hook: pages made from the code, the figures, and the pages that live at the top of the repository.

The first page is README.md, followed by docs/index.md: one source for both.
"""

import re
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(Path(__file__).parent)]

from citation import papers  # noqa: E402
from command_line import command_line_page  # noqa: E402
from concept_figures import concept_figures  # noqa: E402
from departures import departures  # noqa: E402
from example_pages import examples  # noqa: E402
from fidelity import fidelity_commands, fidelity_errors, fidelity_fields, fidelity_profiles  # noqa: E402
from http_api import http_api_page  # noqa: E402
from limits import approach_ms, force_table, limit_table, measured_share, velocity_margin  # noqa: E402
from log_topics import host_clock_fields, log_messages, topic_table  # noqa: E402
from mkdocs.structure.files import File, Files  # noqa: E402
from robot_models import robot_models  # noqa: E402
from versions import pinned  # noqa: E402
from watchdogs import watchdogs  # noqa: E402

DECISIONS = sorted((ROOT / "docs/decisions").glob("[0-9]*.md"))


def decision_list() -> str:
    """Return the list of the decisions: the titles, as links."""
    titles = [(path.name, path.read_text().partition("\n")[0].removeprefix("# ")) for path in DECISIONS]
    return "\n".join(f"- [{title}]({name})" for name, title in titles)


PAGES = {"reference/commands.md": command_line_page, "reference/http.md": http_api_page}
TOP_PAGES = ("ARCHITECTURE.md", "CONTRIBUTING.md", "CHANGELOG.md", "SECURITY.md", "SUPPORT.md", "CODE_OF_CONDUCT.md")
_VERSION = re.compile(r"\{\{ version\(\"([^\"]+)\"\) \}\}")
FILLED = {
    "{{ topic_table }}": topic_table,
    "{{ log_messages }}": log_messages,
    "{{ host_clock_fields }}": host_clock_fields,
    "{{ limit_table }}": limit_table,
    "{{ force_table }}": force_table,
    "{{ velocity_margin }}": velocity_margin,
    "{{ approach_ms }}": approach_ms,
    "{{ measured_share }}": measured_share,
    "{{ decisions }}": decision_list,
    "{{ departures }}": departures,
    "{{ examples }}": examples,
    "{{ papers }}": papers,
    "{{ watchdogs }}": watchdogs,
    "{{ robot_models }}": robot_models,
    "{{ fidelity_fields }}": fidelity_fields,
    "{{ fidelity_errors }}": fidelity_errors,
    "{{ fidelity_commands }}": fidelity_commands,
    "{{ fidelity_profiles }}": fidelity_profiles,
}
RUNBOOK = ROOT / "docs/runbook"


def first_page(all_pages: str) -> str:
    """Return README.md, and behind it docs/index.md, its heading a level lower. Only a clone has the licence's file."""
    return f"{(ROOT / 'README.md').read_text().replace('[Apache-2.0](LICENSE)', 'Apache-2.0')}\n#{all_pages}"


def on_config(config: Any) -> Any:
    """Insert the runbook's pages before the project's, and the decisions after its architecture."""
    pages = sorted(RUNBOOK.glob("*.md"), key=lambda path: (path.stem not in ("index", "README"), path.name))
    if pages:
        runbook: Any = {"Runbook": [f"runbook/{path.name}" for path in pages]}
        config["nav"].insert(-1, runbook)
    decisions: Any = {"Decisions": ["decisions/index.md", *(f"decisions/{path.name}" for path in DECISIONS)]}
    config["nav"][-1]["Project"].insert(2, decisions)
    return config


def on_files(files: Files, config: Any) -> Files:
    """Add what is in no file of docs/."""
    for place, page in PAGES.items():
        files.append(File.generated(config, place, content=page()))
    for name in TOP_PAGES:
        files.append(File.generated(config, name, abs_src_path=str(ROOT / name)))
    for name, content in concept_figures().items():
        files.append(File.generated(config, f"figures/{name}", content=content))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Fill in what comes from the code. A page at the top of the repository is found beside those of docs/."""
    if page.file.src_uri == "index.md":
        markdown = first_page(markdown)
    if page.file.src_uri in (*TOP_PAGES, "index.md"):
        markdown = markdown.replace("](docs/", "](")
    for placeholder, content in FILLED.items():
        if placeholder in markdown:
            markdown = markdown.replace(placeholder, content())
    versions = pinned()
    return _VERSION.sub(lambda found: versions[found[1]], markdown)
