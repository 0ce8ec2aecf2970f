"""Long statistics; each script prints the Markdown table beside it."""
