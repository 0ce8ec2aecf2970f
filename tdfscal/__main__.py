"""`python -m tdfscal`."""

from tdfscal.cli import main

main()
