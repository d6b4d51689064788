"""The global error of a result, the setting that reaches a target, and what accuracy costs."""
