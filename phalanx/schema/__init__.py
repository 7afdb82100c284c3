"""Parts of a scenario's tables: validated fields, and classes by name."""
