"""Whoever edits a module finds its test by name: at the same place below ``tests``, or in the table here."""

from pathlib import Path

import pytest

import pinarm

PACKAGE = Path(pinarm.__file__).parent
TESTS = Path(__file__).parent

ELSEWHERE = {
    # protocols, types and bare data: whatever meets them is tested
    "arrays": "engine/constraints/test_nullspace.py",
    "engine/constraints/constraint": "loops/test_kinds.py",
    "engine/integration/integrator": "engine/integration/methods/test_orders.py",
    "engine/motion/systems/system": "engine/dynamics/test_coordinate_partition.py",
    "mechanics/description": "input/yaml/test_schema.py",
    "mechanics/geometry/buffers": "engine/dynamics/test_equation.py",
    "mechanics/joints": "mechanics/test_coordinates.py",
    "use/scenario/json_schema": "cli/test_main.py",
    # one test runs over all members of a family
    "engine/integration/methods/collocation_window": "engine/integration/methods/test_collocation.py",
    "engine/integration/methods/conserving": "engine/integration/methods/test_orders.py",
    "engine/integration/methods/explicit": "engine/integration/methods/test_orders.py",
    "mechanics/laws/steady": "mechanics/laws/test_motion_law.py",
    "mechanics/loops/loop_joints": "loops/test_kinds.py",
    "mechanics/loops/pairs": "loops/test_kinds.py",
    # routes to one number, held against each other
    "engine/checks/residuals": "use/study/accuracy/test_error_estimate.py",
    "engine/checks/singularity": "loops/test_redundancy.py",
    "engine/constraints/batch_jacobians": "loops/test_many_rows.py",
    "engine/constraints/closure": "loops/test_many_rows.py",
    "engine/constraints/multipliers": "loops/test_many_rows.py",
    "engine/constraints/nullspace_batch": "loops/test_many_rows.py",
    "engine/dynamics/mass_matrix": "engine/dynamics/test_equation.py",
    "engine/dynamics/pinocchio_constraints": "loops/test_in_time.py",
    "engine/kinematics/continuation_batch": "loops/test_many_rows.py",
    "engine/motion/systems/batch_rows": "loops/test_many_rows.py",
    "engine/motion/systems/constrained": "loops/test_in_time.py",
    "engine/motion/systems/free": "engine/dynamics/test_coordinate_partition.py",
    "engine/motion/systems/partitioned": "engine/dynamics/test_coordinate_partition.py",
    "engine/motion/systems/point_constrained": "loops/test_in_time.py",
    "engine/motion/systems/row_motion": "loops/test_in_time.py",
    # steps of one computation, tested where it is asked for
    "engine/integration/batch_driver": "use/study/batch/test_batch.py",
    "engine/integration/batch_solution": "use/study/batch/test_batch.py",
    "engine/kinematics/continuation": "engine/kinematics/test_newton.py",
    "engine/kinematics/joint_motion": "engine/kinematics/test_newton.py",
    "engine/kinematics/mobility": "loops/test_redundancy.py",
    "engine/kinematics/prescribed": "engine/kinematics/test_newton.py",
    "engine/model_source": "engine/test_mechanism.py",
    "engine/motion/hybrid_motion": "engine/motion/test_end_stops.py",
    "engine/motion/segments": "engine/motion/test_trajectory.py",
    "engine/quantities/ball_quantities": "engine/quantities/test_names.py",
    "engine/quantities/row_kinematics": "engine/quantities/test_names.py",
    "engine/statics/actuation": "mechanics/test_drives.py",
    "engine/statics/equilibrium": "problems/test_equilibria.py",
    "engine/statics/selected_drives": "mechanics/test_drives.py",
    "engine/statics/stiffness": "problems/test_equilibria.py",
    "input/formulas/dimensions": "input/formulas/test_expressions.py",
    "input/formulas/grammar": "input/formulas/test_expressions.py",
    "input/mjcf_includes": "mechanics/loading/test_mjcf.py",
    "input/motion_tables": "mechanics/laws/test_interpolated.py",
    "input/xacro/arithmetic": "input/xacro/test_templates.py",
    "input/xacro/expander": "input/xacro/test_expansion.py",
    "input/xacro/expression_tape": "input/xacro/test_templates.py",
    "input/xacro/sandboxed_xacro": "input/xacro/test_expansion.py",
    "input/xml_text": "hostile/test_model_attacks.py",
    "input/yaml/parser": "input/yaml/test_document.py",
    "input/yaml/validation_messages": "test_messages.py",
    "mechanics/forces/breakpoints": "problems/test_profiles.py",
    "mechanics/loading/mjcf_geoms": "mechanics/loading/test_mjcf.py",
    "mechanics/loading/mjcf_joints": "mechanics/loading/test_mjcf.py",
    "mechanics/loading/mjcf_settings": "mechanics/loading/test_mjcf.py",
    "mechanics/loading/model_tree": "mechanics/loading/test_urdf.py",
    "problems/batch_table": "use/study/batch/test_batch.py",
    "problems/events": "engine/motion/test_end_stops.py",
    "problems/forward": "problems/test_loads_and_partial_results.py",
    "problems/inverse": "problems/test_loads_and_partial_results.py",
    "problems/simplify/model_reduction": "problems/simplify/test_simplified.py",
    "problems/simplify/removal": "problems/simplify/test_simplified.py",
    "problems/simplify/requested_joints": "problems/simplify/test_simplified.py",
    "problems/states": "problems/test_loads_and_partial_results.py",
    "use/result/expectation": "use/study/answers/test_check.py",
    "use/result/integration_settings": "use/study/accuracy/test_tradeoff.py",
    "use/scenario/scenario": "test_messages.py",
    "use/show/replay/chromium": "use/show/replay/test_browser.py",
    "use/study/accuracy/setting_errors": "use/study/accuracy/test_tradeoff.py",
    "use/study/accuracy/variant_errors": "use/study/accuracy/test_tradeoff.py",
    "use/study/batch/block": "use/study/batch/test_batch.py",
    "use/study/batch/initial_states": "use/study/batch/test_batch.py",
    "use/study/batch/reduced_table": "use/study/batch/test_batch.py",
    "use/study/batch/worker_blocks": "use/study/batch/test_batch.py",
    "use/study/sweep/case_solver": "use/study/sweep/test_cases.py",
    "use/study/sweep/journal": "use/study/sweep/test_sweep.py",
    "use/study/sweep/value_syntax": "use/study/sweep/test_axes.py",
    # what is printed and written, by commands
    "cli/options": "cli/test_main.py",
    "use/show/terminal": "test_readme.py",
    "use/study/accuracy/tradeoff_plot": "use/study/accuracy/test_tradeoff.py",
    "use/study/accuracy/tradeoff_text": "use/study/accuracy/test_tradeoff.py",
    "use/study/answers/verdict_table": "use/study/answers/test_check.py",
    "use/study/batch/batch_files": "use/study/batch/test_batch.py",
    "use/study/explain": "problems/simplify/test_simplified.py",
    "use/study/run": "cli/test_main.py",
}
"""Module without a test file of its name -> the file that tests it, by reason."""

MODULES = sorted(
    file.relative_to(PACKAGE).with_suffix("").as_posix()
    for file in PACKAGE.rglob("*.py") if not file.stem.startswith("__")
)  # fmt: skip


def mirrored(module: str) -> Path:
    """Return where the test of a module belongs."""
    path = Path(module)
    return TESTS / path.parent / f"test_{path.name}.py"


@pytest.mark.parametrize("module", MODULES)
def test_a_module_has_its_test(module: str) -> None:
    found = mirrored(module).is_file() or (TESTS / ELSEWHERE.get(module, "nowhere")).is_file()
    own = mirrored(module).relative_to(TESTS.parent)
    assert found, f"write {own}, or name in ELSEWHERE the file that tests pinarm/{module}.py"


def test_the_table_has_no_other_modules() -> None:
    unknown = sorted(set(ELSEWHERE) - set(MODULES))
    assert not unknown, "remove them from ELSEWHERE"
    both = sorted(module for module in ELSEWHERE if mirrored(module).is_file())
    assert not both, "these have a test of their name: remove them from ELSEWHERE"


FILES = sorted(file.relative_to(TESTS).as_posix() for file in TESTS.rglob("test_*.py"))


@pytest.mark.parametrize("file", FILES)
def test_a_test_file_tests_something(file: str) -> None:
    assert "def test_" in (TESTS / file).read_text(encoding="utf-8")
