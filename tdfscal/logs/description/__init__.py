"""What is in a log: contents, a mapping guessed for a file never seen before, its YAML."""
