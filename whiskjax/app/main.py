"""The entry point of the command `whiskjax`."""

import os
import sys

from ..rules import import_extra


def main() -> None:
    """Run the command line; without the extra "app", say how to get it."""
    _stand_by_standard_files()
    try:
        import_extra("typer", "app")
        import_extra("rich", "app")
    except ImportError as error:
        sys.exit(f"whiskjax: error: {error}")
    from .command_line import app

    app(prog_name="whiskjax")


def _stand_by_standard_files() -> None:
    """Closed ones (`2>&-`) lead nowhere, lest the first file that is opened gets their number and what libraries write there; and
    what a terminal's encoding lacks is written as its number rather than ending the command."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)
    for stream in (sys.stdout, sys.stderr):
        if stream is not None:
            stream.reconfigure(errors="backslashreplace")  # pyright: ignore[reportAttributeAccessIssue]


if __name__ == "__main__":
    main()
