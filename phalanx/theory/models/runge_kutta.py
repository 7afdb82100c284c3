"""Classical fourth-order Runge-Kutta steps as expressions."""

import casadi as ca


def weighted_rates(
    field: ca.Function, x: ca.SX, u: ca.SX, pushes: tuple[ca.SX, ca.SX, ca.SX], dt: ca.SX
) -> ca.SX:
    """Six times the mean rate of a step, shape (n,); pushes: φ at its begin, middle and end."""
    begin, middle, end = pushes
    k1 = field(x, u) + begin
    k2 = field(x + dt / 2 * k1, u) + middle
    k3 = field(x + dt / 2 * k2, u) + middle
    k4 = field(x + dt * k3, u) + end
    return k1 + 2 * k2 + 2 * k3 + k4
