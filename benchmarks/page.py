"""What was measured, as a Markdown page for people who choose software."""

from collections.abc import Sequence

from .report import duration, figure, machine
from .suite import Benchmark
from .timing import Measured

_HEAD = """# Speed

Written by `make bench ARGS="--page docs/speed.md"`, which measures everything anew. A ratio is CPU time of whiskjax over that of
the peer, which does the same work on the same numbers to the same result, in one process and on one thread unless the line says
otherwise; below 1 whiskjax is faster. Both are warmed up, take turns, and the fastest calls count. Compile time stands apart: it
is paid once, and kept from one run to the next. *Limit* is the figure that we set out to stay below; `make gate` fails where one
is exceeded, or where a ratio has grown by more than 30 % over the one that `benchmarks/baseline.json` holds for this model of
processors. `make bench ARGS=NAME` measures one line again, or all whose names begin so.

{machine}.

| name | what | peer | ratio or figure | limit | one item, whiskjax | one item, peer | compile |
|---|---|---|---:|---:|---:|---:|---:|
"""


def page(rows: Sequence[tuple[Benchmark, Measured | str]]) -> str:
    """The page docs/speed.md; figures that miss their limit are bold and say so."""
    lines, notes = [], []
    for benchmark, found in rows:
        if isinstance(found, str):
            notes.append(f"- `{benchmark.name}`: not measured, {found}.")
            continue
        value = figure(found.reached, benchmark.unit)
        if benchmark.asked is not None and not found.reached <= benchmark.asked:
            value = f"**{value} (missed)**"
        cells = (
            f"`{benchmark.name}`",
            benchmark.what,
            "" if benchmark.peer == "-" else benchmark.peer,
            value,
            "" if benchmark.asked is None else figure(benchmark.asked, benchmark.unit),
            "" if found.ours_s is None else duration(found.ours_s, found.items),
            "" if found.peer_s is None else duration(found.peer_s, found.items),
            "" if found.compile_s is None else figure(found.compile_s, "s"),
        )
        lines.append(f"| {' | '.join(cells)} |")
        if found.note:
            notes.append(f"- `{benchmark.name}`: {found.note}.")
    told = ", ".join(f"{key} {value}" for key, value in machine().items())
    return _HEAD.format(machine=f"Measured with: {told}") + "\n".join(lines) + "\n\n## Remarks\n\n" + "\n".join(notes) + "\n"
