"""Configurations and motions nearest to a posture, where laws leave joints free."""
