"""`python -m muybridge`."""

from muybridge.infer.cli import main

if __name__ == "__main__":
    main()
