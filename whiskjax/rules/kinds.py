"""Arguments that are objects of a kind: what is none of the kind is refused in our own words."""

from typing import Any

import numpy as np

from .errors import WhiskjaxError


def need(owner: str, name: str, value: Any, kind: type | tuple[type, ...], remedy: str = "") -> None:
    """**Arguments:**

    - `owner`: the class or function, first word of the message.
    - `kind`: what the argument has to be.
    - `remedy`: what to write instead.

    **Raises:** `WhiskjaxError` naming the owner, the argument, what it is and what was expected.
    """
    if isinstance(value, kind):
        return
    expected = " or ".join(k.__name__ for k in (kind if isinstance(kind, tuple) else (kind,)))
    found = f"the class {value.__name__} itself" if isinstance(value, type) else f"a {type(value).__name__}"
    raise WhiskjaxError(f"{owner}: {name} is {found}, but {expected} is expected" + (f": {remedy}" if remedy else ""))


def need_flags(owner: str, **flags: Any) -> None:
    """Options that are on or off: "no", 0 and an array would each be taken as one of the two.

    **Raises:** `WhiskjaxError` naming the owner and the option that is neither True nor False.
    """
    for name, value in flags.items():
        if not isinstance(value, bool | np.bool_):
            raise WhiskjaxError(f"{owner}: {name} is True or False, not {value!r}"[:200])
