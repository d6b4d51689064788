"""Files that travel: the copy is what the file was, it stands where it is looked for, and nowhere else."""

import hashlib
from pathlib import Path

import pytest

from pinarm.errors import InputError
from pinarm.input.roots import contained_file, root_of
from pinarm.use.workers import travelling_files
from pinarm.use.workers.chunk_order import FilesLacking
from pinarm.use.workers.travelling_files import Mirror, Parcel, SharedFiles


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder with a root, a file, a link to it, and a link out of the root."""
    (tmp_path / "root" / "inner").mkdir(parents=True)
    (tmp_path / "root" / ".pinarm-root").write_text("anything")
    (tmp_path / "root" / "inner" / "model.urdf").write_text("<robot/>")
    (tmp_path / "root" / "link.urdf").symlink_to("inner/model.urdf")
    (tmp_path / "outside.urdf").write_text("<robot/>")
    (tmp_path / "root" / "out.urdf").symlink_to("../outside.urdf")
    return (tmp_path / "root").resolve()


def mirrored(*paths: Path) -> Mirror:
    parcel, mirror = Parcel(), Mirror()
    parcel.add(paths)
    wanted = mirror.update(parcel.entries, {})
    assert (
        mirror.update(parcel.entries, {digest: parcel.contents[digest] for digest in wanted.digests}) == FilesLacking()
    )
    return mirror


def test_copies_are_found_as_the_files_are(folder: Path) -> None:
    mirror = mirrored(folder / "link.urdf", folder / "absent.urdf", folder / "inner", folder / "out.urdf")
    there = Path(mirror.prefix + str(folder))
    assert root_of(there / "inner") == there
    assert contained_file(there / "link.urdf", there) == there / "inner" / "model.urdf"
    assert (there / "inner" / "model.urdf").read_text() == "<robot/>"
    assert (there / ".pinarm-root").read_text() == ""
    with pytest.raises(InputError, match="leads out of the root folder"):
        contained_file(there / "out.urdf", there)
    with pytest.raises(InputError, match="does not exist"):
        contained_file(there / "absent.urdf", there)
    assert not (there / "inner" / "model.urdf").stat().st_mode & 0o111


def test_what_is_not_known_is_asked_for(folder: Path) -> None:
    mirror = mirrored(folder / "link.urdf", folder / "absent.urdf")
    names = ("link.urdf", "inner/model.urdf", "absent.urdf", "new.urdf")
    noted = [Path(f"{mirror.prefix}{folder}/{name}") for name in names]
    assert mirror.unknown([*noted, Path("/usr/share/robot.urdf")]).paths == {f"{folder}/new.urdf"}
    assert SharedFiles().unknown(noted) == SharedFiles().update({}, {}) == FilesLacking()


def test_contents_are_asked_for_by_digest(folder: Path) -> None:
    parcel = Parcel()
    parcel.add([folder / "inner" / "model.urdf"])
    assert Mirror().update(parcel.entries, {}).digests == {hashlib.sha256(b"<robot/>").hexdigest()}


def test_another_content_than_that_of_the_digest_is_refused(folder: Path) -> None:
    digest = hashlib.sha256(b"one").hexdigest()
    with pytest.raises(InputError, match="another content"):
        Mirror().update({"/a/b": ("file", digest)}, {digest: b"two"})


@pytest.mark.parametrize("path", ["a/b", "/a/../../b", "/../b", "/a/"])
def test_no_path_leads_out_of_the_folder(path: str) -> None:
    with pytest.raises(InputError, match="no path of a file that can travel"):
        Mirror().update({path: ("folder", "")}, {})


def test_nothing_is_written_through_a_link() -> None:
    mirror = Mirror()
    mirror.update({"/etc": ("folder", ""), "/a": ("link", "/etc")}, {})
    assert Path(f"{mirror.prefix}/a").resolve() == Path(f"{mirror.prefix}/etc")
    with pytest.raises(InputError, match="no path of a file that can travel"):
        mirror.update({"/a/passwd": ("folder", "")}, {})


def test_the_copies_go_with_the_mirror(folder: Path) -> None:
    mirror = mirrored(folder / "link.urdf")
    home = Path(mirror.prefix)
    assert home.is_dir()
    assert not home.stat().st_mode & 0o077, "others cannot read them"
    del mirror
    assert not home.exists()


def test_files_that_are_too_large_stay_here(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(travelling_files, "MOST_BYTES", 5)
    with pytest.raises(InputError, match=r"8 bytes with .*model\.urdf: too many to travel"):
        Parcel().add([folder / "inner" / "model.urdf"])
