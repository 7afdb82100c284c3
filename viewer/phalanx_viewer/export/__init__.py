"""A run as files to share: a page that plays by itself, tables, MCAP for other tools."""
