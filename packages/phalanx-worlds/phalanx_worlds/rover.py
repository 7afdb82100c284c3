"""A wheeled robot with mass for MuJoCo: two driven wheels, a ball before and one behind them."""

from collections.abc import Sequence

WHEEL_RADIUS = 0.1
"""[m]"""
TRACK = 0.4
"""Distance between the wheels [m]."""
WHEELS = "left", "right"
_HULL = 'contype="2" conaffinity="2"'
"""Hulls meet hulls; wheels and balls meet the ground alone."""
_GROUNDED = 'contype="0" conaffinity="1"'
_WHEEL_MASS = 0.05
"""Of each wheel, as a share of the robot's mass."""


def swarm_model(names: Sequence[str], mass: float, friction: float, rolling: float) -> str:
    """Return MJCF of robots on a plane; a robot's parts are named after it: "left 1".

    mass: of each robot [kg]. friction: coefficient of the wheels on the ground; where more force is
    needed, they slip. rolling: resistance of each wheel [N m].
    """
    robots = "".join(_robot(k, name, mass, friction, rolling) for k, name in enumerate(names))
    return f"""<mujoco>
  <option integrator="implicitfast" cone="elliptic" impratio="10"/>
  <default>
    <geom solref="0.004 1" solimp="0.99 0.99 0.001"/>
    <default class="ball">
      <geom type="sphere" size="0.04" condim="1" priority="1" solref="0.02 1"
        solimp="0.5 0.5 0.001"/>
    </default>
  </default>
  <worldbody>
    <geom type="plane" size="0 0 1" condim="1" friction="0 0 0" contype="1" conaffinity="0"/>
    {robots}
  </worldbody>
</mujoco>"""


def _robot(k: int, name: str, mass: float, friction: float, rolling: float) -> str:
    """Return the body of a robot, its origin in the middle of the axle."""
    hull = mass * (1.0 - 2.0 * _WHEEL_MASS)
    wheels = "".join(
        f"""<body name="{wheel} {name}" pos="0 {side * TRACK / 2} 0">
      <joint name="{wheel} {name}" axis="0 1 0" frictionloss="{rolling}"/>
      <geom type="ellipsoid" size="{WHEEL_RADIUS} 0.02 {WHEEL_RADIUS}" {_GROUNDED}
        mass="{mass * _WHEEL_MASS}" condim="3" friction="{friction} 0 0"/>
    </body>"""
        for wheel, side in zip(WHEELS, (1, -1), strict=True)
    )
    balls = "".join(
        f'<geom class="ball" pos="{x} 0 {0.04 - WHEEL_RADIUS}" mass="0" {_GROUNDED}/>'
        for x in (0.2, -0.2)
    )
    return f"""<body name="{name}" pos="{k} 0 {WHEEL_RADIUS}">
    <freejoint name="{name}"/>
    <geom type="cylinder" size="0.25 0.04" pos="0 0 -0.02" mass="{hull}" {_HULL}/>
    {balls}{wheels}
  </body>"""
