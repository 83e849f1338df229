"""What motion capture is for: file formats and what is done with motion."""
