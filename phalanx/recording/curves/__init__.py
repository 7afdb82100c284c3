"""Curves of a run: the arrays that the report's figures and the page's plots have in common."""
