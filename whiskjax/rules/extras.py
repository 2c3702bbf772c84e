"""Optional dependencies, imported where they are used."""

import importlib
from types import ModuleType


def import_extra(module: str, extra: str) -> ModuleType:
    """Import an optional module, or say which extra installs it.

    **Raises:** `ImportError` naming the extra.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise ImportError(f'{module} is needed here. Install it with:  pip install "whiskjax[{extra}]"') from error
