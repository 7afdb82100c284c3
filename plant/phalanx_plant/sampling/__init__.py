"""Who samples when, what each is shown, and which broadcasts exist for it."""
