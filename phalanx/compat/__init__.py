"""Workarounds of other libraries, one a file: which version, what upstream says, when it may go.

tests/unit/compat/test_workarounds.py fails for each that is no longer needed.
"""
