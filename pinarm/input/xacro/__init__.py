"""Xacro files, expanded without running code from them or reading files outside their root."""
