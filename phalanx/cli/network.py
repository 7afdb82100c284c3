"""phalanx network: link models by name, and fits to measured delays."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from phalanx.launcher.streams import echo

commands = typer.Typer(no_args_is_help=True, help="Link models: presets, and fits to a capture.")


@commands.command()
def presets() -> int:
    """Print every preset with its fields and where they are from."""
    from phalanx.network.presets import PRESETS

    for name, preset in PRESETS.items():
        echo(f"# {name}: {preset.source}", *_toml(preset.table))
    return 0


@commands.command()
def fit(
    capture: Annotated[
        Path,
        typer.Argument(help="CSV with a column delay, empty where a message was lost."),
    ],
    unit: Annotated[
        Literal["s", "ms", "us"] | None,
        typer.Option(help="Unit of the delays; by default s if plausible.", show_default=False),
    ] = None,
) -> int:
    """Print the network table that fits measured delays and losses best.

    The CSV has one line for each message, in the order of sending, so that bursts can be found.

    Examples:

      phalanx network fit capture.csv
      phalanx network fit capture.csv --unit ms > network.toml
    """
    from phalanx.network.fit import CaptureError, fit, read_capture

    try:
        with capture.open(encoding="utf-8", newline="") as lines:
            found = fit(read_capture(lines, unit))
    except (CaptureError, OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise typer.BadParameter(f"{capture}: {reason}") from error
    echo(f"# {found.messages} messages, {found.lost} lost")
    echo(f"# half of the delays are below {1e3 * found.median:.4g} ms; those of the model are")
    echo(f"# off by {found.distance:.3g} at most (Kolmogorov and Smirnov's distance)")
    echo(*_toml(found.table))
    return 0


def _toml(fields: Mapping[str, Any]) -> list[str]:
    from phalanx.scenario.load import inline

    return ["[network]", *(f"{key} = {inline(value)}" for key, value in fields.items()), ""]
