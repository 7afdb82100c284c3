"""Swarms of several kinds of pairs, q = 1, 2 and 3, the library's classes and a user's own."""

from functools import cache

from examples.bicycles import Bicycle
from phalanx.theory.models.integrators import DoubleIntegrator, SingleIntegrator, TripleIntegrator
from phalanx.theory.models.wheeled import Unicycle
from phalanx.theory.safety.composition import ComposedSet, Member, compose
from phalanx.theory.safety.function import Distance, HeadingAware, Separation
from phalanx.theory.safety.obstacles import Sphere, Wall
from tests.unit.theory.users_own import Boosted, Drifter, Oval

RHO = 2.0
SPHERES = (Sphere((3.0, 1.0), 1.2), Sphere((-2.0, 4.0), 0.7))
AROUND = (SPHERES[0], Wall((1.0, 2.0), 4.0, 0.5), SPHERES[1])
_SWARMS = {
    "unicycles": (1, [Unicycle(4.0, 2.0)] * 3 + [Unicycle(2.0, 1.0)] * 2, Separation(1.0)),
    "heading-aware": (1, [Unicycle(4.0, 2.0)] * 4, HeadingAware(1.0, 2.0)),
    "users' own": (1, [Drifter(), SingleIntegrator(1.0), Unicycle(1.0, 1.0)], Oval()),
    "equal by ==": (1, [Boosted(1.0), Boosted(1.0, gain=3.0)] * 2, Separation(1.0)),
    "accelerations": (
        2,
        [DoubleIntegrator(2.0, 0.7, 2)] * 3 + [Bicycle(1.0, 1.0, 1.0)] * 2,
        Distance(1.0),
    ),
    "jerks": (3, [TripleIntegrator(1.0, 2)] * 4, Oval()),
}
DEGREES = {name: degree for name, (degree, *_) in _SWARMS.items()}


@cache
def sample_swarm(name: str) -> ComposedSet:
    """The last two members attack; if the function takes walls there is one."""
    _, dynamics, function = _SWARMS[name]
    normal = len(dynamics) - 2
    members = [Member(f"a{l}", d, l >= normal) for l, d in enumerate(dynamics)]
    return compose(members, SPHERES if isinstance(function, Oval) else AROUND, function, RHO)
