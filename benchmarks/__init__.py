"""Long statistics; each script prints the Markdown table beside it."""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
