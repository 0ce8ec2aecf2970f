"""Point files: plain CSV, SpatialAnalyzer exports, Leica-style headers, JSON."""
