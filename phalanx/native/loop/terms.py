"""The terms of h_tot as tables: pairs by kind, members, and the functions that they take."""

from collections.abc import Sequence

import numpy as np

from phalanx.native.loop.kernels import Kernels, begins
from phalanx.native.loop.memory import Memory
from phalanx.theory.rows.composed import ComposedTerms

_VALUES = 64
"""Most numbers of a pair's row."""


def terms_memory(
    kernels: Kernels, terms: Sequence[ComposedTerms], agents: Sequence[int], composed: bool = True
) -> Memory:
    """Return the terms of members, which are these agents of the run, each with its own terms.

    composed: whether they are used, and not the members and obstacles alone.
    """
    swarm = terms[0].swarm
    pairs, members, q = swarm.pairs, swarm.members, swarm.pairs.degree
    every = pairs.choose(pairs.every)
    groups, polytopes = every.groups, [members.constant_polytopes[l] for l in range(len(agents))]
    boxes = [polytope.box for polytope in polytopes]
    indices = [group.indices for group in groups]
    widths, results = [i.shape[1] for i in indices], [g.kind.jets.results for g in groups]
    counts, rooms = [len(g.pairs) for g in groups], rooms_up_to(len(every.pairs))
    inputs, states = members.inputs[-1].stop, members.states[-1].stop
    corners = [polytope.corners.size for polytope in polytopes]
    widest = max(
        [*(w * n for w, n in zip(widths, counts, strict=True)), *(64 + c for c in corners)]
    )
    widest = max(widest, states + len(pairs.parameters))
    per_pair = np.repeat(widths, counts)
    return Memory("Terms", {
        "degree": q, "members": len(agents), "obstacles": len(pairs.obstacles),
        "parameters": len(pairs.parameters), "agent": agents,
        "state_at": begins(s.stop - s.start for s in members.states),
        "input_at": begins(s.stop - s.start for s in members.inputs),
        "kind": members.kind_of, "corner_at": begins(corners),
        "corners": np.concatenate([polytope.corners.ravel() for polytope in polytopes]),
        "low": np.concatenate([box.low for box in boxes if box]),
        "high": np.concatenate([box.high for box in boxes if box]),
        "metric": np.concatenate([m.dynamics.input_metric() for m in pairs.members]),
        "extremes": [kernels(kind.extremes) if composed else 0 for kind in members.kinds],
        "groups": len(groups),
        "jets": [kernels(group.kind.jets) if composed else 0 for group in groups],
        "group_at": begins(counts), "width": widths, "results": results,
        "index_at": begins(per_pair.tolist())[:-1],
        "indices": np.concatenate([i.ravel() for i in indices]),
        "first": every.pairs[:, 0], "second": every.pairs[:, 1],
        "force_at": begins(np.bincount(every.force_pair, minlength=len(every.pairs)).tolist()),
        "force_input": every.force_input,
        "rooms": len(rooms), "room": rooms,
        "composition": [kernels(swarm.jets.flat(room)) if composed else 0 for room in rooms],
        "near": [kernels(each.near) for each in terms],
        "numbers": np.concatenate([np.zeros(states), pairs.parameters]),
        "rows": np.zeros(widest), "values": np.zeros(max(int(np.dot(results, counts)), _VALUES)),
        "columns": np.zeros(rooms[-1] * (q + 1)), "chain": np.zeros(q + 1 + rooms[-1] * q),
        "around": np.ones(len(pairs.obstacles)), "c": np.zeros(inputs),
        "least": np.zeros(len(agents)), "most": np.zeros(len(agents)),
        "shown": np.zeros(len(every.pairs)), "value_at": np.zeros(len(every.pairs)),
    })  # fmt: skip


def rooms_up_to(pairs: int) -> list[int]:
    """Return the numbers of pairs for which a composition is compiled, the largest last."""
    powers = [2**k for k in range(max(pairs - 1, 0).bit_length())]
    return [*powers, pairs] if pairs else [1]
