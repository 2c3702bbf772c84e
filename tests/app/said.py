"""What a command says on standard error where nobody reads along."""

import re

_LINE = re.compile(r"whiskjax: (?!error)(?P<words>.+) \.\.\. (?P<seconds>\d+) s")


def progress(stderr):
    """The words and seconds of its lines, each of which must tell what is being done: no warning, no error, nothing of others."""
    found = [_LINE.fullmatch(line) for line in stderr.splitlines()]
    assert None not in found, stderr
    return [(line["words"], int(line["seconds"])) for line in found]
