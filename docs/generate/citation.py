"""The papers to cite, from CITATION.cff."""

from pathlib import Path

import yaml

ROOT = Path(__file__).resolve().parents[2]


def papers() -> str:
    """Return a list of the papers, in Markdown, with what is implemented of each."""
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    return "\n".join(
        f"- {', '.join(_name(author) for author in paper['authors'])}: *{paper['title']}*, "
        f"{paper['year']}, [{paper['url'].removeprefix('https://')}]({paper['url']}), "
        f"[doi:{paper['doi']}](https://doi.org/{paper['doi']}). Here: {paper['notes']}."
        for paper in cited["references"]
    )


def _name(author: dict[str, str]) -> str:
    return f"{author['given-names']} {author['family-names']}"
