"""What a question does not require of a mechanism is locked or dropped, and the answer put back into the whole."""
