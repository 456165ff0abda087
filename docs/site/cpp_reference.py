"""The C++ reference: Doxygen's XML of the headers as Sphinx's C++ domain.

    .. cpp-headers:: solve

stands for all headers of the folder rotavg/solve, each with every public name that it declares in
the namespace rotavg, or rotavg::io: first those that docs/stability.md promises to keep, then the
building blocks. So a new header, or a new name in one, is in the reference without further doing;
what is in the namespace `detail` is not.
"""

from __future__ import annotations

import re
import subprocess
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.domains.cpp import CPPDomain
from sphinx.util.docutils import SphinxDirective

ROOT = Path(__file__).resolve().parents[2]
XML = ROOT / "build" / "docs" / "doxygen" / "xml"
KINDS = ("enum", "typedef", "variable", "function")
KEPT = ROOT / "tests" / "python" / "public_api_cpp.txt"  # docs/stability.md
BUILDING_BLOCKS = """\
.. admonition:: Building blocks

   What follows is made for the headers above: documented, but free to change in a minor version
   (:doc:`/docs/stability`).

"""


def run_doxygen(app: Sphinx | None = None, output: Path | None = None) -> None:
    """Make the XML anew, in build/docs/doxygen or another folder; Doxygen fails on a warning."""
    global XML
    output = output or ROOT / "build" / "docs" / "doxygen"
    output.mkdir(parents=True, exist_ok=True)
    options = (ROOT / "docs" / "site" / "Doxyfile").read_text("utf-8")
    options += f'OUTPUT_DIRECTORY = "{output}"\n'
    subprocess.run(["doxygen", "-"], input=options, text=True, cwd=ROOT, check=True)
    XML = output / "xml"
    compound.cache_clear()


@cache
def compound(refid: str) -> ET.Element:
    """The description of a file, class or namespace."""
    found = ET.parse(XML / f"{refid}.xml").getroot().find("compounddef")
    assert found is not None, refid
    return found


def headers(folder: str) -> list[ET.Element]:
    """The files of a folder below rotavg/; those of "" lie in it itself."""
    start = f"rotavg/{folder}/" if folder else "rotavg/"
    found = []
    for entry in ET.parse(XML / "index.xml").getroot().findall("compound[@kind='file']"):
        file = compound(entry.attrib["refid"])
        path = location(file)
        if path.startswith(start) and "/" not in path[len(start) :]:
            found.append(file)
    return sorted(found, key=location)


def location(element: ET.Element) -> str:
    """The file in which it stands, as an #include names it."""
    found = element.find("location")
    assert found is not None
    return found.attrib["file"]


def public(name: str) -> bool:
    """Whether a qualified name belongs to users."""
    return name.startswith("rotavg::") and "::detail" not in name and "@" not in name


# From Doxygen's XML to reStructuredText.


def escaped(text: str) -> str:
    """Text in which nothing is markup."""
    return re.sub(r"([\\*`|_<>\[\]])", r"\\\1", re.sub(r"\s+", " ", text))


def inline(element: ET.Element) -> str:
    """A paragraph's text with what is code or stressed in it."""
    parts = [escaped(element.text or "")]
    for child in element:
        if child.tag == "computeroutput":
            code = re.sub(r"\s+", " ", "".join(child.itertext())).strip()
            # Backslash-space: markup may touch letters.
            parts.append(f"\\ ``{code}``\\ ")
        elif child.tag in ("emphasis", "bold"):
            stress = "*" if child.tag == "emphasis" else "**"
            parts.append(f"\\ {stress}{escaped(''.join(child.itertext())).strip()}{stress}\\ ")
        elif child.tag in ("ref", "ulink"):
            parts.append(escaped("".join(child.itertext())))
        elif child.tag in ENTITIES:
            parts.append(ENTITIES[child.tag])
        elif child.tag not in BLOCKS:
            raise ValueError(f"the C++ reference does not know Doxygen's <{child.tag}>")
        parts.append(escaped(child.tail or ""))
    return "".join(parts).strip()


ENTITIES = {"ndash": "–", "mdash": "—", "nonbreakablespace": " ", "deg": "°", "linebreak": " "}
BLOCKS = (
    "parameterlist",
    "simplesect",
    "itemizedlist",
    "orderedlist",
    "verbatim",
    "programlisting",
)
TITLES = {"return": "Returns", "note": "Note", "see": "See also", "pre": "Requires", "par": ""}


def blocks(element: ET.Element | None) -> list[str]:
    """Lines of a description: paragraphs, lists, and the fields that follow them."""
    lines: list[str] = []
    fields: list[str] = []
    if element is None:
        return lines
    for para in element.findall("para"):
        text = inline(para)
        if text:
            lines += [text, ""]
        for child in para:
            if child.tag in ("itemizedlist", "orderedlist"):
                mark = "-" if child.tag == "itemizedlist" else "#."
                for item in child.findall("listitem"):
                    body = blocks(item)
                    lines += [f"{mark} {body[0]}", *indented(body[1:], len(mark) + 1)]
                lines.append("")
            elif child.tag in ("verbatim", "programlisting"):
                lines += ["::", "", *indented("".join(child.itertext()).splitlines()), ""]
            elif child.tag == "parameterlist":
                fields += parameters(child)
            elif child.tag == "simplesect":
                said = " ".join(blocks(child)).strip()
                title = TITLES[child.attrib["kind"]]
                fields.append(f":{title}: {said}" if title else said)
    return lines + fields + ([""] if fields else [])


def parameters(element: ET.Element) -> list[str]:
    """A field for every parameter, or for every exception."""
    field = {"param": "param", "templateparam": "tparam", "exception": "throws"}
    lines = []
    for item in element.findall("parameteritem"):
        names = ["".join(name.itertext()) for name in item.iter("parametername")]
        said = " ".join(blocks(item.find("parameterdescription"))).strip()
        lines.append(f":{field[element.attrib['kind']]} {', '.join(names)}: {said}")
    return lines


def indented(lines: list[str], by: int = 3) -> list[str]:
    """The lines further to the right."""
    return [" " * by + line if line else "" for line in lines]


def description(element: ET.Element) -> list[str]:
    """What is said of a class or member: first in brief, then at length."""
    return [
        *blocks(element.find("briefdescription")),
        *blocks(element.find("detaileddescription")),
    ]


def text_of(element: ET.Element | None) -> str:
    """All text in an element, on one line."""
    return "" if element is None else re.sub(r"\s+", " ", "".join(element.itertext())).strip()


def template_of(element: ET.Element) -> str:
    """The line `template <...> `, if it is one."""
    found = element.find("templateparamlist")
    if found is None:
        return ""
    items = []
    for param in found.findall("param"):
        name, default = text_of(param.find("declname")), text_of(param.find("defval"))
        item = text_of(param.find("type")) + (f" {name}" if name else "")
        items.append(item + (f" = {default}" if default else ""))
    return f"template <{', '.join(items)}> "


def member(element: ET.Element) -> list[str]:
    """An enum, a typedef, a variable or a function."""
    kind, name = element.attrib["kind"], text_of(element.find("name"))
    if kind == "enum":
        scoped = "enum-class" if element.get("strong") == "yes" else "enum"
        values = []
        for value in element.findall("enumvalue"):
            values += [f".. cpp:enumerator:: {text_of(value.find('name'))}", ""]
            values += indented(description(value))
        return directive(scoped, name, description(element) + values)
    if kind == "typedef":
        aliased = text_of(element.find("type"))
        head = f"{template_of(element)}{name} = {aliased}"
        return directive("type", head, description(element))
    static = "static " if element.get("static") == "yes" else ""
    kind_of = text_of(element.find("type"))
    if kind == "variable":
        start = text_of(element.find("initializer"))
        array = text_of(element.find("argsstring"))
        # A long initial value is the header's affair.
        start = f" {start}" if start and len(start) < 60 and "{" not in start else ""
        return directive("member", f"{static}{kind_of} {name}{array}{start}", description(element))
    kind_of = re.sub(r"\b(inline|constexpr)\s+", "", f"{kind_of} ").strip()
    arguments = re.sub(r"\s*=\s*0$", "", text_of(element.find("argsstring")))
    arguments = re.sub(r"=\s*\[\].*?\}", "= {}", arguments)  # Sphinx does not read lambdas
    explicit = "explicit " if element.get("explicit") == "yes" else ""
    head = f"{template_of(element)}{explicit}{static}{kind_of} {name}{arguments}"
    return directive("function", " ".join(head.split()), description(element))


def directive(kind: str, head: str, body: list[str]) -> list[str]:
    """A directive of the C++ domain."""
    return [f".. cpp:{kind}:: {head}", "", *indented(body), ""]


def class_of(refid: str) -> list[str]:
    """A class with its public members; nothing of one that is not public."""
    element = compound(refid)
    name = text_of(element.find("compoundname"))
    if not public(name) or element.attrib["prot"] != "public":
        return []
    bases = [text_of(base) for base in element.findall("basecompoundref")]
    head = template_of(element) + name.rpartition("::")[2]
    head += f" : public {', public '.join(bases)}" if bases else ""
    body = description(element)
    for inner in element.findall("innerclass"):
        if inner.attrib["prot"] == "public":
            body += class_of(inner.attrib["refid"])
    for section in element.findall("sectiondef"):
        if section.attrib["kind"].startswith("public"):
            for found in section.findall("memberdef"):
                body += member(found)
    return directive(element.attrib["kind"], head, body)


def header(file: ET.Element) -> list[str]:
    """A section for a header; nothing for one that declares no name for users."""
    path = location(file)
    namespace = "rotavg::io" if path.startswith("rotavg/io/") else "rotavg"
    classes = [
        inner.attrib["refid"]
        for inner in file.findall("innerclass")  # what lies in a class stands with it
        if text_of(inner).rpartition("::")[0] == namespace
    ]
    declared: list[tuple[int, list[str]]] = [
        (int(compound(refid).find("location").attrib["line"]), class_of(refid)) for refid in classes
    ]
    refid = "namespace" + namespace.replace("::", "_1_1")
    for element in compound(refid).iter("memberdef"):
        at = element.find("location")
        assert at is not None
        # A definition elsewhere (`_impl`) does not count: its declaration does.
        if at.get("declfile", at.attrib["file"]) == path and element.attrib["kind"] in KINDS:
            line = int(at.get("declline", at.attrib["line"]))
            declared.append((line, member(element)))
    body = [line for _, lines in sorted(declared, key=lambda pair: pair[0]) for line in lines]
    said = description(file)
    if not body and not said:
        return []
    title = path.removeprefix("rotavg/")
    return [
        f".. _cpp-{path}:", "", title, "-" * len(title), "",
        ".. code-block:: cpp", "", f"   #include <{path}>", "",
        *said, f".. cpp:namespace:: {namespace}", "", *body,
    ]  # fmt: skip


class CppHeaders(SphinxDirective):
    """`.. cpp-headers:: FOLDER`: the reference of all headers of a folder."""

    required_arguments = 0
    optional_arguments = 1

    def run(self) -> list[nodes.Node]:
        """The sections."""
        kept = set(re.findall(r"^#include <(.*)>", KEPT.read_text("utf-8"), re.MULTILINE))
        self.env.note_dependency(str(KEPT))
        lines: list[str] = []
        blocks: list[str] = []
        folder = "".join(self.arguments)
        first = ("solve", "certify", folder or "rotavg")  # entry points are called like this
        for file in sorted(
            headers(folder), key=lambda file: not Path(location(file)).name.startswith(first)
        ):
            path = location(file)
            promised = (
                path in kept
                or path.startswith("rotavg/io/")
                or "/" not in path.removeprefix("rotavg/")
            )
            (lines if promised else blocks).extend(header(file))
            self.env.note_dependency(str(ROOT / "cpp" / "include" / path))
        if lines and blocks:
            lines += BUILDING_BLOCKS.splitlines()
        lines += blocks
        return self.parse_text_to_nodes("\n".join(lines), allow_section_headings=True)


class Names(CPPDomain):
    """The C++ domain, in whose index and search parameters are no names of their own."""

    def get_objects(self) -> Iterator[tuple[str, str, str, str, str, int]]:
        """All other names."""
        for found in super().get_objects():
            if found[2] not in ("functionParam", "templateParam"):
                yield found


def setup(app: Sphinx) -> dict[str, bool]:
    """Register with Sphinx."""
    app.add_domain(Names, override=True)
    app.connect("builder-inited", run_doxygen)
    app.add_directive("cpp-headers", CppHeaders)
    return {"parallel_read_safe": False, "parallel_write_safe": True}
