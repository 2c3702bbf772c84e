"""[pos_errors]: the motions of a link that a block adjustment estimates, and how well POS knows them."""

from typing import TYPE_CHECKING, Any

from ..chain.sensor import Sensor
from ..estimate.block.pos_errors import PosErrors
from ..flights.flight import Flight
from ..rules import FlightError, WhiskjaxError
from .flight_toml import NAME
from .names import listed, meant
from .units import degree_lists, file_words, floats, radian_array

if TYPE_CHECKING:
    from .schema import PosErrorsTable


def pos_errors_from_toml(table: "PosErrorsTable | None", sensor: Sensor) -> PosErrors | None:
    """What is known of the POS errors, in radians; None where the file says nothing.

    **Raises:** `FlightError` where the chain lacks the link, or the link has no motions that fit.
    """
    if table is None:
        return None
    if table.link not in sensor.names:
        known = f"the chain has {listed(sensor.names)}"
        raise FlightError(f"{NAME}: pos_errors.link: no frame {table.link!r}{meant(table.link, sensor.names)}; {known}")
    try:
        errors = PosErrors(
            table.link,
            tuple(radian_array(table.turn_sigma_deg).tolist()),
            tuple(table.shift_sigma_m),
            None if table.turn_correlation_s is None else tuple(table.turn_correlation_s),
            None if table.shift_correlation_s is None else tuple(table.shift_correlation_s),
            table.observed,
        )
        errors.roots(sensor)
    except WhiskjaxError as error:
        raise FlightError(f"{NAME}: pos_errors: {file_words(str(error))}") from error
    return errors


def pos_errors_to_toml(flight: Flight) -> dict[str, Any] | None:
    """The table [pos_errors]; None where nothing is known.

    **Raises:** `FlightError` where the sensor lacks the link.
    """
    errors = flight.pos_errors
    if errors is None:
        return None
    if errors.link not in flight.sensor.names:
        raise FlightError(f"pos_errors: no frame named {errors.link!r}; there are {listed(flight.sensor.names)}")
    table: dict[str, Any] = {
        "link": errors.link,
        "turn_sigma_deg": degree_lists(errors.turn_sigma_rad),
        "shift_sigma_m": floats(errors.shift_sigma_m),
    }
    correlated = {"turn_correlation_s": errors.turn_correlation_s, "shift_correlation_s": errors.shift_correlation_s}
    table |= {key: floats(times) for key, times in correlated.items() if times is not None}
    return table if errors.observed else table | {"observed": False}
