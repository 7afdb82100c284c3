"""CasADi expressions: compiled to functions, and bounded over boxes."""
