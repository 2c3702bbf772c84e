"""What the pages about the studies share: tables and findings as Markdown, and where it is written."""

import json
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path

from whiskjax.papers.finding import Finding
from whiskjax.show.tables import Table

DOCS = Path(__file__).parent


def markdown(table: Table) -> str:
    """A table with its caption below."""
    rule = ["---:" if number else "---" for number in table.is_number]
    rows = [[cell.text.replace("|", "\\|") for cell in row] for row in table.rows]
    heads = [heading.replace(": ", ", ") for heading in table.headings]
    lines = [f"| {' | '.join(row)} |" for row in (heads, rule, *rows)]
    return "\n".join((*lines, "", table.caption))


def sections(tables: Sequence[Table]) -> list[str]:
    """Every table under its title."""
    return [part for table in tables for part in (f"## {table.title}", markdown(table))]


def pictures(captions: dict[str, str], study: str) -> list[str]:
    """Pictures STUDY_NAME.png, each over its caption."""
    return [part for name, caption in captions.items() for part in (f"![{name}]({study}_{name}.png)", f"*{caption}*")]


def told(findings: Sequence[Finding]) -> list[str]:
    """Findings: what the paper says, where it says anything, and what is found here."""
    parts = []
    for finding in findings:
        parts.append(f"### {finding.title}")
        parts += [f"*Paper:* {finding.paper}"] if finding.paper else []
        parts.append(f"*Here:* {finding.here}")
    return parts


def write(page: Callable[[dict], Sequence[str]], results: Path, study: str, figures: dict[str, str]) -> None:
    """STUDY.md from the parts of the page, and the figures (name in the results: name in docs)."""
    summary = json.loads((results / "results.json").read_text("utf-8"))
    (DOCS / f"{study}.md").write_text("\n\n".join(page(summary)) + "\n", "utf-8")
    for name, here in figures.items():
        if (results / f"{name}.png").exists():
            shutil.copy(results / f"{name}.png", DOCS / f"{here}.png")
