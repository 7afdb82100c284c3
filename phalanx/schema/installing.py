"""The place where pip finds Phalanx."""

HERE = "."
"""This repository's folder, as long as no index has it."""


def installing(package: str) -> str:
    """Return the command that installs a package of this repository."""
    return f"pip install {HERE}/packages/{package}"
