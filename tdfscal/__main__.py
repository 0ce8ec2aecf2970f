"""`python -m tdfscal`."""

from tdfscal import _main

if __name__ == "__main__":
    _main()
