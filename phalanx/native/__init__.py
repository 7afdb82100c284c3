"""Machine code: C that is generated from expressions, and C that is written by hand.

There is one way to compile, cache, load and compare it, and one to call it. Hand-written C lies
next to its Python reference.
"""
