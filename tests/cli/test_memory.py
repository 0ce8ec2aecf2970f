"""Too little memory is said plainly, and never taken for a damaged file."""

import os
import subprocess
import sys


def test_linear_algebra_is_asked_for_one_thread_before_it_is_loaded() -> None:
    code = """
import os, sys
class Seen:
    def find_spec(self, name, *rest):
        if name == "numpy":
            print("numpy with", os.environ.get("OMP_NUM_THREADS"))
sys.meta_path.insert(0, Seen())
sys.argv = ["tdfscal", "calibrate", "--help"]
from tdfscal.cli import main
main()
"""
    free = {k: v for k, v in os.environ.items() if not k.endswith("_NUM_THREADS")}
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, check=True, env=free, text=True
    )
    assert "numpy with 1\n" in done.stdout
    assert "numpy with None" not in done.stdout
