"""The moving picture of a result: one HTML file with everything in it, that asks nothing of any network.

``shapes``, ``meshes``, ``collada`` and ``sticks`` say what is drawn, ``tracks`` how it moves, ``overlays`` what is
drawn over it, ``framing`` from where it is seen; ``page`` puts them together; ``pictures`` are taken by ``chromium``.
"""
