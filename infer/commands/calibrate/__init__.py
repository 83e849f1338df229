"""`muybridge calibrate ...`: commands that make, check and convert calibrations."""
