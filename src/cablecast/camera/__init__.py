"""Camera description: its lens, the tags on the table before it, and its section of a lab file."""
