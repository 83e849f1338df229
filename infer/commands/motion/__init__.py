"""Commands on motion: editing it, and putting it onto characters."""
