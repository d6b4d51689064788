"""Dry friction that sticks: its laws, the bearings that carry loads, and the joints that it acts in."""
