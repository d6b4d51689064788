"""Time integration of ``q' = velocity(q, v)``, ``v' = acceleration(t, q, v)``; no module in here knows mechanisms."""
