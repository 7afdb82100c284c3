"""Sources of a page's data: a live run, or a recording that is replayed."""
