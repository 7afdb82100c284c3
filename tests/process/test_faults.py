"""Every kind of fault in a run: its effect is there and counted, without it there is none."""

import pytest

import phalanx

DURATION = 0.6

LIE = {"kind": "lie", "agent": "2", "at": 0.05, "for": 0.5}
FAULTS = {
    "loss": {"network.loss": 0.2},
    "bursts": {"network.loss": {"mean": 0.2, "burst": 4.0}},
    "loss by distance": {"network.loss_by_distance": {"none_within": 1.0, "all_beyond": 9.0}},
    "delay": {"network.delay": 0.01},
    "jitter": {"network.delay": {"time": 0.02, "jitter": 0.01, "distribution": "pareto"}},
    "floor": {"network.delay_floor": {"per_metre": 0.001}},
    "duplicate": {"network.duplicate": 0.2},
    "corrupt": {"network.corrupt": 0.2},
    "reorder": {"network.delay": 0.02, "network.reorder": {"probability": 0.3}},
    "trace": {"network.trace": {"t": [0.0, 0.1, 0.2], "delay": [0.0, 0.02, -1.0]}},
    "rate": {"network.rate": {"bits_per_second": 1e5}},
    "slot": {"network.slot": 0.04},
    "partition": {"faults": [{"kind": "partition", "at": 0.2, "for": 0.2, "groups": [["1"]]}]},
    "ring": {"faults": [{"kind": "partition", "at": 0.2, "for": 0.2, "shape": "ring"}]},
    "hold": {"faults": [{"kind": "hold", "at": 0.2, "for": 0.2}]},
    "link": {"faults": [{"kind": "link", "at": 0.2, "for": 0.2, "delay": 0.05}]},
    "another input": {"faults": [{**LIE, "says": [1.0, 0.0]}]},
    "equivocation": {"faults": [{**LIE, "equivocate": True}]},
    "replay": {"faults": [{**LIE, "replay": 10, "to": ["1"]}]},
    "wrong apply time": {"faults": [{**LIE, "apply_time": -0.005}]},
    "silence": {"faults": [{**LIE, "silent": True, "to": ["3"]}]},
    "lost samples": {"network.sample.loss": 0.2},
    "lost inputs": {"network.actuation.loss": 0.2},
    "late inputs": {"network.actuation.delay": 0.004},
}
IN_A_FILE = (
    "loss", "bursts", "delay", "corrupt", "reorder", "trace", "rate", "slot", "partition", "link",
)  # fmt: skip
"""Those of test_fault_scenarios.py."""


def run(overrides: dict, folder) -> phalanx.Run:
    scenario = phalanx.load("unicycles", {"duration": DURATION, **overrides}, seed=2)
    return phalanx.run(scenario, engine="in-process", out=folder)


def effects(run: phalanx.Run) -> tuple:
    """Return what faults of links change: fates, sampling instants, times of inputs."""
    inputs = run.inputs.select("agent", "k", "t", "t_apply")
    return run.links.drop("run", "faults").rows(), inputs.rows(), run.summary.rejected


@pytest.fixture(scope="module")
def calm(tmp_path_factory) -> tuple:
    return effects(run({}, tmp_path_factory.mktemp("calm")))


# A duplicate comes when the original is there, and counts once: it is reported, without effect.
@pytest.mark.parametrize("name", [name for name in FAULTS if name not in IN_A_FILE])
def test_a_fault_has_its_effect_and_is_counted(name, calm, tmp_path):
    faulty = run(FAULTS[name], tmp_path)
    assert faulty.summary.faults
    assert all(fault.count for fault in faulty.summary.faults)
    assert faulty.summary.notes == []
    named = faulty.links["faults"].explode().drop_nulls().to_list()
    for fault in faulty.summary.faults:
        of_broadcasts = not fault.name.startswith(("network.sample", "network.actuation"))
        assert named.count(fault.name) == fault.count * of_broadcasts
    assert (effects(faulty) == calm) == (name == "duplicate")


@pytest.mark.parametrize(
    "overrides",
    [
        {"network.loss_by_distance": {"none_within": 900.0, "all_beyond": 901.0}},
        {"network.links": [{"from": "4", "loss": 1.0}]},  # an adversary, without listeners
        {"faults": [{"kind": "partition", "at": 9.0, "for": 1.0, "groups": [["1"]]}]},
        {"faults": [{"kind": "lie", "agent": "4", "for": 1.0, "says": "zero"}]},  # likewise
        {"faults": [{"kind": "hold", "of": "actuation", "at": 9.0, "for": 1.0}]},
    ],
)
def test_a_fault_without_effect_changes_nothing_and_is_named(overrides, calm, tmp_path):
    ineffective = run(overrides, tmp_path)
    assert effects(ineffective) == calm
    (fault,) = ineffective.summary.faults
    assert ineffective.summary.notes == [f"{fault.name} never had an effect"]


def test_corrupt_broadcasts_are_counted_as_refused(tmp_path):
    summary = run(FAULTS["corrupt"], tmp_path).summary
    assert sum(summary.rejected.values()) == summary.faults[0].count > 0


def test_a_step_whose_input_is_lost_reports_what_it_heard(tmp_path):
    heard = [
        run({"network.loss": 0.2, "network.actuation.loss": loss}, tmp_path / str(loss)).links
        for loss in (0.0, 0.3)
    ]
    # What is lost on the way to an actuator makes the broadcast of it false.
    reported = [links.drop("t", "lied").sort("receiver", "sender", "k") for links in heard]
    before_the_end = [links.filter(links["k"] < 40) for links in reported]
    assert before_the_end[0].equals(before_the_end[1])


def test_lost_and_late_inputs_are_counted_in_the_verdict(tmp_path):
    for name in ("lost inputs", "late inputs"):
        summary = run(FAULTS[name], tmp_path / name).summary
        (prompt,) = (a for a in summary.assumptions if a.name == "inputs in time")
        on_their_way = len(phalanx.load("unicycles").programs())
        assert 0 <= summary.faults[0].count - prompt.failed <= on_their_way
        assert prompt.failed > 0
        assert summary.outcome == phalanx.Outcome.SAFE
    gap = run(FAULTS["lost samples"], tmp_path / "gap").summary
    (sampling,) = (a for a in gap.assumptions if a.name == "sampling gap")
    assert sampling.failed > 0


def test_a_run_with_every_kind_of_fault_is_repeated_bit_by_bit(tmp_path):
    everything: dict = {"faults": []}
    for overrides in FAULTS.values():
        everything["faults"] += overrides.get("faults", [])
        everything.update({k: v for k, v in overrides.items() if k != "faults"})
    first = run(everything, tmp_path)
    assert all(fault.count for fault in first.summary.faults)
    assert phalanx.verify(first, engine="in-process")
