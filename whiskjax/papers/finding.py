"""What a paper says, and what its simulation says of it."""

from typing import NamedTuple

from ..show.tables import Table


class Finding(NamedTuple):
    """A statement of the paper, and what its own figures and the simulation say of it; a table that shows it, if one does."""

    title: str
    paper: str
    here: str
    table: Table | None = None
