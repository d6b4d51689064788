"""URDF of links and joints in a line each, for tests of linear analysis."""


def link(name, parent, axis, *, at="0 0 0", mass=0.0, com="0 0 0", inertia=(0.0, 0.0, 0.0), kind="continuous"):
    diagonal = " ".join(f'{key}="{value}"' for key, value in zip(("ixx", "iyy", "izz"), inertia, strict=True))
    body = (
        f'<inertial><origin xyz="{com}"/><mass value="{mass}"/><inertia {diagonal} ixy="0" ixz="0" iyz="0"/></inertial>'
    )
    limit = '<limit effort="1e9" velocity="1e9" lower="-10" upper="10"/>' if kind == "prismatic" else ""
    return (
        f'<link name="{name}_link">{body if mass else ""}</link><joint name="{name}" type="{kind}">'
        f'<parent link="{parent}"/><child link="{name}_link"/><origin xyz="{at}"/><axis xyz="{axis}"/>{limit}</joint>'
    )


def robot(*links):
    return '<robot name="made"><link name="base"/>' + "".join(links) + "</robot>"


def tip(name, parent, at):
    """A frame of a link."""
    return (
        f'<link name="{name}"/><joint name="{name}_j" type="fixed"><parent link="{parent}"/>'
        f'<child link="{name}"/><origin xyz="{at}"/></joint>'
    )
