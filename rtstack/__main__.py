"""`python -m rtstack`: the command line."""

from rtstack.cli import main

if __name__ == "__main__":
    main()
