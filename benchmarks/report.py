"""The table of what was asked and reached, and the committed baseline of each model of processors."""

import importlib.metadata
import json
import platform
import re
from pathlib import Path

from .peers import MissingPeer, compiler_version, processor
from .suite import Benchmark
from .timing import Measured

BASELINE = Path(__file__).with_name("baseline.json")
MARGIN = 1.3  # a ratio may grow by this factor over the baseline before the gate calls it a regression

COLUMNS = ("benchmark", "peer", "asked", "reached", "median", "wall", "baseline", "ours", "peer's", "compile", "")


def figure(value: float | None, unit: str) -> str:
    """A ratio, seconds or GB with two decimals, small ones with two digits; a dash where there is none."""
    if value is None or value != value:
        return "-"
    return f"{value:{'.2f' if value >= 0.1 else '.2g'}}{' ' * (unit != 'x')}{unit}"


def duration(seconds: float | None, items: int) -> str:
    """Time of one item in a readable unit."""
    if seconds is None:
        return "-"
    each = seconds / items
    for unit, size in (("s", 1.0), ("ms", 1e-3), ("us", 1e-6)):
        if each >= size:
            return f"{each / size:.3g} {unit}"
    return f"{each * 1e9:.3g} ns"


def verdict(benchmark: Benchmark, measured: Measured | str, baseline: float | None) -> str:
    """Empty where the gate lets it pass, otherwise why it does not."""
    if isinstance(measured, str):
        return measured
    if benchmark.asked is not None and not measured.reached <= benchmark.asked:  # NaN fails too
        return "slower than asked"
    if baseline is not None and not measured.reached <= MARGIN * baseline:
        return f"more than {MARGIN:g} times the baseline"
    return ""


def table(rows: list[tuple[Benchmark, Measured | str]], baseline: dict[str, float]) -> str:
    """Asked and reached side by side; ratios are our CPU time over the peer's, times are for one item."""
    lines = [COLUMNS]
    for benchmark, measured in rows:
        known = baseline.get(benchmark.name)
        found = Measured(float("nan")) if isinstance(measured, str) else measured
        failure = verdict(benchmark, measured, known)
        lines.append(
            (
                benchmark.name,
                benchmark.peer,
                "-" if benchmark.asked is None else f"<= {figure(benchmark.asked, benchmark.unit)}",
                figure(found.reached, benchmark.unit),
                figure(found.median, benchmark.unit),
                figure(found.wall, benchmark.unit),
                figure(known, benchmark.unit),
                duration(found.ours_s, found.items),
                duration(found.peer_s, found.items),
                figure(found.compile_s, "s"),
                "  ".join(filter(None, [f"FAILED: {failure}" if failure else "ok", found.note])),
            )
        )
    widths = [max(len(line[i]) for line in lines) for i in range(len(COLUMNS))]
    left = {0, 1, len(COLUMNS) - 1}

    def cell(i: int, text: str) -> str:
        return text.ljust(widths[i]) if i in left else text.rjust(widths[i])

    return "\n".join("  ".join(cell(i, text) for i, text in enumerate(line)).rstrip() for line in lines)


def machine() -> dict[str, str]:
    """What a ratio may depend on, and nothing that names the computer."""
    try:
        compiler = compiler_version()
    except MissingPeer as error:
        compiler = str(error)
    versions = {name: importlib.metadata.version(name) for name in ("jax", "jaxlib", "numpy")}
    return {"processor": processor(), "compiler": compiler, "python": platform.python_version(), **versions}


def kind_of(processor: str) -> tuple[str, str]:
    """Make of a processor, and make with model: "AMD EPYC" and "AMD EPYC (family 25, model 17)"."""
    words = [word for word in re.sub(r"\(.*?\)", "", processor).split() if not re.search(r"\d|^(CPU|Processor|@)$", word)]
    make = " ".join(words[:2]) or "unknown"
    model = re.search(r"\(family \d+, model \d+\)", processor)
    return make, f"{make} {model[0]}" if model else make


def _baselines() -> dict[str, dict]:
    return json.loads(BASELINE.read_text()) if BASELINE.exists() else {}


def read_baseline() -> dict[str, float]:
    """Committed ratios of this model of processors, else of its make, by the benchmark's name; empty where there are none yet.

    The same code against the same peer is 1.1 on one model and 1.6 on another, of one make, so models are not compared.
    """
    (make, model), found = kind_of(processor()), _baselines()
    return found.get(model, found.get(make, {})).get("ratios", {})


def write_baseline(rows: list[tuple[Benchmark, Measured | str]]) -> None:
    """Writes what was measured now over what the file holds for this model; seconds depend on the machine and are left out."""
    model = kind_of(processor())[1]
    ratios = dict(_baselines().get(model, {}).get("ratios", {}))
    for benchmark, measured in rows:
        if benchmark.unit == "x" and isinstance(measured, Measured):
            ratios[benchmark.name] = round(measured.reached, 3 if measured.reached >= 0.1 else 5)
    found = _baselines() | {model: {"machine": machine(), "ratios": ratios}}
    BASELINE.write_text(json.dumps(found, indent=2) + "\n")
