"""YAML and JSON documents, read within stated limits."""
