"""The events of today's engines as the columns that the judge's parts take."""

from collections.abc import Sequence
from itertools import chain
from typing import NamedTuple

import numpy as np

from phalanx.messages.kinds import Telemetry
from phalanx.recording.columns import Aged, Inputs, Samples, Stated, States, indices, inputs_of
from phalanx.swarm.swarm import Swarm
from phalanx.theory.arrays import Index, joined
from phalanx_plant.judge.claims import Claims
from phalanx_plant.world.events import Event, InputApplied, InputLost, Sampled, StateReached


class Columns(NamedTuple):
    """Consecutive events of a run."""

    states: States
    samples: Samples
    inputs: Inputs
    aged: Aged
    stated: Stated


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
        numbered = list(enumerate(events, self._number))
        self._number += len(events)
        reached = [(n, e.t, e.x) for n, e in numbered if type(e) is StateReached]
        sampled = [(n, e.i, e.t, e.truthful) for n, e in numbered if type(e) is Sampled]
        answers = [(n, e) for n, e in numbered if type(e) is InputApplied or type(e) is InputLost]
        reports = [e.telemetry for _, e in answers if e.telemetry]
        if len(reports) < len(answers):
            raise ValueError("expected inputs with their reports")
        inputs = [
            (n, e.i, e.k, e.t_sample, e.t_apply, False)
            if isinstance(e, InputApplied)
            else (n, e.i, e.k, e.t_sample, e.t_due, True)
            for n, e in answers
        ]
        number, t, x = zip(*reached, strict=True) if reached else [()] * 3
        taken, i, at, true = zip(*sampled, strict=True) if sampled else [()] * 4
        u = [e.u.tolist() for _, e in answers]
        columns = inputs_of(inputs, u, [report.report for report in reports], self._widths)
        states = joined(x, -1, self._states)
        return Columns(
            States(indices(number), np.array(t), states),
            Samples(indices(taken), indices(i), np.array(at), np.array(true, dtype=bool)),
            columns,
            _aged(reports),
            self._stated(columns.i, reports),
        )

    def _stated(self, i: Index, reports: Sequence[Telemetry]) -> Stated:
        """Return the claims that believed agents report."""
        sizes, fits = self._claims.sizes, self._claims.fits
        claims = [
            (row, place, fate.sender, fate.k, fate.claim)
            for row, believed in enumerate(self._is_believed[i].tolist())
            if believed
            for place, fate in enumerate(reports[row].fates)
            if fate.claim is not None
        ]
        rows, places, sender, k, stated = zip(*claims, strict=True) if claims else [()] * 5
        fit = [(len(c.u), len(c.x)) == sizes[l] for l, c in zip(sender, stated, strict=True)]
        values, are_whole = np.zeros((len(claims), fits.shape[1])), np.array(fit, dtype=bool)
        values[~are_whole] = np.nan
        whole = [(*c.u, *c.x) for c, is_whole in zip(stated, fit, strict=True) if is_whole]
        values[fits[indices(sender)] & are_whole[:, None]] = list(chain.from_iterable(whole))
        t_apply = np.array([claim.t_apply for claim in stated])
        columns = indices(rows), indices(places), indices(sender), indices(k)
        return Stated(*columns, t_apply, values)


def _aged(reports: Sequence[Telemetry]) -> Aged:
    ages = [(row, *each) for row, report in enumerate(reports) for each in report.ages]
    rows, senders, seconds = zip(*ages, strict=True) if ages else [()] * 3
    return Aged(indices(rows), indices(senders), np.array(seconds))
