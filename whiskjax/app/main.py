"""The entry point of the command `whiskjax`."""

import sys

from ..rules import import_extra


def main() -> None:
    """Run the command line; without the extra "app", say how to get it."""
    try:
        import_extra("typer", "app")
        import_extra("rich", "app")
    except ImportError as error:
        sys.exit(f"whiskjax: error: {error}")
    from .command_line import app

    app(prog_name="whiskjax")


if __name__ == "__main__":
    main()
