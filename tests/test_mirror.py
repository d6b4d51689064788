"""Whoever edits a module finds its test by name: at the same place below ``tests``, or in the table here."""

from pathlib import Path

import pinarm

PACKAGE = Path(pinarm.__file__).parent
TESTS = Path(__file__).parent

ELSEWHERE = {
    "loops/test_cams.py": (
        "cams in machines", "mechanics/couplings/cam mechanics/couplings/cams/cam_coupling mechanics/friction/cam "
        "engine/motion/segmented/separations",
    ),
    "loops/test_cables.py": (
        "cables in machines", "mechanics/loops/cable mechanics/forces/cable mechanics/paths",
    ),
    "engine/motion/segmented/test_stop_shares.py": (
        "several stops at one instant", "engine/motion/segmented/impact_remarks",
    ),
    "cli/test_main.py": ("what commands print and write", "cli/options use/scenario/file_kind "
        "use/study/run"),
    "engine/control/test_controls.py": (
        "controllers against closed forms", "engine/control/efforts engine/control/memory engine/control/sampler "
        "engine/control/schedule engine/control/controlled_system mechanics/control/pid mechanics/control/switching "
        "mechanics/control/definition mechanics/control/controller mechanics/control/kinds mechanics/control/signals",
    ),
    "engine/control/test_controlled_mechanisms.py": (
        "controllers on mechanisms", "engine/motion/segmented/controlled_motion mechanics/control/computed_torque "
        "mechanics/control/fresh_function mechanics/control/function mechanics/control/references "
        "mechanics/control/state_feedback problems/actuation/controls",
    ),
    "engine/motion/systems/test_coupled.py": ("the same motions", "engine/motion/systems/compiled/compiled_couplings"),
    "mechanics/test_rotors.py": ("rotors of drives", "engine/drive_parts"),
    "mechanics/friction/test_gear_loss.py": ("as of runs", "problems/actuation/gear_losses"),
    "mechanics/test_motors.py": (
        "motors behind controllers", "mechanics/control/motor_control engine/control/motor_limits",
    ),
    "engine/dynamics/test_coordinate_partition.py": (
        "reduced coordinates against multipliers", "engine/motion/systems/free engine/motion/systems/partitioned "
        "engine/motion/systems/system",
    ),
    "engine/dynamics/test_equation.py": (
        "routes to one acceleration", "mechanics/geometry/buffers",
    ),
    "engine/constraints/nullspaces/test_sparse_rows.py": (
        "the same numbers", "engine/constraints/nullspaces/sparse_nullspace",
    ),
    "engine/constraints/nullspaces/test_nullspace.py": (
        "of few joints", "engine/constraints/nullspaces/dense_nullspace",
    ),
    "engine/friction/test_switching.py": (
        "what joints at rest begin to do", "engine/friction/balance engine/friction/response engine/friction/slip",
    ),
    "engine/integration/methods/test_orders.py": (
        "the order of every method", "engine/integration/integrator "
        "engine/integration/methods/explicit",
    ),
    "engine/kernel/test_library.py": ("its structures", "engine/kernel/structures"),
    "engine/kernel/test_tree.py": ("what is refused", "engine/kernel/checks"),
    "engine/kinematics/redundancy/test_nearest_motion.py": (
        "nearest to a posture on a path", "engine/kinematics/redundancy/limited_path "
        "engine/kinematics/redundancy/nearest "
        "engine/kinematics/redundancy/nearest_start engine/kinematics/redundancy/posture",
    ),
    "mechanics/loading/sdf/test_reader.py": (
        "SDF models", "mechanics/loading/sdf/names mechanics/loading/sdf/poses "
        "mechanics/loading/sdf/spanning_tree",
    ),
    "problems/actuation/test_effort_sharing.py": ("weights of drives", "problems/weights"),
    "engine/kinematics/test_newton.py": (
        "positions that laws ask for", "engine/kinematics/continuation engine/kinematics/joint_motion "
        "engine/kinematics/prescribed",
    ),
    "engine/motion/segmented/test_end_stops.py": (
        "impacts", "engine/motion/segmented/hybrid_motion engine/motion/segmented/hybrid_system "
        "engine/motion/segmented/segment_ends engine/motion/segmented/transitions problems/events",
    ),
    "engine/motion/test_trajectory.py": (
        "rows of a motion", "engine/motion/integrated_motion engine/motion/outcome engine/motion/prescribed_motion "
    ),
    "engine/quantities/test_names.py": (
        "quantities asked by name", "engine/quantities/ball_quantities engine/quantities/evaluation "
        "engine/quantities/family engine/quantities/row_kinematics engine/quantities/families/coordinate "
        "engine/quantities/families/drive engine/quantities/families/energy engine/quantities/families/force "
        "engine/quantities/families/joint engine/quantities/families/link engine/quantities/families/momentum "
        "engine/quantities/families/power engine/quantities/families/subtree",
    ),
    "engine/quantities/test_catalogue.py": ("as of the command", "use/study/quantities"),
    "engine/quantities/test_reactions.py": (
        "components of what joints transmit", "engine/quantities/transmitted engine/quantities/families/coupling "
        "engine/quantities/families/loop",
    ),
    "engine/test_mechanism.py": ("loading", "engine/mechanism_parts engine/model_source"),
    "hostile/test_model_attacks.py": ("its bounds", "input/xml_text"),
    "input/formulas/test_expressions.py": ("what formulas mean", "input/formulas/dimensions input/formulas/grammar"),
    "input/xacro/test_expansion.py": (
        "files as xacro expands them", "input/xacro/expander input/xacro/sandboxed_xacro",
    ),
    "input/xacro/test_templates.py": (
        "expressions as xacro computes them", "input/xacro/arithmetic input/xacro/expression_tape",
    ),
    "input/yaml/test_document.py": ("what YAML means", "input/yaml/parser"),
    "input/yaml/test_schema.py": ("keys of the file", "mechanics/description"),
    "loops/test_compiled.py": (
        "compiled loops against Python", "engine/kernel/loops engine/kernel/ways "
        "engine/motion/systems/compiled/compiled_loops "
        "engine/motion/systems/compiled/compiled_points engine/motion/systems/compiled/compiled_rows",
    ),
    "loops/test_in_time.py": (
        "loops in motion, against multipliers", "engine/dynamics/pinocchio_constraints "
        "engine/motion/systems/constrained engine/motion/systems/point_constrained "
        "engine/motion/systems/point_motion engine/motion/systems/row_motion",
    ),
    "loops/test_kinds.py": (
        "every kind against Newton and Euler", "engine/constraints/constraint mechanics/loops/kinds "
        "mechanics/loops/loop_joints mechanics/loops/lower_pairs mechanics/loops/pair mechanics/loops/rod "
        "mechanics/loops/universal",
    ),
    "loops/test_many_rows.py": (
        "many rows against each alone", "engine/constraints/batch_jacobians engine/constraints/row_measures "
        "engine/constraints/multipliers",
    ),
    "loops/test_redundancy.py": (
        "degrees of hyperstatism and singular positions", "engine/kinematics/mobility",
    ),
    "loops/test_loop_coordinates.py": (
        "as of joints of the tree", "mechanics/forces/along_coordinate mechanics/loops/relative",
    ),
    "loops/test_rounded_files.py": ("loops that close as far as their file is rounded", "engine/checks/unclosed"),
    "loops/test_screws.py": ("against the coupling and closed forms", "mechanics/loops/screw"),
    "mechanics/friction/test_bearing.py": ("what a law multiplies", "mechanics/friction/law"),
    "mechanics/friction/test_definition.py": ("slips of bound joints", "mechanics/friction/contact "
        "mechanics/friction/coupling_contact"),
    "mechanics/couplings/test_gear.py": (
        "wheels in mesh", "mechanics/couplings/members mechanics/couplings/teeth",
    ),
    "mechanics/couplings/test_transmissions.py": ("wrenches of every kind", "mechanics/couplings/kinds"),
    "mechanics/forces/test_force_element.py": ("every kind of element", "mechanics/forces/kinds"),
    "mechanics/forces/test_bushing.py": ("its measure of deflection", "mechanics/geometry/deflection"),
    "mechanics/laws/test_interpolated.py": ("laws that are tables", "input/motion_tables"),
    "mechanics/laws/test_motion_law.py": ("every law", "mechanics/laws/steady"),
    "mechanics/loading/test_mjcf.py": (
        "files as MuJoCo reads them", "input/mjcf_includes mechanics/loading/mjcf_actuators "
        "mechanics/loading/mjcf_geoms mechanics/loading/mjcf_joints mechanics/loading/mjcf_names "
        "mechanics/loading/mjcf_settings",
    ),
    "mechanics/loading/urdf/test_writer.py": ("of models with points", "mechanics/points"),
    "mechanics/loading/sdf/test_joints.py": ("joints of SDF", "mechanics/loading/sdf/gearboxes"),
    "mechanics/loading/urdf/test_reader.py": ("what files make of it", "mechanics/loading/urdf/elements"),
    "mechanics/planar/test_linkage.py": ("mistakes with their lines", "mechanics/planar/drawing"),
    "mechanics/test_coordinates.py": ("joints by their coordinates", "mechanics/joints"),
    "engine/statics/test_shared_efforts.py": ("efforts of one row", "engine/statics/effort_distribution"),
    "mechanics/test_drives.py": ("efforts of drives", "engine/statics/actuation engine/statics/selected_drives"),
    "problems/simplify/test_simplification.py": (
        "answers of the part against the whole", "problems/simplify/model_reduction problems/simplify/removal "
        "problems/simplify/requested_joints",
    ),
    "problems/test_equilibria.py": (
        "equilibria in closed form", "engine/statics/equilibrium",
    ),
    "problems/test_loads_and_partial_results.py": (
        "loads in every kind of problem", "problems/accuracy problems/forward problems/inverse problems/loads "
        "problems/states problems/time_grid",
    ),
    "problems/recording/test_recorded.py": (
        "rows in files and arrays",
        "problems/recording/recorded_columns use/scenario/recorded",
    ),
    "problems/test_profiles.py": (
        "laws in problems", "mechanics/forces/breakpoints problems/prescription/prescribed_laws"),
    "test_messages.py": (
        "mistakes in files", "input/yaml/validation_messages problems/joint_values use/result/failures "
        "use/scenario/scenario_file use/scenario/misplaced_keys",
    ),
    "physics/test_friction.py": (
        "friction in every kind of problem", "engine/friction/given_efforts "
        "engine/friction/sliding engine/motion/known_friction engine/motion/segmented/stick_slip "
        "engine/quantities/friction_law "
        "mechanics/friction/thread",
    ),
    "physics/test_shared_friction.py": ("what joints at rest share", "engine/motion/systems/frictional"),
    "use/assessments/loads/test_loads.py": (
        "joints as they are asked", "use/assessments/loads/joint use/assessments/loads/number",
    ),
    "use/assessments/sensitivity/test_sensitivity.py": (
        "numbers of mechanisms in closed form",
        "use/assessments/sensitivity/tables use/assessments/sensitivity/variation",
    ),
    "use/assessments/sizing/test_sizing.py": (
        "motors for a joint in closed form", "use/assessments/sizing/catalogue use/assessments/sizing/duty",
    ),
    "use/assessments/test_limits.py": (
        "numbers, their errors and bounds", "use/result/condition use/result/number_accuracy use/result/output_scales",
    ),
    "use/assessments/test_path_error.py": ("points in lists and files", "use/assessments/wanted_points"),
    "use/assessments/test_shaking.py": ("sections as they are told and saved", "use/result/section"),
    "use/report/test_report.py": ("its parts", "use/report/chapter use/report/tables"),
    "use/result/test_result.py": ("methods of a result", "use/result/measures use/views"),
    "use/scenario/test_find.py": ("values that are found", "use/scenario/searches"),
    "use/scenario/test_roots.py": ("numbers of any size", "use/scenario/differences"),
    "use/scenario/test_optimum.py": (
        "optima of functions and of runs", "use/scenario/landscape use/scenario/optimum_section",
    ),
    "use/show/test_sketch.py": ("what drawings show", "use/show/scene"),
    "use/show/replay/test_browser.py": ("the page in it", "use/show/replay/chromium"),
    "use/output/test_folder.py": ("which files are ours", "use/output/manifest"),
    "use/store/test_new.py": ("what is written for a model", "use/store/first_files"),
    "use/study/accuracy/test_error_estimate.py": (
        "errors that are found", "engine/checks/residuals use/study/accuracy/common_rows "
        "use/study/accuracy/integration_settings "
        "use/study/accuracy/solved",
    ),
    "use/study/accuracy/test_tradeoff.py": (
        "parts of a study", "use/study/accuracy/setting_errors use/study/accuracy/tradeoff_plot "
        "use/study/accuracy/timed_solutions use/study/accuracy/tradeoff_text use/study/accuracy/variant_errors",
    ),
    "use/study/answers/test_check.py": ("verdicts", "use/result/expectation use/study/answers/verdict_table"),
    "use/study/batch/test_batch.py": (
        "motions together against each alone", "engine/integration/batch_driver engine/integration/batch_solution "
        "engine/motion/segmented/ensembles problems/batch_table use/study/batch/batch_files use/study/batch/block "
        "use/study/batch/initial_states use/study/batch/reduced_table use/study/batch/worker_blocks",
    ),
    "use/study/sweep/test_axes.py": ("values as they are written", "use/study/sweep/value_syntax"),
    "use/cases/test_stack.py": ("cases of all kinds against each alone", "use/cases/prescribed_cases"),
    "use/cases/test_case.py": ("one case", "use/result/run_number use/study/sweep/case_solver"),
}  # fmt: skip
"""Test file -> why it is the one, and the modules without a test file of their name that it tests."""

TESTED = {module: file for file, (_, modules) in ELSEWHERE.items() for module in modules.split()}

MODULES = sorted(
    file.relative_to(PACKAGE).with_suffix("").as_posix()
    for file in PACKAGE.rglob("*.py") if not file.stem.startswith("__")
)  # fmt: skip


def mirrored(module: str) -> Path:
    """Return where the test of a module belongs."""
    path = Path(module)
    return TESTS / path.parent / f"test_{path.name}.py"


def test_every_module_has_its_test() -> None:
    for module in MODULES:
        own = mirrored(module)
        assert own.is_file() or module in TESTED, (
            f"write {own.relative_to(TESTS.parent)}, "
            f"or name pinarm/{module}.py in ELSEWHERE beside the file that tests it"
        )


def test_the_table_is_true() -> None:
    assert not [file for file in ELSEWHERE if not (TESTS / file).is_file()], "there are no such files"
    assert not sorted(TESTED.keys() - set(MODULES)), "there are no such modules: remove them from ELSEWHERE"
    assert not [module for module in TESTED if mirrored(module).is_file()], (
        "these have a test file of their name: remove them from ELSEWHERE"
    )
    assert len(TESTED) == sum(len(modules.split()) for _, modules in ELSEWHERE.values()), "a module stands there twice"


def test_every_test_file_tests_something() -> None:
    files = sorted(TESTS.rglob("test_*.py"))
    assert [str(file) for file in files if "def test_" not in file.read_text(encoding="utf-8")] == []
