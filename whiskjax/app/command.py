"""The command behind a result, in the words in which somebody can repeat it."""

import shlex
from collections.abc import Sequence


def command_text(words: Sequence[str]) -> str:
    """Words as a shell reads them. Bytes of file names that are no text are shown as their numbers, as results are text."""
    return shlex.join(words).encode("utf-8", "surrogateescape").decode("utf-8", "backslashreplace")
