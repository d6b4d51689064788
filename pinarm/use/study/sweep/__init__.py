"""One scenario solved many times, each time with other values."""
