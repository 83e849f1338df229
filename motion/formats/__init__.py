"""Motion file formats, one module a format."""
