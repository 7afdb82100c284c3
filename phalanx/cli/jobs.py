"""The jobs by which `phalanx --help` groups its commands."""

from enum import StrEnum

import typer
from typer.models import CommandInfo, TyperInfo


class Job(StrEnum):
    """A panel of the help, in the order of the panels."""

    RUN = "Run"
    LOOK = "Look at a run"
    CHECK = "Check what is proven"
    STUDY = "Study many runs"
    EXTEND = "Extend"
    DEPLOY = "Deploy: the programs of a run, each alone"
    PACKAGES = "Other packages"


def group_by_job(app: typer.Typer) -> None:
    """Sort an app's commands by their jobs; those that name none are other packages'."""
    entries: list[CommandInfo | TyperInfo] = [*app.registered_commands, *app.registered_groups]
    for entry in entries:
        entry.rich_help_panel = entry.rich_help_panel or Job.PACKAGES
    app.registered_commands.sort(key=lambda command: _position(command.rich_help_panel))


def _position(panel: str | None) -> int:
    """Return a panel's place in the help; a package's own panels come last."""
    panels: list[str] = [*Job]
    return panels.index(panel) if panel in panels else len(panels)
