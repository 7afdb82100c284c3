"""Tests: unit (no process, no socket), process (real runs), containers (a whole stack)."""
