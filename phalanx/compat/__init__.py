"""Workarounds for other libraries, one library a file, with the version and the state of the issue.

tests/unit/compat/test_workarounds.py fails for each that is no longer needed.
"""
