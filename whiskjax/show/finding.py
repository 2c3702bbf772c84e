"""What a paper says, and what its simulation says of it."""

from typing import NamedTuple


class Finding(NamedTuple):
    """A statement of the paper, and what its own figures and the simulation say of it."""

    title: str
    paper: str
    here: str
