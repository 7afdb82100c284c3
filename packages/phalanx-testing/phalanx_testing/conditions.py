"""The conditions of a test's run: a scenario, its faults, its network and other fields."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from phalanx.faults.fault import Fault
from phalanx.scenario.load import load, read_table
from phalanx.scenario.model import Scenario
from phalanx_testing.fault_tables import table_of

Source = str | Path | Mapping[str, Any] | Scenario
"""A scenario as phalanx.load takes it, or as it returns it."""


def faulty(
    scenario: Source,
    *,
    seed: int | None = None,
    faults: Sequence[Fault | Mapping[str, Any]] = (),
    overrides: Mapping[str, Any] | None = None,
    **network: Any,
) -> Scenario:
    """Return a scenario under faults.

    Args:
        scenario: a file, the name of one that ships, a table, or a loaded one.
        seed: replaces the scenario's.
        faults: more than those that it declares.
        overrides: other fields by path. A value may be an object of a class of yours: dynamics, a
            law, a controller.
        network: fields of [network], such as loss=0.3.

    Raises ScenarioError: it is not valid.
    """
    source = table_of_scenario(scenario) if isinstance(scenario, Scenario) else scenario
    fields = {f"network.{name}": value for name, value in network.items()}
    fields |= overrides or {}
    if faults:
        declared = fields.get("faults", read_table(source).get("faults", ()))
        more = [table_of(fault) if isinstance(fault, Fault) else fault for fault in faults]
        fields["faults"] = [*declared, *more]
    return load(source, fields, seed)


def table_of_scenario(scenario: Scenario) -> dict[str, Any]:
    """Return the table of a scenario, which a file can hold."""
    return scenario.model_dump(
        mode="json", by_alias=True, exclude={"reading"}, exclude_none=True, exclude_defaults=True
    )
