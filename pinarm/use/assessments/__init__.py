"""Assessments: what is concluded from a run, each asked for by a key of the scenario and told as a section.

Each is imported when a scenario first asks for it.
"""

from __future__ import annotations

from pinarm.input.yaml.schema import Deferred

ASSESSMENTS: Deferred = {
    "shaking": ("pinarm.use.assessments.shaking", "Shaking"),
    "sizing": ("pinarm.use.assessments.sizing", "Sizing"),
    "loads": ("pinarm.use.assessments.loads", "Loads"),
    "path_error": ("pinarm.use.assessments.path_error", "PathError"),
    "limits": ("pinarm.use.assessments.limits", "Limits"),
    "response": ("pinarm.use.assessments.response", "Response"),
    "sensitivity": ("pinarm.use.assessments.sensitivity", "Sensitivity"),
}
"""Key of a scenario -> module and class. A new one is a class, an entry here, and the key in ``ScenarioFile``."""


FILES = {"sizing": "catalogue", "path_error": "wanted"}
"""Assessment -> the key of it that may name a file, which a result folder keeps."""
