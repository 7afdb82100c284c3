"""What the panels say of an agent."""

import pytest

from phalanx.viewer.page.panels import agent_in_words
from phalanx.wire.frames import AgentStatus


@pytest.mark.parametrize(
    ("residual", "told"),
    [(-4.26e-14, "residual 0"), (3e-12, "residual 0"), (2e-9, "residual 2e-09"), (-20.3, "-20.3")],
)
def test_a_residual_of_rounding_alone_is_none(residual: float, told: str) -> None:
    assert f"{told} ·" in agent_in_words(AgentStatus(u=(1.0,), residual=residual))


def test_steps_with_empty_sets_are_counted_in_words() -> None:
    assert "· 1 backup ·" in agent_in_words(AgentStatus(u=(1.0,), backups=1))
    told = agent_in_words(AgentStatus(u=(1.0,), backups=2, without_authority=1))
    assert "· 2 backups, 1 without authority ·" in told
