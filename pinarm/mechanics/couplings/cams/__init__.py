"""Cams: the relation of shaft and follower, and where they touch."""
