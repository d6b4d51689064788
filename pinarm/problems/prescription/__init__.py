"""What a problem prescribes: laws of coordinates, and how joints follow them where there are fewer laws than joints."""
