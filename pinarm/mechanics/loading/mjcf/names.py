"""Names of elements and attributes of MJCF: those of MuJoCo 4.0.0 (``mj_printSchema``), and older ones it dropped."""

from __future__ import annotations

from pinarm.input.xml_names import format_names

ACTUATORS = (
    "general", "motor", "position", "velocity", "intvelocity", "orientation", "pid", "damper", "cylinder", "muscle",
    "adhesion", "dcmotor", "plugin",
)  # fmt: skip
"""Kinds of actuators, with a class's attributes in common."""

GENERATED = ("replicate", "attach", "composite", "flexcomp", "flex", "plugin")
"""Elements from which MuJoCo generates bodies."""

ORIENTED = "pos quat axisangle xyaxes zaxis euler"
EQUALITY = "name class active solimp solref"
DRIVES = " ".join(f"{kind}=drive*" for kind in ACTUATORS)
IN_BODY = (
    "inertial* joint* freejoint* geom* site* frame* body* camera- light- "
    + " ".join(f"{tag}-" for tag in GENERATED)  # refused by the reader
)

MJCF = format_names({
    "mujoco": "model > compiler* option* default* worldbody* equality* actuator* asset- visual- statistic- size- "
              "custom- tendon- keyframe- extension- deformable-",
    "compiler":
        "angle autolimits eulerseq coordinate inertiafromgeom inertiagrouprange boundmass boundinertia settotalmass "
        "fusestatic strippath meshdir texturedir assetdir discardvisual usethread fitaabb alignfree saveinertial "
        "conflict passthrough savecanonical savecompiled convexhull exactmeshinertia balanceinertia > lengthrange-",
    "option":
        "gravity density viscosity wind magnetic timestep apirate impratio tolerance ls_tolerance noslip_tolerance "
        "ccd_tolerance mpr_tolerance sleep_tolerance o_margin o_solref o_solimp o_friction integrator collision cone "
        "jacobian solver iterations ls_iterations noslip_iterations ccd_iterations mpr_iterations sdf_iterations "
        "sdf_initpoints actuatorgroupdisable > flag*",
    "flag":
        "gravity passive spring damper frictionloss constraint equality limit contact clampctrl warmstart filterparent "
        "actuation refsafe sensor midphase eulerdamp autoreset nativeccd island override energy fwdinv invdiscrete "
        "multiccd sensornoise diagexact ipc sleep speculative",
    "default": f"class > default* joint* geom* site* equality=constraint* {DRIVES} mesh- material- texture- camera- "
               "light- pair- tendon-",
    "worldbody": f"name > {IN_BODY}",
    "body": f"{ORIENTED} name childclass mocap gravcomp user sleep simple fuse > {IN_BODY}",
    "frame": f"{ORIENTED} name childclass > {IN_BODY}",
    "inertial": f"{ORIENTED} mass diaginertia fullinertia",
    "joint":
        "name class type pos axis range limited actuatorfrcrange actuatorfrclimited ref springref stiffness damping "
        "springdamper armature frictionloss group user margin solreflimit solimplimit solreffriction solimpfriction",
    "freejoint": "name group align",
    "geom":
        f"{ORIENTED} name class type size mass density fromto group mesh shellinertia contype conaffinity condim "
        "priority friction solmix margin gap fitscale rgba user hfield material fluidshape fluidcoef adhesion "
        "castshadow surfacevel solimp solref > plugin-",
    "site": f"{ORIENTED} name class type group size material mesh fromto rgba user",
    "equality": "> joint=coupled* connect=tie* weld=tie* tendon- flex- flexvert- flexstrain- distance-",
    "constraint": EQUALITY,
    "coupled": f"{EQUALITY} joint1 joint2 polycoef",
    "tie": f"{EQUALITY} body1 body2 site1 site2 anchor relpose torquescale",
    "actuator": f"> {DRIVES}",
    "drive":
        "name class joint jointinparent site refsite body tendon cranksite slidersite lengthrange plugin instance "
        "armature damping gear group user cranklength ctrllimited ctrlrange forcelimited forcerange actlimited "
        "actrange actearly actdim delay interp nsample input ffrange velrange posrange inheritrange dyntype gaintype "
        "biastype dynprm gainprm biasprm kp kv ki imax slewmax dampratio timeconst tausmooth area diameter bias range "
        "force scale lmin lmax vmax fpmax fvmax gain cogging controller inductance lugre motorconst nominal "
        "resistance saturation thermal > config-",
})  # fmt: skip
"""Names that are read, or have no part in the computation. Of actuators armature, damping and gear are read."""
