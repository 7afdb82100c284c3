"""The scenario file: typed, validated, resolved."""
