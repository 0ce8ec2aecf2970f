"""The studies in words, tables and figures: of each its report, document, tables and drawings."""
