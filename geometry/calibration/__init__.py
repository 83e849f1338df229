"""Reading and writing of camera calibrations, one module a format."""
