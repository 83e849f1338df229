"""The command line: one function per command, parsed by tyro."""
