"""The pytest plugin: fixtures, a mark, and what a failure prints."""
