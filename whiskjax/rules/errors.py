"""The errors that whiskjax raises; each message says what was found, where, and what to do."""


class WhiskjaxError(Exception):
    """Anything that whiskjax refuses on purpose."""


class SensorError(WhiskjaxError):
    """A numerical failure of imaging or estimation, raised outside `jax.jit` from a member of `RESULTS`."""


class FlightError(WhiskjaxError, ValueError):
    """Input that cannot be a flight: names the file, line and column (or the observation) and what was expected."""
