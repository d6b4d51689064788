"""Names of elements and attributes of SDF.

Source: the specification of SDFormat, versions 1.4 to 1.12 (sdformat.org/spec).
"""

from __future__ import annotations

from pinarm.input.xml_names import format_names

SDF = format_names({
    "sdf": "version > model* world* light- actor-",
    "world": "name > model* gravity frame* audio- atmosphere- gui- physics- scene- light- spherical_coordinates- "
             "state- magnetic_field- population- road- wind-",
    "model": "name canonical_link placement_frame > pose static link* joint* frame* self_collide- allow_auto_disable-",
    "frame": "name attached_to > pose",
    "link": "name > pose inertial gravity visual- collision- self_collide- must_be_base_link- audio_source- "
            "audio_sink-",
    "pose": "relative_to frame degrees rotation_format",
    "inertial": "auto > mass pose inertia density- auto_inertia_params-",
    "inertia": "> ixx ixy ixz iyy iyz izz",
    "joint": "name type > pose parent child axis axis2=axis gearbox_ratio gearbox_reference_body thread_pitch "
             "screw_thread_pitch",
    "axis": "> xyz use_parent_model_frame limit dynamics mimic",
    "xyz": "expressed_in",
    "limit": "> lower upper effort velocity stiffness- dissipation-",
    "dynamics": "> damping friction spring_reference spring_stiffness",
    "mimic": "joint axis > multiplier offset reference",
})  # fmt: skip
"""Names that are read, or have no part in the computation."""
