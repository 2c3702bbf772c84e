"""What every room obeys: one enumeration of numerical failures, one family of errors, float64 where it matters."""

from .arrays import Arrays as Arrays
from .arrays import Numbers as Numbers
from .compiled import compiled as compiled
from .errors import FlightError as FlightError
from .errors import SensorError as SensorError
from .errors import WhiskjaxError as WhiskjaxError
from .extras import import_extra as import_extra
from .fixed import Fixed as Fixed
from .kinds import need as need
from .kinds import need_flags as need_flags
from .labels import Labels as Labels
from .once import once as once
from .precision import arrays_of as arrays_of
from .precision import is_traced as is_traced
from .precision import on_device as on_device
from .precision import plain as plain
from .precision import require_x64 as require_x64
from .results import RESULTS as RESULTS
from .results import first_failure as first_failure
from .results import raise_failures as raise_failures
