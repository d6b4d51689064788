"""Small mechanisms in files of their own."""

import pytest


@pytest.fixture
def write(tmp_path):
    """Write a model, its mechanism file and a scenario; return the scenario's path."""
    (tmp_path / ".pinarm-root").touch()

    def write(urdf, mechanism, problem, outputs):
        (tmp_path / "model.urdf").write_text(f'<robot name="r"><link name="base"/>{urdf}</robot>')
        (tmp_path / "mechanism.yaml").write_text(f"pinarm: 1\nrobot: model.urdf\n{mechanism}")
        text = f"pinarm: 1\nmechanism: mechanism.yaml\nproblem: {problem}\noutputs: [{outputs}]\n"
        (tmp_path / "scenario.yaml").write_text(text)
        return tmp_path / "scenario.yaml"

    return write
