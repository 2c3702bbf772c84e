"""Runs that are killed while they put their results in place, and runs that do so at once; prints what was found there as JSON.

    python tests/app/killed_runs.py FOLDER [--every N] [--kills N] [--pairs N]

A program of its own, so that processes can be forked where no JAX has started threads; only the modules that write are imported.
"""

import argparse
import contextlib
import hashlib
import json
import mmap
import os
import random
import shutil
import signal
import sys
import time
import types
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
for package in ("whiskjax", "whiskjax.app", "whiskjax.files", "whiskjax.rules"):
    sys.modules[package] = types.ModuleType(package)
    sys.modules[package].__path__ = [str(ROOT / package.replace(".", "/"))]
sys.path.insert(0, str(ROOT))

from whiskjax.app.output import refuse_place, result_folder  # noqa: E402
from whiskjax.files import whole_folder  # noqa: E402

OURS = ("results.json", "report.html", "a.csv", "b.csv", "figure.png", "calibrated")
OLD, NEW = 0, 1
OUTSIDE, BEFORE, AFTER = 0, 1, 2  # marks: not at the swap, before and after the names change places


def write(out, version):
    """A run: the new version has no calibrated flight."""
    with result_folder(out, OURS) as folder:
        (folder / "results.json").write_text(json.dumps({"version": version}))
        for name in OURS[1:5]:
            (folder / name).write_text(f"{name} of version {version}\n" * 200)
        if version == OLD:
            (folder / "calibrated").mkdir()
            for name in ("flight.toml", "pos.csv"):
                (folder / "calibrated" / name).write_text(name)


def strangers(out):
    """What somebody else keeps in the folder."""
    (out / "notes.txt").write_text("mine")
    (out / "mine" / "deep").mkdir(parents=True)
    (out / "mine" / "deep" / "data").write_bytes(bytes(range(256)))
    (out / "mine" / "link").symlink_to("../notes.txt")
    (out / "mine").chmod(0o750)


def fingerprint(folder):
    """Of names, kinds, rights and contents of all that a folder holds; None where there is no folder."""
    if not folder.exists():
        return None
    found = hashlib.sha256()
    for path in sorted(folder.rglob("*")):
        content = os.readlink(path).encode() if path.is_symlink() else path.read_bytes() if path.is_file() else b""
        found.update(f"{path.relative_to(folder)} {path.lstat().st_mode:o} {len(content)} ".encode() + content)
    return found.hexdigest()


def both_versions(parent):
    """Fingerprints of either version beside the stranger's files."""
    found = []
    for version in (OLD, NEW):
        write(parent / "one", version)
        strangers(parent / "one")
        found.append(fingerprint(parent / "one"))
        shutil.rmtree(parent / "one")
    return found


def fork(work):
    """Run something in a process of its own; returns its number."""
    child = os.fork()
    if child:
        return child
    code = 1
    try:
        work()
        code = 0
    finally:
        os._exit(code)


def die_at(step):
    """Kill this process before line `step` (from 1) of those that run from the beginning of the swap on."""
    seen, inside = 0, False

    def line(frame, event, arg):
        nonlocal seen
        if event == "line":
            seen += 1
            if seen == step:
                os.kill(os.getpid(), signal.SIGKILL)
        return line

    def call(frame, event, arg):
        nonlocal inside
        inside = inside or frame.f_code is whole_folder._put.__code__
        return line if inside else None

    sys.settrace(call)


def no_exchange():
    """As on a file system that cannot."""
    whole_folder.exchange = lambda first, second: False


def slow_renames(pause_s=0.003):
    """Long between two renames and after the lock is let go: as on a busy machine, where another process goes on there."""
    rename, locked = Path.rename, whole_folder.locked

    def slow(path, target):
        result = rename(path, target)
        time.sleep(pause_s)
        return result

    @contextlib.contextmanager
    def slowly(path):
        with locked(path):
            yield
        time.sleep(pause_s)

    Path.rename, whole_folder.locked = slow, slowly


def at_lines(parent, every, can_exchange):
    """Kills at every Nth line; stops where a run gets to its end."""
    out, versions = parent / "out", both_versions(parent)
    count = dict.fromkeys(("kills", "inside", "old", "new", "neither", "missing", "not_mended", "left_over"), 0)
    write(out, OLD)
    strangers(out)
    step = 1
    while True:

        def run(step=step):
            if not can_exchange:
                no_exchange()
            die_at(step)
            write(out, NEW)

        _, status = os.waitpid(fork(run), 0)
        if not os.WIFSIGNALED(status):
            assert os.WEXITSTATUS(status) == 0
            return count
        count["kills"] += 1
        count["inside"] += 1
        look(out, versions, count)
        write(out, OLD)  # the next run, which also puts everything back for the next kill
        count["left_over"] += os.listdir(parent) != ["out"]
        count["not_mended"] += fingerprint(out) != versions[OLD]
        step += every


def look(out, versions, count):
    """What a killed run left: a whole folder, or, on a file system that cannot exchange, two of them beside the name."""
    found = fingerprint(out)
    if found is None:
        count["missing"] += 1
        refuse_place(out, OURS)  # as any verb does before its work
        found = fingerprint(out)
    count[{versions[OLD]: "old", versions[NEW]: "new"}.get(found, "neither")] += 1


def at_random(parent, kills, seed):
    """Kills from outside of runs that write both versions in turn: one in five at any moment, the others soon after the mark says
    swap."""
    out, versions = parent / "out", both_versions(parent)
    count = dict.fromkeys(("kills", "inside", "before_exchange", "after_exchange", "old", "new", "neither", "missing"), 0)
    mark, chance = mmap.mmap(-1, 1), random.Random(seed)
    put, remove, exchange = whole_folder._put, whole_folder._remove, whole_folder.exchange

    def marked(function, before, after):
        def call(*arguments):
            mark[0] = before
            result = function(*arguments)
            mark[0] = after
            return result

        return call

    def runs():
        whole_folder._put = marked(put, BEFORE, AFTER)
        whole_folder.exchange = marked(exchange, BEFORE, AFTER)
        whole_folder._remove = marked(remove, AFTER, OUTSIDE)
        version = NEW
        while True:
            write(out, version)
            version = OLD + NEW - version

    write(out, OLD)
    strangers(out)
    # On a busy machine a signal comes late: go on until half of the kills asked for were inside, or thrice as many are made.
    while count["kills"] < kills or (2 * count["inside"] < kills and count["kills"] < 3 * kills):
        mark[0] = OUTSIDE
        child = fork(runs)
        time.sleep(chance.uniform(0.005, 0.03))
        while count["kills"] % 5 and mark[0] == OUTSIDE:
            if os.waitpid(child, os.WNOHANG)[0]:
                sys.exit("a run failed before it was killed")
        if chance.random() < 0.6:
            time.sleep(chance.uniform(0.0, 0.001))
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        count["kills"] += 1
        count["inside"] += mark[0] != OUTSIDE
        count["before_exchange"] += mark[0] == BEFORE
        count["after_exchange"] += mark[0] == AFTER
        look(out, versions, count)
    refuse_place(out, OURS)
    return count | {"left_over": int(os.listdir(parent) != ["out"])}


def pairs(parent, count, can_exchange):
    """Two runs at once into one folder, of different versions."""
    out, versions = parent / "out", both_versions(parent)
    found = dict.fromkeys(("pairs", "old", "new", "neither", "missing", "failed", "left_over"), 0)
    write(out, OLD)
    strangers(out)
    for _ in range(count):
        start, go = os.pipe()

        def run(version, start=start, go=go):
            if not can_exchange:
                no_exchange()
                slow_renames()
            os.close(go)
            os.read(start, 1)  # ends when nobody holds the other end any more
            write(out, version)

        children = [fork(lambda v=version: run(v)) for version in (OLD, NEW)]
        os.close(start)
        os.close(go)
        found["failed"] += sum(os.waitpid(child, 0)[1] != 0 for child in children)
        found["pairs"] += 1
        look(out, versions, found)
        found["left_over"] += os.listdir(parent) != ["out"]
    return found


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--every", type=int, default=1, help="lines between two kills at lines")
    parser.add_argument("--kills", type=int, default=100, help="at random moments")
    parser.add_argument("--pairs", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()

    def place(name):
        (options.folder / name).mkdir()
        return options.folder / name

    found = {
        "at lines": at_lines(place("lines"), options.every, True),
        "at lines, two renames": at_lines(place("renames"), options.every, False),
        "at random": at_random(place("random"), options.kills, options.seed),
        "pairs": pairs(place("pairs"), options.pairs, True),
        "pairs, two renames": pairs(place("pairs-renames"), options.pairs // 4, False),
    }
    print(json.dumps(found, indent=1))


if __name__ == "__main__":
    main()
