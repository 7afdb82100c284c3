"""Phalanx: adversarially resilient robot swarms as a real networked system.

Implements Usevitch & Panagou, *Adversarial Resilience for Sampled-Data Systems under
High-Relative-Degree Safety Constraints*. Safe is ``h <= 0`` throughout.
"""

__version__ = "0.1.0"
