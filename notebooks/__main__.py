"""Execute the notebooks: `python -m notebooks [NAME ...]`.

Each runs in a temporary copy of notebooks/ and examples/, so the stored ones, and the repository, stay as they are.
"""

import argparse
import shutil
import sys
import tempfile
import time
from pathlib import Path

import nbformat
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError, CellTimeoutError, DeadKernelError

ROOT = Path(__file__).resolve().parent.parent
CELL_TIMEOUT_S = 1200


def execute(notebook: Path) -> str | None:
    """Execute one notebook, each cell within `CELL_TIMEOUT_S`.

    **Arguments:** `notebook`, the file; its folder is the working directory of its cells.

    **Returns:** nothing when every cell passed, else what went wrong.
    """
    client = NotebookClient(
        nbformat.read(notebook, as_version=4),
        timeout=CELL_TIMEOUT_S,
        kernel_name="python3",  # the kernel of this environment, whatever the notebook was last saved with
        resources={"metadata": {"path": str(notebook.parent)}},
    )
    try:
        client.execute()
    except (CellExecutionError, CellTimeoutError, DeadKernelError) as error:
        return str(error)
    return None


def main(names: list[str]) -> int:
    """Execute the named notebooks (all when none is named) and report.

    **Returns:** 0 when at least one ran and all passed, else 1.
    """
    stored = {path.stem: path for path in sorted((ROOT / "notebooks").glob("*.ipynb"))}
    unknown = [name for name in names if name not in stored]
    if unknown:
        print(f"no such notebook: {', '.join(unknown)} (there are: {', '.join(stored) or 'none'})", file=sys.stderr)
        return 1

    passed, failed = 0, 0
    with tempfile.TemporaryDirectory() as folder:
        for part in ("notebooks", "examples"):
            if (ROOT / part).is_dir():
                shutil.copytree(ROOT / part, Path(folder) / part)
        for name in names or stored:
            start_s = time.perf_counter()
            problem = execute(Path(folder) / "notebooks" / f"{name}.ipynb")
            print(f"{name}: {'failed' if problem else 'passed'} in {time.perf_counter() - start_s:.1f} s", flush=True)
            if problem:
                failed += 1
                print(problem, file=sys.stderr)
            else:
                passed += 1
    print(f"{passed} passed, {failed} failed")
    return 0 if passed and not failed else 1


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m notebooks", description="Execute the notebooks in a copy.")
    parser.add_argument("names", nargs="*", metavar="NAME", help="names without .ipynb (default: all)")
    sys.exit(main(parser.parse_args().names))
