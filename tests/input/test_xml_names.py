"""Names in XML files: none is taken for another, none is passed over."""

from xml.etree import ElementTree

import pytest

from pinarm.errors import ModelError
from pinarm.input.xml_names import Content, ElementNames, UnknownName, check_names, counted, names

SHELF: dict[str, ElementNames | Content] = {"board": names("name width", unread="colour"), "sticker": Content.IDLE,
                                     "lamp": Content.UNREAD}  # fmt: skip
SHELF["shelf"] = names("name", SHELF)
KNOWN = names("", SHELF)


def check(text):
    return check_names(ElementTree.fromstring(text), KNOWN)


def refusal(text):
    with pytest.raises(UnknownName) as caught:
        check(text)
    return caught.value


def test_known_names_pass_at_any_depth():
    text = '<room><shelf><shelf name="a"><board width="1"/><sticker x="1"><y/></sticker></shelf></shelf></room>'
    assert not check(text)


def test_what_is_known_and_not_read_is_counted():
    unread = check('<room><lamp volt="9"/><shelf><board colour="red"/><lamp/></shelf></room>')
    assert unread == {"<lamp>": 2, "colour of <board>": 1}
    assert counted(unread) == "<lamp> (2), colour of <board>"


def test_elements_with_a_namespace_belong_to_others_and_are_counted():
    unread = check('<room xmlns:o="urn:o"><o:door/><!-- --><shelf o:wood="oak"><o:door><bord/></o:door></shelf></room>')
    assert unread == {"<{urn:o}door>": 2}


def test_what_stands_twice_where_one_is_read_is_refused():
    known = names("", {"shelf": names("name", {"board": names(), "sticker": Content.IDLE}, once="board")})
    check_names(ElementTree.fromstring("<room><shelf/><shelf><board/><sticker/><sticker/></shelf></room>"), known)
    with pytest.raises(ModelError, match=r"^<shelf>: it has 2 <board>"):
        check_names(ElementTree.fromstring("<room><shelf><board/><sticker/><board/></shelf></room>"), known)
    with pytest.raises(ModelError, match=r"^shelf 's': it has 2 <board>"):
        check_names(ElementTree.fromstring('<room><shelf name="s"><board/><board/></shelf></room>'), known)


@pytest.mark.parametrize(
    ("text", "message", "hint"),
    [
        ('<room><shelf name="s"><bord/></shelf></room>', "<shelf> 's' contains no <bord>", "board"),
        ('<room><shelf name="s"><board widht="1"/></shelf></room>', "<board> in <shelf> 's' has no attribute 'widht'",
         "width"),
        ('<room><board name="b" x="1"/></room>', "<board> 'b' has no attribute 'x'", ""),
        ("<room><!-- --><sheelf/></room>", "<room> contains no <sheelf>", "shelf"),
    ],
)  # fmt: skip
def test_a_name_that_is_not_known_is_refused(text, message, hint):
    error = refusal(text)
    assert (error.message, error.hint) == (message, hint)
    assert "width" in error.expected or "board" in error.expected


def test_the_first_unknown_name_of_the_file_is_told():
    assert refusal('<room><shelf><board a="1"/></shelf><board b="1"/><c/></room>').attribute == "a"


def test_its_place_is_that_of_the_element_around_it():
    """A comment, or the same name where it is known, is no place of it."""
    text = '<room>\n<!-- <board x="1"> -->\n <shelf name="x"/>\n <board\n  x="1"/>\n <board width="1" x="1"/></room>'
    place = refusal(text).place(text, "room.xml")
    assert (place.source, place.line) == ("room.xml", 4)
    assert str(refusal("<room>\n  <board z='1'/></room>").place("<room>\n  <board z='1'/></room>", "f")) == "f:2:10"
    assert refusal(text).place("<room/>", "other.xml").line == 0
