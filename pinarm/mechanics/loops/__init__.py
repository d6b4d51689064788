"""Joints that close loops: what each kind holds, and how files name it."""
