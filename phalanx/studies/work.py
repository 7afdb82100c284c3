"""The work of a study: compute the rows of one point for some seeds, in any process.

A job holds all that it needs, so that it can travel to another machine.
"""

import threading
import time
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import phalanx
from phalanx.launcher.simulation import RecordsInMemory, Simulation
from phalanx.recording.modules import ModulesError, hashes, make_importable
from phalanx.recording.read import swarm_of
from phalanx.scenario.load import ScenarioError, load
from phalanx.studies.identity import Identity
from phalanx.studies.row import BROKEN, REFUSED, Row, row_of
from phalanx.swarm.rows import SafetyRows
from phalanx.swarm.runnable import shared_rows
from phalanx.theory.expressions.user_methods import MistakenMethodError


class Job(NamedTuple):
    """Runs of one point of the grid."""

    table: dict[str, Any]
    """The scenario's, before overrides."""
    overrides: dict[str, Any]
    """By path."""
    identities: tuple[Identity, ...]
    """Of the runs."""
    modules: Mapping[str, bytes] = {}
    """Sources of the user's modules, by path."""


_ONE_AT_A_TIME = threading.Lock()
"""Runs of a process share compiled functions and their memory, also those of an executor's threads.
"""


def confirm(job: Job) -> list[Row]:
    """Repeat a job's one run with every program a process of its own; return its row."""
    (identity,) = job.identities
    with _ONE_AT_A_TIME:
        make_importable(job.modules, hashes(job.modules), trust=True)
        run = phalanx.run(load(job.table, job.overrides, identity.seed), engine="processes")
        assert run.summary is not None
        found = swarm_of(run.recording)
        return [row_of(identity, job.overrides, run.summary, run.recording, found)]


Work = Callable[[Job, Identity, SafetyRows], Row]
"""Makes the row of a run from its compiled rows."""


def _row_by(work: Work, job: Job, identity: Identity) -> Row:
    """Return the row that a work makes; without a run, one that says why."""
    began = time.monotonic()
    try:
        with _ONE_AT_A_TIME:
            make_importable(job.modules, hashes(job.modules), trust=True)
            return work(job, identity, shared_rows(load(job.table, job.overrides, identity.seed)))
    except (ScenarioError, ModulesError) as error:
        outcome, reason = REFUSED, str(error)
    except MistakenMethodError as error:
        outcome, reason = BROKEN, str(error)
    wall = time.monotonic() - began
    return Row(
        identity=identity, overrides=job.overrides, outcome=outcome, reason=reason, wall_time=wall
    )


def _measured(job: Job, identity: Identity, rows: SafetyRows) -> Row:
    records = RecordsInMemory()
    summary = Simulation(rows, records).run()
    recording = records.recording(rows.swarm.scenario)
    return row_of(identity, job.overrides, summary, recording, rows.swarm)


def compute(job: Job, work: Work = _measured) -> list[Row]:
    """Run every run of a job to its verdict, without files; return their rows."""
    return [_row_by(work, job, identity) for identity in job.identities]
