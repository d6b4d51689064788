"""The moving picture of a result: one HTML file with everything in it, that asks nothing of any network.

``shapes``, ``meshes``, ``mesh_files`` and ``sticks``: solids of the bodies. ``tracks``: their motion. ``overlays``:
paths, arrows and springs. ``framing``: the camera. ``page`` puts them together; ``chromium`` takes ``pictures`` of it.
"""
