"""The events of today's engines as the columns that the judge's parts take."""

from collections.abc import Sequence
from itertools import chain
from typing import NamedTuple

import numpy as np

from phalanx.messages.kinds import Telemetry
from phalanx.network.inbox import DeliveryReport
from phalanx.recording.columns import Aged, Inputs, Samples, Stated, States, indices, inputs_of
from phalanx.swarm.swarm import Swarm
from phalanx.theory.arrays import Array, Index
from phalanx_plant.judge.claims import Claims
from phalanx_plant.world.events import Event, InputApplied, InputLost, Sampled, StateReached


class Columns(NamedTuple):
    """Consecutive events of a run."""

    states: States
    samples: Samples
    inputs: Inputs
    aged: Aged
    stated: Stated
    fates: list[tuple[int, int]]
    """Of each claim in `stated`, the row of its input, and which of the fates reported it is."""


class EventColumns:
    """Makes columns of events, and numbers them."""

    def __init__(self, swarm: Swarm, claims: Claims) -> None:
        """Begin at event 0."""
        self._widths = np.array([len(m.dynamics.inputs) for m in swarm.members])
        self._states, self._claims, self._number = swarm.pairs.states, claims, 0
        self._is_believed = np.isin(np.arange(len(self._widths)), swarm.normal)

    def turned(self, i: int) -> None:
        """Count no claim that agent i reports any more: an adversary may accuse whom it likes."""
        self._is_believed[i] = False

    def of(self, events: Sequence[Event]) -> Columns:
        """Return the columns of the next events. Raises ValueError if an input has no report."""
        begin, self._number = self._number, self._number + len(events)
        reached, sampled = list[tuple[int, float, Array]](), list[tuple[int, int, float, bool]]()
        inputs, u = list[tuple[int, int, int, float, float, bool]](), list[list[float]]()
        reports = list[Telemetry]()
        for number, event in enumerate(events, begin):
            match event:
                case StateReached(t=t, x=x):
                    reached.append((number, t, x))
                case Sampled(i=i, t=t, truthful=truthful):
                    sampled.append((number, i, t, truthful))
                case InputApplied() | InputLost():
                    if event.telemetry is None:
                        raise ValueError(f"expected an input with its report, got {event}")
                    lost = isinstance(event, InputLost)
                    due = event.t_due if isinstance(event, InputLost) else event.t_apply
                    inputs.append((number, event.i, event.k, event.t_sample, due, lost))
                    u.append(event.u.tolist())
                    reports.append(event.telemetry)
        numbers, times, x_of = zip(*reached, strict=True) if reached else [()] * 3
        states = np.concatenate([np.zeros(0), *x_of]).reshape(-1, self._states)
        taken, agents, at, true = zip(*sampled, strict=True) if sampled else [()] * 4
        columns = inputs_of(inputs, u, [report.report for report in reports], self._widths)
        stated, fates = self._stated(columns.i, reports)
        return Columns(
            States(indices(numbers), np.array(times), states),
            Samples(indices(taken), indices(agents), np.array(at), np.array(true, dtype=bool)),
            columns,
            _aged(reports),
            stated,
            fates,
        )

    def _stated(
        self, i: Index, reports: Sequence[Telemetry]
    ) -> tuple[Stated, list[tuple[int, int]]]:
        rows, fates, places = list[int](), list[DeliveryReport](), list[tuple[int, int]]()
        for row, believed in enumerate(self._is_believed[i].tolist()):
            for n, fate in enumerate(reports[row].fates if believed else ()):
                if fate.claim is not None:
                    rows.append(row)
                    fates.append(fate)
                    places.append((row, n))
        claims = [fate.claim for fate in fates if fate.claim is not None]
        sizes, sender = self._claims.sizes, indices([fate.sender for fate in fates])
        fit = [
            (len(claim.u), len(claim.x)) == sizes[fate.sender]
            for claim, fate in zip(claims, fates, strict=True)
        ]
        values = np.zeros((len(claims), self._claims.fits.shape[1]))
        fits = np.array(fit, dtype=bool)
        values[~fits] = np.nan
        of = [chain(c.u, c.x) for c, of_size in zip(claims, fit, strict=True) if of_size]
        values[self._claims.fits[sender] & fits[:, None]] = list(chain.from_iterable(of))
        t_apply = np.array([claim.t_apply for claim in claims])
        k = indices([fate.k for fate in fates])
        return Stated(indices(rows), sender, k, t_apply, values), places


def _aged(reports: Sequence[Telemetry]) -> Aged:
    counts = indices([len(report.ages) for report in reports])
    pairs = list(chain.from_iterable([report.ages for report in reports]))
    ages = np.array([age for _, age in pairs])
    return Aged(np.arange(len(reports)).repeat(counts), indices([l for l, _ in pairs]), ages)
