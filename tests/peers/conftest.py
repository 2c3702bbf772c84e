"""Where the peers' values are."""

import pytest

from tests.peers.source import peer_values as folder
from tests.real.sets import missing


@pytest.fixture(scope="session")
def peer_values():
    """Their folder; skips where it is not there."""
    if why := missing(folder()):
        pytest.skip(why)
    return folder()
