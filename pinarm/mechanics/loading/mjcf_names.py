"""Elements and attributes of MJCF: those of MuJoCo 4.0.0 (``mj_printSchema``), and older ones that it dropped."""

from __future__ import annotations

from pinarm.input.xml_names import Content, ElementNames, names

ORIENTED = "pos quat axisangle xyaxes zaxis euler"
SOLVED = "solimp solref"

JOINT = (
    "type pos axis range limited actuatorfrcrange actuatorfrclimited ref springref stiffness damping springdamper "
    "armature frictionloss group user margin solreflimit solimplimit solreffriction solimpfriction"
)
GEOM = (
    f"{ORIENTED} {SOLVED} type size mass density fromto group mesh shellinertia contype conaffinity condim priority "
    "friction solmix margin gap fitscale rgba user hfield material fluidshape fluidcoef adhesion castshadow surfacevel"
)
SITE = f"{ORIENTED} type group size material mesh fromto rgba user"
EQUALITY = f"active {SOLVED}"
ACTUATOR = (
    "armature damping gear group user cranklength ctrllimited ctrlrange forcelimited forcerange actlimited actrange "
    "actearly actdim delay interp nsample input ffrange velrange posrange inheritrange dyntype gaintype biastype "
    "dynprm gainprm biasprm kp kv ki imax slewmax dampratio timeconst tausmooth area diameter bias range force scale "
    "lmin lmax vmax fpmax fvmax gain cogging controller inductance lugre motorconst nominal resistance saturation "
    "thermal"
)
"""Attributes of all kinds of actuators together: of these armature, damping and gear are read."""
TRANSMISSION = (
    "name class joint jointinparent site refsite body tendon cranksite slidersite lengthrange plugin instance"
)

ACTUATORS = (
    "general", "motor", "position", "velocity", "intvelocity", "orientation", "pid", "damper", "cylinder", "muscle",
    "adhesion", "dcmotor", "plugin",
)  # fmt: skip
"""Kinds of actuators, with a class's attributes in common."""
GENERATED = ("replicate", "attach", "composite", "flexcomp", "flex", "plugin")
"""Elements from which MuJoCo generates bodies."""

_IN_GEOM: dict[str, ElementNames | Content] = {"plugin": Content.IDLE}
_IN_BODY: dict[str, ElementNames | Content] = {
    "inertial": names(f"{ORIENTED} mass diaginertia fullinertia"),
    "joint": names(f"name class {JOINT}", unread="actuatorgravcomp springyield"),
    "freejoint": names("name group align"),
    "geom": names(f"name class {GEOM}", _IN_GEOM),
    "site": names(f"name class {SITE}"),
    "camera": Content.IDLE,
    "light": Content.IDLE,
    **dict.fromkeys(GENERATED, Content.IDLE),  # refused by the reader
}
_IN_BODY["frame"] = names(f"{ORIENTED} name childclass", _IN_BODY)
_IN_BODY["body"] = names(f"{ORIENTED} name childclass mocap gravcomp user sleep simple fuse", _IN_BODY)

_IN_DEFAULT: dict[str, ElementNames | Content] = {
    "joint": names(JOINT, unread="actuatorgravcomp springyield"),
    "geom": names(GEOM),
    "site": names(SITE),
    "equality": names(EQUALITY),
    **{kind: names(ACTUATOR) for kind in ACTUATORS},
    **dict.fromkeys(("mesh", "material", "texture", "camera", "light", "pair", "tendon"), Content.IDLE),
}
_IN_DEFAULT["default"] = names("class", _IN_DEFAULT)

_SETTINGS: dict[str, ElementNames | Content] = {
    "compiler": names(
        "angle autolimits eulerseq coordinate inertiafromgeom inertiagrouprange boundmass boundinertia settotalmass "
        "fusestatic strippath meshdir texturedir assetdir discardvisual usethread fitaabb alignfree saveinertial "
        "conflict passthrough savecanonical savecompiled convexhull exactmeshinertia balanceinertia",
        {"lengthrange": Content.IDLE},
    ),
    "option": names(
        "gravity density viscosity wind magnetic timestep apirate impratio tolerance ls_tolerance noslip_tolerance "
        "ccd_tolerance mpr_tolerance sleep_tolerance o_margin o_solref o_solimp o_friction integrator collision cone "
        "jacobian solver iterations ls_iterations noslip_iterations ccd_iterations mpr_iterations sdf_iterations "
        "sdf_initpoints actuatorgroupdisable",
        {"flag": names(
            "gravity passive spring damper frictionloss constraint equality limit contact clampctrl warmstart "
            "filterparent actuation refsafe sensor midphase eulerdamp autoreset nativeccd island override energy "
            "fwdinv invdiscrete multiccd sensornoise diagexact ipc sleep speculative"
        )},
    ),
    "default": _IN_DEFAULT["default"],
}  # fmt: skip

_EQUALITIES = ("tendon", "flex", "flexvert", "flexstrain", "distance")
"""Equalities that are not read; they are refused by the reader unless they are inactive."""

MJCF = names(
    "model",
    {
        **_SETTINGS,
        "worldbody": names("name", _IN_BODY),
        "equality": names("", {
            "joint": names(f"name class joint1 joint2 polycoef {EQUALITY}"),
            "connect": names(f"name class body1 body2 site1 site2 anchor {EQUALITY}"),
            "weld": names(f"name class body1 body2 site1 site2 anchor relpose torquescale {EQUALITY}"),
            **dict.fromkeys(_EQUALITIES, Content.IDLE),
        }),
        "actuator": names("", {kind: names(f"{TRANSMISSION} {ACTUATOR}", {"config": Content.IDLE})
                               for kind in ACTUATORS}),
        **dict.fromkeys(("asset", "visual", "statistic", "size", "custom"), Content.IDLE),
        **dict.fromkeys(("tendon", "keyframe", "extension", "deformable"), Content.IDLE),  # the reader refuses or notes
        **dict.fromkeys(("contact", "sensor"), Content.UNREAD),
    },
)  # fmt: skip
"""Names of a ``<mujoco>`` element."""
