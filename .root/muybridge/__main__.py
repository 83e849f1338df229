"""`python -m muybridge`."""

from muybridge.infer.commands.app import main

if __name__ == "__main__":
    main()
