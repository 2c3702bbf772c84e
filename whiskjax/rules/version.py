"""Which version of the package this is."""

from importlib import metadata


def installed_version(package: str) -> str:
    """The version that was installed; "unknown" where the folder was only put on the path."""
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "unknown"
