"""Everything random: counter-based draws, each with a key of its own, and perturbed clocks."""
