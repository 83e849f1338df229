"""Several files of motion made into one."""
