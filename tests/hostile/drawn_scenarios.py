"""Scenarios drawn at random that the loop in C can run: a table from a seed, part by part.

What is compiled changes with every family of seeds; starts, scripts, the network and the seed of
all draws with every seed.
"""

import random
from collections.abc import Mapping, Sequence
from typing import Any

from phalanx.scenario.load import validate
from phalanx.scenario.model import Scenario

FAMILY = 10
"""Seeds with the same functions."""
Table = dict[str, Any]
_ORDERS: Mapping[int, Mapping[int, tuple[str, ...]]] = {
    2: {
        1: ("single-integrator", "unicycle", "differential-drive"),
        2: ("double-integrator", "dynamic-unicycle"),
        3: ("triple-integrator",),
    },
    3: {
        1: ("single-integrator",),
        2: ("double-integrator",),
        3: ("triple-integrator", "quadrotor"),
    },
}
"""Dynamics by axes and relative degree."""


class Drawing:
    """A scenario's table, drawn part by part."""

    def __init__(self, seed: int, links: Sequence[int]) -> None:
        """links: numbers of rules for some links alone, of which one is drawn."""
        self._links = links
        self._family, self._seed = random.Random(seed // FAMILY), random.Random(seed)
        self._axes = self._family.choice((2, 2, 3))
        self._degree = self._family.choice((1, 1, 2, 3))
        self._names = [f"a{k}" for k in range(self._family.randint(2, 12))]
        self._normal = self._family.randint(1, len(self._names))
        self._room = self._family.choice((1.5, 2.5, 5.0)) * len(self._names) ** (1 / self._axes)
        self._pairwise = self._family.random() < 0.5
        flat = self._pairwise and self._axes == 2 and self._degree == 1
        self._headings = flat and self._family.random() < 0.3

    def table(self) -> Table:
        """The whole table."""
        most = len(self._names)
        sizes = self._family.choice(([self._normal], [1, self._normal - 1])), (most - self._normal,)
        begin, groups = 0, list[Table]()
        for role, counts in zip(("normal", "adversary"), sizes, strict=True):
            for count in filter(None, counts):
                groups.append(self._group(role, self._names[begin : begin + count]))
                begin += count
        shortest = min(g["clock"]["period"] - g["clock"].get("jitter", 0.0) for g in groups)
        latency = self._family.choice((0.0, 0.0, 0.3, 0.95)) * shortest
        return {
            "name": "drawn",
            "duration": 1.0,
            "seed": self._seed.randrange(1000),
            "time": {
                "latency": latency,
                "integration_step": self._family.choice((1e-3, 1e-3, 7e-4, 2.5e-4)),
            },
            "safety": self._safety(),
            "formation": {
                "path": [self._point(self._family) for _ in range(4)],
                "finish": self._family.choice((0.4, 1.0, 9.0)),
                "radius": self._family.uniform(0.5, 3.0),
                "slots": most,
            },
            "obstacles": [self._obstacle() for _ in range(self._family.randint(0, 3))],
            "limits": self._limits(),
            "network": self._network(),
            "agents": groups,
        }

    def _point(self, draw: random.Random | None = None) -> list[float]:
        draw = draw or self._seed
        return [draw.uniform(-self._room, self._room) for _ in range(self._axes)]

    def _safety(self) -> Table:
        draw, q = self._family, self._degree
        margin = draw.choice(("paper", "corrected", "local", "integrated"))
        table: Table = {
            "function": self._function(),
            "rho": draw.choice((0.05, 5.0, 40.0)),
            "alpha": [draw.choice((0.5, 2.0, 8.0)) for _ in range(q)],
            "composition": "pairs" if self._pairwise else "lse",
            "margin": margin if self._pairwise else "paper",
            "information": draw.choice(("paper", "in-flight", "worst-case", "split")[
                : 4 if self._pairwise else 3
            ]),
            "silence": self._family.choice((1.0, 0.2, 0.03)),
        }  # fmt: skip
        if table["margin"] in ("paper", "corrected"):
            table |= {"eta": draw.choice((0.0, 0.3, 5.0)), "xi": draw.choice((0.0, 2.0))}
        if self._pairwise and margin != "integrated" and draw.random() < 0.3:
            table["alpha"][-1] = {"type": "power", "gain": 2.0, "exponent": 2.0}
        if draw.random() < 0.4:
            table["neighbourhood"] = self._room * draw.uniform(0.3, 1.5)
        return table

    def _function(self) -> Table:
        radius = self._family.choice((0.5, 1.0))
        if self._headings:
            return {"type": "heading-aware", "radius": radius, "kappa": 0.5}
        return {"type": self._family.choice(("separation", "distance")), "radius": radius}

    def _group(self, role: str, names: list[str]) -> Table:
        draw, period = self._family, self._family.choice((0.01, 0.02, 0.02, 0.05, 0.11))
        kind, dynamics = self._dynamics(role == "normal")
        jitter = draw.choice((0.0, 0.2, 0.2, 0.9)) * period
        bound = draw.choice((0.0, 0.3, 2.0))
        table: Table = {
            "names": names, "role": role, "dynamics": dynamics,
            "law": self._law(role, names, kind),
            "clock": {"period": period, "jitter": jitter},
            "disturbance": {"bound": bound, "every": self._seed.choice((0.003, 0.05, 0.2))},
            "start": [self._start(kind) for _ in names],
        }  # fmt: skip
        if (goals := draw.randrange(4)) == 0:
            table["slots"] = [self._names.index(name) for name in names]
        elif goals < 3 and table["law"]["type"].startswith("track"):
            table["goal"] = [self._goal() for _ in names]
        if draw.random() < 0.3:
            table["sensing"] = self._room * draw.uniform(0.3, 2.0)
        return table

    def _dynamics(self, normal: bool) -> tuple[str, Table]:
        draw, kinds = self._family, _ORDERS[self._axes][self._degree]
        if normal and self._headings:
            kinds = ("unicycle",)
        kind, size = draw.choice(kinds), draw.choice((0.5, 2.0, 4.0))
        offset, space = {"offset": draw.choice((0.1, 0.25))}, {"dimension": self._axes}
        fields: Mapping[str, Table] = {
            "single-integrator": {"speed": size, **space},
            "unicycle": {"speed": size, "turn_rate": 2.0, **offset},
            "differential-drive": {
                "wheel_rate": 8.0 * size, "wheel_radius": 0.1, "track": 0.5, **offset
            },
            "double-integrator": {
                "acceleration": size, "drag": draw.choice((0.0, 0.6)), **space
            },
            "dynamic-unicycle": {
                "acceleration": size, "turn_acceleration": 3.0, "drag": 0.5, **offset
            },
            "triple-integrator": {"jerk": size, **space},
            "quadrotor": {"thrust": size, "tilt": 0.3},
        }  # fmt: skip
        return kind, {"type": kind, **fields[kind]}

    def _start(self, kind: str) -> list[float]:
        states = {
            "single-integrator": self._axes, "double-integrator": 2 * self._axes,
            "triple-integrator": 3 * self._axes, "unicycle": 3, "differential-drive": 3,
            "dynamic-unicycle": 5, "quadrotor": 9,
        }[kind]  # fmt: skip
        return self._point() + [self._seed.uniform(-0.5, 0.5) for _ in range(states - self._axes)]

    def _law(self, role: str, names: list[str], kind: str) -> Table:
        draw, q = self._family, self._degree
        gains = [draw.choice((1.0, 2.0)), draw.choice((1.0, 2.5)), draw.choice((1.0, 3.0))][:q]
        laws = [{"type": "track", "gains": gains}, self._script(kind)]
        if role == "adversary":
            targets = dict.fromkeys(names[:1], draw.choice(self._names))
            guard = {
                "radius": 1.0, "obstacle_clearance": 1.5, "alpha": [2.0] * q, "rho": 2.0,
                "xi": draw.choice((0.0, 1.0)), "eta": draw.choice((0.0, 1.0)),
            }  # fmt: skip
            chase = {"type": "chase", "gains": gains}
            laws += [chase, {**chase, "targets": targets}, {"type": "worst"}]
            laws += [{**chase, "targets": targets, "guard": guard}] * 2
        if q == 1:
            laws += [{"type": "track-velocity", "gain": draw.choice((0.5, 2.0))}] * 2
            laws += [{"type": "pursue", "gain": 5.0}] * (role == "adversary")
        return draw.choice(laws)

    def _script(self, kind: str) -> Table:
        inputs = 2 if "unicycle" in kind or kind == "differential-drive" else self._axes
        at = [0.0, *sorted(self._seed.uniform(0.01, 0.9) for _ in range(self._seed.randrange(4)))]
        rows = [[self._seed.uniform(-0.25, 0.25) for _ in range(inputs)] for _ in at]
        return {"type": "script", "at": at, "inputs": rows}

    def _goal(self) -> Any:
        draw = self._family
        points = [self._point(draw) for _ in range(3)]
        kinds: list[Any] = [
            points[0],
            {"type": "path", "points": points, "speed": draw.uniform(0.5, 20.0)},
            {"type": "waypoints", "points": points, "times": [0.0, 0.3, draw.uniform(0.4, 2.0)]},
            {"type": "waypoints", "points": points, "tolerance": draw.uniform(0.2, 4.0)},
        ]
        return draw.choice(kinds)

    def _obstacle(self) -> Table:
        draw, center = self._family, self._point(self._family)
        kinds: list[Table] = [
            {"center": center, "clearance": draw.choice((0.5, 1.0))},
            {"normal": [1.0, *[0.0] * (self._axes - 1)], "offset": -self._room},
            {"center": center, "size": [1.0, 0.5, 2.0][: self._axes], "clearance": 0.3},
        ]
        if self._axes == 2:
            kinds[2]["angle"] = draw.uniform(-3.0, 3.0)
            x, y = center
            corners = [[x, y], [x + 1.0, y], [x, y + 1.0]]
            kinds.append({"corners": corners, "clearance": 0.2})
        return draw.choice(kinds)

    def _limits(self) -> list[Table]:
        radius = self._room * self._family.choice((1.2, 3.0))
        fence = {"type": "fence", "center": [0.0] * self._axes, "radius": radius}
        return [fence] if self._family.random() < 0.2 else []

    def _network(self) -> Table:
        draw = self._seed
        links = [
            {**self._rules(), "from": draw.choice(["*", *self._names]),
             "to": draw.choice(["*", *self._names])}
            for _ in range(draw.choice(self._links))
        ]  # fmt: skip
        return {**self._rules(), "links": links}

    def _rules(self) -> Table:
        draw = self._seed
        if draw.random() < 0.1:
            preset = draw.choice(("lan", "wifi", "lossy-wifi", "lte", "satellite", "jammed"))
            return {"preset": preset}
        low, high = sorted(draw.choice((0.0, 0.01, 0.05, 0.3)) * draw.random() for _ in range(2))
        spread = {
            "time": low, "jitter": high, "correlation": draw.choice((0.0, 0.5, 0.95)),
            "distribution": draw.choice(("uniform", "normal", "pareto", "paretonormal")),
        }  # fmt: skip
        near, chance = self._room * draw.random(), draw.choice((0.1, 0.5, 1.0))
        times = [0.0, *sorted(draw.uniform(1e-3, 0.8) for _ in range(draw.randint(1, 9)))]
        floor = {"time": 0.02 * draw.random(), "per_metre": 0.02 * draw.random()}
        burst = {"mean": draw.uniform(0.0, 0.5), "burst": draw.uniform(1.0, 3.0)}
        rate = {
            "bits_per_second": draw.choice((2e4, 1e5, 1e6)), "size": draw.choice((64.0, 128.0)),
            "limit": draw.randint(1, 5),
        }  # fmt: skip
        every = {
            "loss": draw.choice((chance, burst)),
            "loss_by_distance": {"none_within": near, "all_beyond": near + 2.0 * draw.random()},
            "duplicate": chance, "corrupt": chance,
            "trace": {"t": times, "delay": [draw.uniform(-0.02, 0.1) for _ in times]},
            "rate": rate, "delay": draw.choice((high, {"low": low, "high": high}, spread, spread)),
            "reorder": {"probability": chance, "gap": draw.randint(1, 4)},
            "delay_floor": floor, "slot": draw.choice((0.004, 0.03, 0.25)),
        }  # fmt: skip
        share = draw.choice((0.1, 0.3, 0.6))
        return {field: rule for field, rule in every.items() if draw.random() < share}


def scenario_of(seed: int, links: Sequence[int] = (0, 0, 1, 3)) -> Scenario:
    """Draw a scenario; links: as Drawing has them. Raises ScenarioError if it is none."""
    return validate(Drawing(seed, links).table(), f"seed {seed}")
