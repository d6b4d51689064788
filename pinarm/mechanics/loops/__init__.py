"""Joints that close loops: between two links that the tree has already joined another way, one family a module."""
