"""Fields whose types are imported when a file has them: as strict as the others, and not paid for by other files."""

import subprocess
import sys

import pytest

from pinarm.errors import InputError
from pinarm.input.yaml.document import Document
from pinarm.mechanics.description import MechanismDescription

TYPED = "pinarm: 1\nrobot: arm.urdf\nforces:\n  spring: {kind: joint_spring, joint: A, stiffness: 2 N*m/rad}\n"


@pytest.mark.parametrize(
    ("right", "wrong"), [("stiffness", "stifness"), ("joint_spring", "sprng"), ("2 N*m/rad", "two")]
)
def test_its_mistakes_have_their_place(right: str, wrong: str):
    with pytest.raises(InputError) as error:
        Document.parse(TYPED.replace(right, wrong)).validate(MechanismDescription)
    assert error.value.location is not None
    assert error.value.location.line == 4


def test_a_plain_run_imports_no_kinds_that_it_does_not_use():
    script = (
        "import sys, pinarm; pinarm.run('scenarios/gen411_arm_static.yaml');"
        "print(*[name for name in sys.modules if name.startswith('pinarm.mechanics.') and name.split('.')[2] in "
        "('friction', 'planar') or name.endswith(('forces.kinds', 'loops.kinds', 'couplings.kinds', 'control.kinds')) "
        "or '.assessments.' in name "
        "or name in ('dataclasses', 'numpy.typing')])"
    )
    printed = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout
    assert printed.split() == []
