"""Planar mechanisms as a designer draws them: points of a drawing, links that carry them, pins and slides."""
