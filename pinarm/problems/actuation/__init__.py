"""What drives do in a problem: under controllers, or where more of them share a load."""
