"""The method of mechanics courses: torsors, which bodies to isolate, by which theorem, and the graph of links."""
