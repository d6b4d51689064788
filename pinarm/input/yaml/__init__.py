"""YAML files: parsed without running anything, validated, and mistakes told with file, line and column."""
