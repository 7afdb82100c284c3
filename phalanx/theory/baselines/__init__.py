"""Controllers to compare with, by the short names that a scenario's `controller` may have."""
