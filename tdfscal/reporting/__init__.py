"""Results as plain rows, then as text and pages."""
