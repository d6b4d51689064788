"""Every code block of the documentation does what it says: blocks of a page in their order, in a copied folder."""

import re
import shlex

import msgspec
import pytest
import yaml
from code_blocks import PAGES, ROOT, Session, blocks_of, is_printed

import pinarm
from pinarm.cli.main import COMMANDS, _parser
from pinarm.input.yaml.document import Document
from pinarm.input.yaml.schema import convert, reading_from, with_types
from pinarm.mechanics.description import MechanismDescription
from pinarm.problems import problem_class
from pinarm.use.scenario.scenario_file import ScenarioFile

BLOCKS = [block for page in PAGES for block in blocks_of(page)]
LANGUAGES = {"yaml", "sh", "python", "text"}
RUN_BY_CI = {"run", "test", "installed"}
"""Blocks of the README that ``.ci/run`` takes from there: they build environments."""

RUN = {page: [block for block in blocks_of(page) if not block.reason and block.marker not in RUN_BY_CI]
       for page in PAGES}  # fmt: skip
SESSIONS = [page for page, blocks in RUN.items() if any(block.language in ("sh", "python") or block.title
                                                        for block in blocks)]  # fmt: skip


def name(page):
    return str(page.relative_to(ROOT))


@pytest.mark.slow
@pytest.mark.parametrize("page", SESSIONS, ids=name)
def test_a_reader_who_follows_a_page_gets_what_it_says(page, tmp_path):
    session, printed = Session(tmp_path), None
    for block in RUN[page]:
        if block.language == "text":
            if block.follows and printed is not None:
                assert is_printed(block.text, printed), f"{block.place} is not what is printed:\n{printed}"
            continue
        if block.title:
            session.write(block)
        scenario = block.language == "yaml" and block.title and "problem" in yaml.safe_load(block.text)
        printed = session.printed(block) if scenario or block.language in ("sh", "python") else None


FRAGMENTS = [block for block in BLOCKS if block.language == "yaml" and not block.title and not block.reason]


@pytest.mark.parametrize("block", FRAGMENTS, ids=lambda block: block.place)
def test_keys_of_files_are_valid(block):
    validate(Document.parse(block.text).data)


def validate(keys):
    """Validate some keys of a scenario or a mechanism file, with their units, as in a file that has them."""
    mechanism = with_types(MechanismDescription, MechanismDescription.deferred)
    scenario = with_types(ScenarioFile, ScenarioFile.deferred)
    known = next(({f.encode_name: f.type for f in msgspec.structs.fields(file)} for file in (mechanism, scenario)
                  if set(keys) <= {f.encode_name for f in msgspec.structs.fields(file)}), None)  # fmt: skip
    assert known, f"{list(keys)} are keys neither of a scenario nor of a mechanism file"
    with reading_from(ROOT / "scenarios"):
        for key, value in keys.items():
            kind = known[key]
            if key == "problem":
                problem = problem_class(value["kind"])
                kind = with_types(problem, problem.deferred)
            msgspec.convert(value, kind, dec_hook=convert)


@pytest.mark.parametrize(
    "keys", [{"loops": {"L": {"kind": "revolvte", "between": ["a", "b"]}}}, {"problem": {"kind": "forward"}},
             {"forces": {"F": {"kind": "point_spring", "between": ["a", "b"], "stiffness": "3 kg"}}}]
)  # fmt: skip
def test_a_mistake_in_keys_is_seen(keys):
    with pytest.raises((msgspec.ValidationError, pinarm.PinarmError)):
        validate(keys)


@pytest.mark.parametrize(
    ("wanted", "printed", "same"),
    [("a 1.2e-16\n", "a 3.4e-15  \n", True), ("a 1.2\n", "a 1.3\n", False), ("a\n...\nd\n", "a\nb\nc\nd\n", True),
     ("a\n...\n", "a\n", True),
     ("a\n...\nd\n", "b\nd\n", False), ("a\n", "a\nb\n", False)],
)  # fmt: skip
def test_printed_text_is_compared_but_for_rounding_and_what_is_left_out(wanted, printed, same):
    assert is_printed(wanted, printed) == same


def test_blocks_have_a_language_that_is_tested():
    assert [block.place for block in BLOCKS if block.language not in LANGUAGES] == []
    markers = {block.marker for block in BLOCKS if block.marker and not block.reason}
    assert markers == RUN_BY_CI


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_no_code_hides_from_the_tests(page):
    """An indented block has no language."""
    text = re.sub(r"^( *)```.*?^\1```$", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    assert re.findall(r"^\n {4,}(?![-*\d])\S.*(?:pinarm|:|=).*$", text, flags=re.MULTILINE) == []


_COMMAND = re.compile(r"`(?:python -m )?pinarm ([a-z][^`]*)`")
WITHIN = [(page, command) for page in PAGES for command in _COMMAND.findall(page.read_text(encoding="utf-8"))]


@pytest.mark.parametrize(("page", "command"), WITHIN, ids=lambda part: part if isinstance(part, str) else name(part))
def test_commands_within_sentences_are_known(page, command):
    words = shlex.split(command.replace("...", ""))
    assert words[0] in COMMANDS
    if len(words) > 1:
        _parser(words).parse_args(words)


def test_few_blocks_are_not_run():
    assert len([block for block in BLOCKS if block.reason]) <= 8
