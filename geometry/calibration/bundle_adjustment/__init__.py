"""Bundle adjustment of cameras with points, boards or people."""
