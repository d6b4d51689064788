"""Sizing a motor and its gear for the effort and motion of one joint."""
