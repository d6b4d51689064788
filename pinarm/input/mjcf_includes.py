"""MJCF files with their includes as one text; included files lie under the root and count against the size bounds."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

from pinarm.errors import Location, ModelError
from pinarm.input.roots import contained_file
from pinarm.input.xml_text import MAX_BYTES, Survey, read


def resolve_includes(text: str, path: Path, root: Path) -> str:
    """Return MJCF text with the content of its included files; any other text is returned unchanged.

    Args:
        text: Text of the file, within the bounds of ``Survey``.
        path: The file; included files are relative to its folder.
        root: Folder under which they must lie.

    Raises:
        ModelError: A file is malformed, too large, or included twice (also by including itself).
        InputError: A file is missing or lies elsewhere.
    """
    if "<include" not in text:
        return text
    model = ElementTree.fromstring(text)
    if model.tag != "mujoco":
        return text
    included, size, waiting = {path.resolve()}, len(text), [model]
    while waiting:
        parent = waiting.pop()
        for element in list(parent):
            if element.tag != "include":
                waiting.append(element)
                continue
            name = element.get("file", "")
            file = contained_file(path.parent.absolute() / name, root)
            if file in included:
                raise ModelError(f"the file '{name}' is included twice", expected="each file once").at(
                    Location(str(path))
                )
            included.add(file)
            content = read(file, name, MAX_BYTES - size)
            size += len(content)
            Survey.of(content, name)
            place = list(parent).index(element)
            parent[place : place + 1] = list(ElementTree.fromstring(content))
            waiting.append(parent)
            break  # the children of the parent have changed: it is searched again
    flat = ElementTree.tostring(model, encoding="unicode")
    Survey.of(flat, f"{path} with what it includes")
    return flat
