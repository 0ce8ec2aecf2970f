"""`python -m tdfscal`."""

from tdfscal.cli import main

if __name__ == "__main__":
    main()
