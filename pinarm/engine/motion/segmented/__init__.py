"""Motions in segments: stops, openings of contacts, friction that sticks, controllers that act."""
