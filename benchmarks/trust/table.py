"""What the bench found, for people and for files."""

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from .run import Row, power

_COLUMNS = ("way", "kind", "runs", "scored", "sound", "wrong", "sound and wrong", "named", "noncentrality", "said most")
_SAID = 3


def share(value: float) -> str:
    """A share as a percentage; a dash where nothing was counted."""
    return "-" if math.isnan(value) else f"{100 * value:.0f} %"


def of_noncentrality(value: float) -> str:
    """Two digits are enough, and beyond a million nothing is said by more."""
    return f"{value:.3g}" if value < 1e6 else "> 1e6"


def _cells(row: Row) -> tuple[str, ...]:
    said = ", ".join(f"{kind} {share(part)}" for kind, part in row.said[:_SAID])
    noncentrality = "" if row.way.kind == "clean" else of_noncentrality(row.noncentrality)
    named = "" if row.way.kind == "clean" else share(row.share("named"))
    counts = (share(row.share(what)) for what in ("sound", "wrong", "fooled"))
    return (row.way.name, row.way.kind, str(len(row.runs)), str(len(row.scored)), *counts, named, noncentrality, said)


def _rms(row: Row) -> str:
    return ", ".join(f"{name} {value:.2f}" for name, value in row.rms)


def fooled(rows: Sequence[Row]) -> list[Row]:
    """Ways by which the verdict was fooled, the most often first."""
    ones = [row for row in rows if row.way.kind == "scored" and row.share("fooled") > 0]
    return sorted(ones, key=lambda row: -row.share("fooled"))


def page(rows: Sequence[Row]) -> str:
    """All rows as Markdown: clean data, scored ways and blind ones, verb by verb, and the power curve of weak ones."""
    lines = []
    for verb in dict.fromkeys(row.way.verb for row in rows):
        mine = [row for row in rows if row.way.verb == verb]
        lines += [f"## {verb}", "", f"| {' | '.join(_COLUMNS)} |", f"|---|{'---:|' * (len(_COLUMNS) - 2)}---|"]
        lines += [f"| {' | '.join(_cells(row))} |" for row in mine]
        lines += ["", *(f"- {row.way.name}, RMS of error over sigma: {_rms(row)}" for row in mine if row.way.kind == "clean")]
        lines += ["", "noncentrality | runs | noticed", "---:|---:|---:"]
        lines += [f"{p.least:g} to {p.most:g} | {p.runs} | {share(p.noticed)}" for p in power(mine)]
        by = "; ".join(f"{row.way.name} ({share(row.share('fooled'))})" for row in fooled(mine))
        lines += ["", f"Fooled by: {by or 'none'}", ""]
    return "\n".join(lines)


def table(rows: Sequence[Row]) -> str:
    """All rows in columns for a terminal."""
    cells = [_COLUMNS, *(_cells(row) for row in rows)]
    wide = [max(len(line[i]) for line in cells) for i in range(len(_COLUMNS))]
    lines = [
        "  ".join(c.ljust(w) if i in (0, 1, 9) else c.rjust(w) for i, (c, w) in enumerate(zip(line, wide, strict=True)))
        for line in cells
    ]
    return "\n".join(line.rstrip() for line in lines)


def figures(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """All rows as plain numbers."""
    return [
        {
            "verb": row.way.verb,
            "way": row.way.name,
            "kind": row.way.kind,
            "runs": len(row.runs),
            "scored": len(row.scored),
            **{what: row.share(what) for what in ("sound", "wrong", "fooled", "named")},
            "noncentrality": row.noncentrality,
            "said": dict(row.said),
            "rms": dict(row.rms),
        }
        for row in rows
    ]


def write(rows: Sequence[Row], file: Path) -> None:
    """The figures as JSON, in which what is no number is null."""
    plain = [{k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in of.items()} for of in figures(rows)]
    file.write_text(json.dumps(plain, indent=1), encoding="utf-8")
