"""The moving picture of a result: one HTML file with everything in it, that asks nothing of any network."""
