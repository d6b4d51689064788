"""A mechanism with a joint that turns and one that slides, for force elements."""

import pytest

from pinarm.mechanics.joints import joints_of
from pinarm.mechanics.loading.pinocchio_model import build_model


@pytest.fixture
def model(chain):
    """A turning link with a sliding one on it, both off the axis, and a post that stands still beside them."""
    bodies = ({"name": "turn", "at": "0.2 -0.1 0.3", "axis": "0.6 0 0.8"},
              {"name": "slide", "kind": "prismatic", "axis": "1 0 0", "at": "1.4 0.3 0.2"})  # fmt: skip
    post = (
        '<link name="post"/><joint name="foot" type="fixed"><parent link="base"/><child link="post"/>'
        '<origin xyz="0.5 1.5 -0.4" rpy="0.3 -0.7 1.1"/></joint></robot>'
    )
    return build_model(chain(*bodies).replace("</robot>", post)).model


@pytest.fixture
def joints(model):
    return joints_of(model)
