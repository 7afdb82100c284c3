"""A run as files to share: a page that plays by itself, a picture, tables, MCAP for other tools."""
