"""phalanx certify: prove a recorded run safe, with code of its own."""

from typing import TYPE_CHECKING

import typer

from phalanx.cli.jobs import Job
from phalanx.cli.options import RunArgument, Trust
from phalanx.launcher.streams import echo, echo_error

if TYPE_CHECKING:
    from phalanx.recording.read import Recording
    from phalanx_certify.checker.certify import Certification


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command(rich_help_panel=Job.CHECK)(certify)


def certify(run: RunArgument, trust: Trust = False) -> int:
    """After a run: prove from its recording, by independent code, that no pair could become unsafe.

    To check a scenario before a run use `phalanx check`; to test that a run can be repeated bit by
    bit, `phalanx verify`.

    At every input of a normal agent, h of its pairs is bounded until the next one, whatever the
    other agents and the disturbances do within their bounds, and between integration steps too.
    Bounds are rounded outwards. With controller and plant are shared: the scenario as read, the
    dynamics, h, the pairs that count, and the corners of input polytopes; no arithmetic.

    A recording that contradicts its dynamics and disturbance bounds is not certified. The horizon
    is how long an agent's certificates last if it hears nothing more, looked for up to eight times
    the longest planned time between two inputs.

    Exit status 0 if the run is certified, 1 if it is not or its recording is cut short, 3 if the
    recording cannot be read, 4 if it is not decided: an operation in h or in the dynamics has no
    interval rule, inputs depend on the state, states are missing, or a motion is too wild to bound.
    """
    from phalanx.cli.display import spinner
    from phalanx.faults.commands import turns
    from phalanx.launcher.streams import warn_of_damage
    from phalanx.recording.read import read
    from phalanx_certify.checker.certify import certify as certify_run
    from phalanx_certify.checker.intervals import UncertifiableError, UndecidedError

    with spinner("reading"):
        recording = read(run, trust)
    warn_of_damage(recording)
    if not recording.states:
        echo_error(f"{recording.path}: the recording holds no state")
        return 3
    names = [name for name, _, _ in recording.scenario.roster()]
    with spinner("certifying") as show:
        try:
            certification = certify_run(
                recording.scenario,
                recording.states,
                recording.steps,
                lambda share: show(f"{share:.0%}"),
                turned := turns(names, recording.commands),
            )
        except UndecidedError as error:
            echo(f"not decided: {error}")
            return 4
        except UncertifiableError as error:
            echo(f"not certified: {error}")
            return 1
    _show(certification, recording, turned)
    return 0 if certification and not recording.damage else 1


def _show(certification: "Certification", recording: "Recording", turned: dict[str, float]) -> None:
    from rich.console import Console

    from phalanx.cli.display import TextTable, styled

    table = TextTable(show_header=False)
    table.add_column(style="dim")
    table.add_column()
    # What is missing of a recording may hold anything.
    until = f" up to t = {recording.states[-1].t:.3f} s alone" if recording.damage else ""
    certified = styled(f"certified{until}", f"{'yellow' if until else 'green'} bold")
    table.add_row("verdict", certified if certification else styled("not certified", "red bold"))
    table.add_row("assumed", "the dynamics, and disturbances within their bounds")
    table.add_row("recording", "does not contradict them")
    count, samples = certification.certified, certification.samples
    share = f"{count} of {samples} ({count / max(samples, 1):.2%})"
    table.add_row("inputs certified until the next", share)
    table.add_row("shortest horizon", f"{1e3 * certification.horizon:.4g} ms")
    for name, t in turned.items():
        pairs = f"pairs of agent {name} with no normal agent, from t = {t:.6f} s on"
        table.add_row("turned, not counted", pairs)
    if certification.gap:
        table.add_row(
            "first not covered",
            f"{certification.gap.pair}, from t = {certification.gap.t:.6f} s on",
        )
    Console().print(table)
